"""Bioheat whose constants and heat follow temperature and dose, in fixed steps."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.media import ThermalMedium
from arfjax.thermal.bioheat import (
    Convective,
    FixedTemperature,
    Insulated,
    Phase,
    ThermalField,
    Walls,
    solve_bioheat,
    uniform_field,
)
from arfjax.thermal.dose import cumulative_equivalent_minutes
from arfjax.thermal.feedback import FROZEN, solve_with_feedback
from tests.checks import assert_gradient_of_each_leaf, assert_order, observed_order

GRID = AxisymmetricGrid(8e-3 * np.linspace(0.0, 1.0, 9) ** 1.3, np.linspace(0.09, 0.11, 15))
SHAPE = np.exp(-((GRID.r[:, None] / 3e-3) ** 2) - ((GRID.z[None, :] - 0.1) / 5e-3) ** 2)
BOX = AxisymmetricGrid(np.linspace(0.0, 4e-3, 3), np.linspace(0.0, 6e-3, 4))
INSULATED = Walls(Insulated(), Insulated(), Insulated())
START = 44.0  # degC; above 43, where the rate of dose has its kink
CAPACITY = 4e6  # J/(m^3 K)

CONSTANTS = {
    "k": 0.5,
    "k per K": 0.01,
    "c": 3.8e6,
    "c per K": 0.004,
    "w": 6e4,
    "w per K": 0.02,
    "w dose": 30.0,
    "made": 2e4,
    "made per K": 0.05,
    "heat": 4e6,
    "heat per K": 0.02,
    "heat dose": 60.0,
    "heating": 12.0,
    "cooling": 4.0,
    "power": 1.3,
    "rest": 0.2,
    "initial": START,
    "arterial": 40.0,
    "transfer": 300.0,
    "wall": 2.0,
}


def properties_of(p):
    """Smooth laws, all of them at work."""

    def properties(temperature, dose):
        above = temperature - 44.0
        return ThermalField(
            conductivity=p["k"] * (1.0 + p["k per K"] * above),
            heat_capacity=p["c"] * (1.0 + p["c per K"] * above),
            perfusion_conductance=p["w"] * (1.0 + p["w per K"] * above) / (1.0 + dose / p["w dose"]),
            metabolic_heat=p["made"] * (1.0 + p["made per K"] * above),
        )

    return properties


def source_of(p):
    def source(temperature, dose):
        return p["heat"] * SHAPE * (1.0 + p["heat per K"] * (temperature - 44.0) + dose / (dose + p["heat dose"]))

    return source


@functools.partial(jax.jit, static_argnums=(1, 2, 3))
def run(p, n_heating, n_cooling, tolerance=FROZEN):
    return solve_with_feedback(
        properties_of(p),
        source_of(p),
        GRID,
        phases=[Phase(p["heating"], n_heating, p["power"]), Phase(p["cooling"], n_cooling, p["rest"])],
        initial_temperature=p["initial"],
        arterial_temperature=p["arterial"],
        walls=Walls(outer=Convective(p["transfer"], p["wall"])),
        tolerance=tolerance,
    )


def in_a_box(properties, source, phases, *, grid=BOX, walls=INSULATED, initial=37.0, tolerance=FROZEN):
    """Result of one compiled run; blood as warm as the start."""
    return jax.jit(
        lambda phases: solve_with_feedback(
            properties,
            source,
            grid,
            phases=phases,
            initial_temperature=initial,
            arterial_temperature=initial,
            walls=walls,
            tolerance=tolerance,
        )
    )(phases)


def plain(grid=BOX, capacity=CAPACITY):
    field = uniform_field(ThermalMedium(0.5, capacity, 0.0), grid)
    return lambda temperature, dose: field


def test_constant_tissue_and_heat_are_solve_bioheat():
    rng = np.random.default_rng(2)
    field = ThermalField(
        *(jnp.asarray(rng.uniform(*e, GRID.shape)) for e in ((0.2, 1.0), (3e6, 5e6), (0, 5e4), (0, 1e4)))
    )
    phases = [Phase(3.0, 4), Phase(1.0, 2, 0.5)]
    walls = Walls(Convective(300.0, 1.0), FixedTemperature(2.0), Insulated())
    options = {"phases": phases, "initial_temperature": 40.0, "arterial_temperature": 37.0, "walls": walls}
    expected = solve_bioheat(field, 2e7 * SHAPE, GRID, **options)
    answer = lambda *state: jnp.asarray(2e7 * SHAPE)  # noqa: E731
    got = jax.jit(lambda: solve_with_feedback(lambda *state: field, answer, GRID, **options, tolerance=1.0))()
    np.testing.assert_allclose(got.time, expected.time, rtol=1e-15)
    np.testing.assert_allclose(got.temperature, expected.temperature, rtol=1e-11)
    # A step's dose is that of the temperatures at its ends, as the dose of a history is.
    dose = cumulative_equivalent_minutes(expected.temperature, expected.time)
    np.testing.assert_allclose(got.dose, dose, rtol=1e-9)
    powers = np.repeat([1.0, 0.5], [4, 2])[:, None, None]
    np.testing.assert_allclose(got.heat, powers * 2e7 * SHAPE[None], rtol=1e-15)
    assert int(got.effort.n_steps) == 6 and int(got.effort.n_rejected) == 0 and bool(got.effort.converged)


@pytest.mark.slow
def test_second_order_in_time_with_every_law_at_work():
    """Temperature and dose, against 16 times finer steps; the source is that of the start."""
    steps = [(12, 6), (24, 12)]
    fine = run(CONSTANTS, 384, 192)
    assert float(fine.temperature.max()) > 53.0 and float(fine.dose.max()) > 30.0
    coarse = [run(CONSTANTS, *n) for n in steps]
    for name, most in (("temperature", 4e-3), ("dose", 0.4)):
        reference = getattr(fine, name)[-1]
        errors = [float(np.abs(getattr(each, name)[-1] - reference).max()) for each in coarse]
        assert_order([1.0 / n for n, _ in steps], errors, order=2.0, slack=0.2)
        assert errors[-1] < most


@pytest.mark.slow
def test_a_source_that_follows_in_every_step_is_of_first_order():
    steps = [12, 24]
    fine = run(CONSTANTS, 384, 192, 1e-9).temperature[-1]
    errors = [float(np.abs(run(CONSTANTS, n, n // 2, 1e-9).temperature[-1] - fine).max()) for n in steps]
    assert observed_order([1.0 / n for n in steps], errors) == pytest.approx(1.0, abs=0.15)
    frozen = run(CONSTANTS, 12, 6).temperature[-1]
    assert errors[0] < 0.2 * float(np.abs(frozen - fine).max())


def warmed_enthalpy(n_steps):
    """Rise of a uniform box, c (1 + b rise), evenly heated for 10 s: measured and exact."""
    grow, heat = 0.02, 1.2e7

    def properties(temperature, dose):
        above = temperature - 37.0
        return ThermalField(0.5 * (1.0 + 0.1 * above), CAPACITY * (1.0 + grow * above), 0.0 * above)

    result = in_a_box(properties, lambda *_: jnp.full(BOX.shape, heat), [Phase(10.0, n_steps)])
    exact = (np.sqrt(1.0 + 2.0 * grow * heat * np.asarray(result.time) / CAPACITY) - 1.0) / grow
    return result.temperature - 37.0, exact


def test_capacity_that_grows_takes_the_enthalpy():
    """c0 (u + b u^2 / 2) = Q t."""
    steps, errors = [10, 20], []
    for n in steps:
        got, exact = warmed_enthalpy(n)
        np.testing.assert_allclose(got, np.broadcast_to(got[:, :1, :1], got.shape), atol=1e-11)
        errors.append(float(np.abs(got[:, 0, 0] - exact).max()))
    assert exact[-1] > 20.0
    assert_order([1.0 / n for n in steps], errors, order=2.0)
    assert errors[-1] < 2e-3


def test_perfusion_that_dose_stops_and_metabolic_heat():
    """Uniform and insulated: c u' = made - w(dose) u with dose' from temperature, against a fine Runge-Kutta run."""
    made, flow, half = 4e5, 2e5, 5.0

    def properties(temperature, dose):
        one = jnp.ones_like(temperature)
        return ThermalField(0.5 * one, CAPACITY * one, flow / (1.0 + dose / half), made * one)

    def slope(state):
        rise, dose = state
        return np.asarray([(made - flow / (1.0 + dose / half) * rise) / CAPACITY, 2.0 ** (START + rise - 43.0) / 60.0])

    state, step = np.zeros(2), 0.05
    for _ in range(2000):
        a = slope(state)
        b = slope(state + 0.5 * step * a)
        c = slope(state + 0.5 * step * b)
        state = state + step / 6.0 * (a + 2.0 * b + 2.0 * c + slope(state + step * c))
    unstopped = made / flow * -np.expm1(-flow / CAPACITY * 100.0)
    assert state[0] > 1.2 * unstopped
    steps, errors = [20, 40], []
    for n in steps:
        got = in_a_box(properties, lambda temperature, _: 0.0 * temperature, [Phase(100.0, n)], initial=START)
        errors.append([abs(got.temperature[-1, 0, 0] - START - state[0]), abs(got.dose[-1, 0, 0] - state[1])])
    for error, most in zip(np.transpose(errors), (3e-3, 4e-2), strict=True):
        assert_order([1.0 / n for n in steps], error, order=2.0, slack=0.2)
        assert error[-1] < most


def test_what_is_delivered_is_stored_whatever_conductivity_does():
    """Insulated, no perfusion, capacity that varies from cell to cell but not in time; heat that follows."""
    rng = np.random.default_rng(3)
    conductivity, capacity = rng.uniform(0.1, 2.0, GRID.shape), rng.uniform(3e6, 5e6, GRID.shape)

    def properties(temperature, dose):
        above = temperature - START
        return ThermalField(
            conductivity * (1.0 + 0.05 * above + dose / (50.0 + dose)), capacity + 0.0 * above, 0.0 * above
        )

    result = in_a_box(
        properties,
        lambda temperature, _: 2e7 * SHAPE * (1.0 + 0.05 * (temperature - START)),
        [Phase(5.0, 5), Phase(3.0, 2, 0.0), Phase(4.0, 4, 0.5)],
        grid=GRID,
        initial=START,
        tolerance=2.0,
    )
    assert int(result.updates[-1]) > 3
    stored = np.einsum("rz,trz->t", capacity * GRID.volumes, result.temperature - START)
    delivered = np.cumsum(np.einsum("rz,trz->t", GRID.volumes, result.heat) * np.diff(result.time))
    np.testing.assert_allclose(stored[1:], delivered, rtol=1e-11)


def test_steady_slab_whose_conductivity_grows_with_temperature():
    """Kirchhoff: u + b u^2 / 2 is a straight line between walls at 40 K and 0."""
    grow, cells, errors = 0.02, [8, 16], []
    for n in cells:
        grid = AxisymmetricGrid(np.asarray([0.0, 1e-3]), np.linspace(0.0, 1e-2, n + 1))

        def properties(temperature, dose):
            above = temperature - 37.0
            return ThermalField(0.5 * (1.0 + grow * above), CAPACITY + 0.0 * above, 0.0 * above)

        walls = Walls(Insulated(), FixedTemperature(40.0), FixedTemperature(0.0))
        nothing = lambda temperature, _: 0.0 * temperature  # noqa: E731
        steady = in_a_box(
            properties, nothing, [Phase(30.0, 100), Phase(1500.0, 100)], grid=grid, walls=walls
        ).temperature
        assert float(np.abs(steady[-1] - steady[-2]).max()) < 1e-8
        line = (40.0 + 0.5 * grow * 40.0**2) * (1.0 - grid.z / 1e-2)
        exact = (np.sqrt(1.0 + 2.0 * grow * line) - 1.0) / grow
        errors.append(float(np.abs(steady[-1, 0] - 37.0 - exact).max()))
    assert_order([1.0 / n for n in cells], errors, order=2.0, slack=0.2)
    assert errors[-1] < 0.2


GAIN = 1.6e5  # W/(m^3 K): the heat of a box whose source answers GAIN times its temperature


def follow(phases, tolerance, *, initial=37.0):
    """What a uniform insulated box must do: times of being asked, temperatures, in plain numbers."""
    temperature = asked = last = initial
    temperatures, counts = [initial], [0]
    for phase in phases:
        for _ in range(phase.n_steps):
            moved = phase.power > 0.0 and abs(temperature - last) > tolerance
            if moved:  # asked for half as far ahead as temperature has come since the last time
                asked = temperature + float(np.clip(0.5 * (temperature - last), -0.5 * tolerance, 0.5 * tolerance))
                last = temperature
            temperature += phase.power * GAIN * asked / CAPACITY * phase.duration / phase.n_steps
            temperatures.append(temperature)
            counts.append(counts[-1] + moved)
    return np.asarray(temperatures), np.asarray(counts[1:])


@pytest.mark.parametrize("tolerance", [0.4, 1.1, FROZEN])
def test_the_source_is_asked_when_temperature_has_moved(tolerance):
    """The exact recursion, with a break in which nothing is asked although the tissue has moved."""
    phases = [Phase(2.9, 10), Phase(2.0, 3, 0.0), Phase(1.5, 10, 2.0)]
    got = in_a_box(plain(), lambda temperature, _: GAIN * temperature, phases, tolerance=tolerance)
    temperatures, counts = follow(phases, tolerance)
    np.testing.assert_array_equal(got.updates, counts)
    expected = np.broadcast_to(temperatures[:, None, None], got.temperature.shape)
    np.testing.assert_allclose(got.temperature, expected, rtol=1e-13)
    assert counts[-1] == 0 if math.isinf(tolerance) else counts[-1] > 1
    assert np.all(np.diff(got.updates)[9:12] == 0)  # the break
    if tolerance == 0.4:
        assert counts[13] == counts[12] + 1  # asked at once after it


def test_error_falls_with_the_square_of_the_tolerance():
    """Against exp(GAIN t / C) in steps far shorter than a tolerance takes; asking ahead takes the first order away."""
    tolerances, phases = [4.0, 2.0, 1.0], [Phase(10.0, 8000)]
    exact = 37.0 * np.exp(GAIN / CAPACITY * 10.0)
    errors = []
    for tolerance in tolerances:
        got = in_a_box(plain(), lambda temperature, _: GAIN * temperature, phases, tolerance=tolerance)
        errors.append(abs(float(got.temperature[-1, 0, 0]) - exact))
    assert_order(tolerances, errors, order=2.0, slack=0.25)
    assert errors[-1] < 0.05 * tolerances[-1]


def test_doublings_of_dose_count_as_kelvins():
    """At 47 degC and no heat dose grows by 16 minutes a minute, temperature not at all."""
    phases, tolerance = [Phase(180.0, 60)], 1.2
    got = in_a_box(plain(), lambda temperature, dose: 1e-3 * dose, phases, initial=47.0, tolerance=tolerance)
    dose = np.asarray(got.dose[:, 0, 0])
    np.testing.assert_allclose(dose, 16.0 / 60.0 * np.asarray(got.time), rtol=1e-6)
    asked, count, counts, heat = 0.0, 0, [], []
    for now in dose[:-1]:
        if np.log2((1.0 + now) / (1.0 + asked)) > tolerance:
            asked, count = now, count + 1
        counts.append(count)
        heat.append(1e-3 * asked)
    assert count == 4
    np.testing.assert_array_equal(got.updates, counts)
    np.testing.assert_allclose(got.heat[:, 0, 0], heat, rtol=1e-12)


def quantity(p, n_heating=6, n_cooling=2, tolerance=3.0):
    result = run(p, n_heating, n_cooling, tolerance)
    return jnp.mean(result.temperature[1:, :3, 4:9]) + jnp.log(jnp.mean(result.dose[-1, :3, 4:9]))


@pytest.mark.slow
def test_derivatives_in_every_law_time_power_and_temperature():
    """With a source that is asked twice on the way, at steps that do not depend on the small change."""
    updates = run(CONSTANTS, 6, 2, 3.0).updates
    assert int(updates[-1]) >= 2
    assert_gradient_of_each_leaf(quantity, CONSTANTS)


@pytest.mark.slow
def test_a_batch_matches_a_loop():
    powers = jnp.asarray([0.5, 1.0, 1.5])
    one = lambda power: run(CONSTANTS | {"power": power}, 6, 2, 3.0)  # noqa: E731
    batch = jax.jit(jax.vmap(one))(powers)
    for index, power in enumerate(powers):
        single = one(power)
        np.testing.assert_allclose(batch.temperature[index], single.temperature, rtol=1e-12)
        np.testing.assert_array_equal(batch.updates[index], single.updates)
    assert len(set(batch.updates[:, -1].tolist())) > 1


@pytest.mark.parametrize("tolerance", [0.0, -1.0, math.nan])
def test_a_senseless_tolerance_is_refused_in_one_line(tolerance):
    with pytest.raises(InputError, match=r"`tolerance` must be positive \[K\].*got") as caught:
        in_a_box(plain(), lambda temperature, _: temperature, [Phase(1.0, 1)], tolerance=tolerance)
    assert "\n" not in str(caught.value)


def test_no_phase_is_refused_in_one_line():
    with pytest.raises(InputError, match="`phases` is empty") as caught:
        in_a_box(plain(), lambda temperature, _: temperature, [])
    assert "\n" not in str(caught.value)
