"""Bioheat with feedback in steps chosen by their error, against fixed steps and exact recursions."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.thermal.adaptive import solve_adaptively
from arfjax.thermal.bioheat import Convective, Insulated, Phase, ThermalField, Walls
from arfjax.thermal.feedback import FROZEN, solve_with_feedback
from tests.checks import assert_order

GRID = AxisymmetricGrid(8e-3 * np.linspace(0.0, 1.0, 9) ** 1.3, np.linspace(0.09, 0.11, 15))
SHAPE = np.exp(-((GRID.r[:, None] / 2e-3) ** 2) - ((GRID.z[None, :] - 0.1) / 4e-3) ** 2)
BOX = AxisymmetricGrid(np.asarray([0.0, 1e-3, 2e-3]), np.asarray([0.0, 1e-3]))
CAPACITY = 4e6  # J/(m^3 K)
CONSTANTS = {
    "k": 0.5,
    "k per K": 0.01,
    "c": 3.8e6,
    "w": 6e4,
    "w dose": 30.0,
    "heat": 8e6,
    "heat per K": 0.02,
    "heating": 8.0,
    "cooling": 5.0,
    "power": 1.2,
    "initial": 44.0,
    "arterial": 40.0,
    "transfer": 300.0,
}


@functools.partial(jax.jit, static_argnames=("solver", "steps", "options"))
def run(p, solver=solve_adaptively, steps=(3, 2), options=()):
    """Heat that is switched off between output times which are not multiples of any step."""

    def properties(temperature, dose):
        above = temperature - 44.0
        return ThermalField(
            conductivity=p["k"] * (1.0 + p["k per K"] * above),
            heat_capacity=p["c"] + 0.0 * above,
            perfusion_conductance=p["w"] / (1.0 + dose / p["w dose"]),
        )

    return solver(
        properties,
        lambda temperature, dose: p["heat"] * SHAPE * (1.0 + p["heat per K"] * (temperature - 44.0)),
        GRID,
        phases=[Phase(p["heating"], steps[0], p["power"]), Phase(p["cooling"], steps[1], 0.0)],
        initial_temperature=p["initial"],
        arterial_temperature=p["arterial"],
        walls=Walls(outer=Convective(p["transfer"], 1.0)),
        **dict(options),
    )


def adaptive(error, tolerance=FROZEN, mode="forward"):
    return run(CONSTANTS, options=(("error", error), ("tolerance", tolerance), ("mode", mode)))


@pytest.fixture(scope="module")
def fine():
    """Fixed steps, 160 times the output's."""
    return run(CONSTANTS, solver=solve_with_feedback, steps=(480, 320))


@pytest.mark.slow
def test_error_is_a_small_part_of_what_a_step_may_make(fine):
    """At every output time, the switch among them, and in proportion: 16 times less allowed, 16 times less made."""
    allowed, errors, steps = [0.4, 0.1, 0.025], [], []
    for error in allowed:
        got = adaptive(error)
        np.testing.assert_allclose(got.time, fine.time[::160], rtol=1e-14)
        errors.append(float(np.abs(got.temperature - fine.temperature[::160]).max()))
        steps.append(int(got.effort.n_steps))
        assert bool(got.effort.converged)
        assert 0.2 * error < float(got.effort.error) <= error
        assert errors[-1] < 0.3 * error
    assert_order(allowed, errors, order=1.0, slack=0.25)
    assert steps[0] < steps[1] < steps[2]


def test_heat_is_that_of_the_phase_and_no_step_crosses_the_switch():
    got = adaptive(0.4)
    answer = CONSTANTS["heat"] * SHAPE
    np.testing.assert_allclose(got.heat[:3], np.broadcast_to(1.2 * answer, (3, *GRID.shape)), rtol=1e-12)
    assert np.all(got.heat[3:] == 0.0)
    assert 0.2 * 0.4 < float(got.effort.error) <= 0.4
    # The first step may be as long as an output interval, is too long, and is tried again.
    assert int(got.effort.n_rejected) >= 1


@pytest.mark.slow
def test_updates_are_counted_and_reach_fixed_steps_that_follow(fine):
    following = run(CONSTANTS, solver=solve_with_feedback, steps=(480, 320), options=(("tolerance", 1e-9),))
    got = adaptive(0.025, 1.0)
    assert got.updates[-1] == got.updates[2] >= 4  # none while the power is off
    assert np.all(np.diff(got.updates) >= 0)
    late = np.abs(got.temperature - following.temperature[::160]).max()
    ignored = np.abs(fine.temperature - following.temperature).max()
    assert late < 0.15 * ignored and ignored > 1.0
    assert np.all(adaptive(0.4).updates == 0)


def in_a_box(heat, phases, **options):
    field = ThermalField(jnp.full(BOX.shape, 0.5), jnp.full(BOX.shape, CAPACITY), jnp.zeros(BOX.shape))
    walls = Walls(Insulated(), Insulated(), Insulated())
    temperatures = {"initial_temperature": 37.0, "arterial_temperature": 37.0, "walls": walls, "mode": "forward"}
    solve = lambda: solve_adaptively(lambda *_: field, heat, BOX, phases=phases, **temperatures, **options)  # noqa: E731
    return jax.jit(solve)()


def test_steady_heat_is_exact_at_every_output_time_whatever_the_steps():
    """A uniform insulated box under powers that switch five times: straight lines between the switches."""
    lengths, powers = np.asarray([1.3, 0.7, 2.1, 0.2, 1.1]), np.asarray([1.0, 0.0, 0.5, 2.0, 1.0])
    phases = [Phase(length, 2, power) for length, power in zip(lengths.tolist(), powers.tolist(), strict=True)]
    got = in_a_box(lambda temperature, _: jnp.full(BOX.shape, 8e6), phases, error=1.0)
    halves, shares = np.repeat(0.5 * lengths, 2), np.repeat(powers, 2)
    expected = 37.0 + np.concatenate([[0.0], np.cumsum(halves * shares)]) * 8e6 / CAPACITY
    np.testing.assert_allclose(got.time[1:], np.cumsum(halves), rtol=1e-14)
    np.testing.assert_allclose(got.temperature, np.broadcast_to(expected[:, None, None], (11, 2, 1)), rtol=1e-13)
    np.testing.assert_allclose(got.heat[:, 0, 0], 8e6 * shares, rtol=1e-13)


def test_the_error_told_is_the_largest_of_all_steps_and_cells():
    """Heat in the inner of two cells leaks into the outer, three times as large; in the dark steps err less.

    The difference of the two follows d' = 2 K/s - d / (3 s), and the inner cell has three quarters of its error: of
    the first stage of the first step, h / 2 (k1 + k2).
    """
    inner = lambda temperature, _: jnp.asarray([[8e6], [0.0]])  # noqa: E731
    lit, dark = Phase(4.0, 1), Phase(0.1, 1, 0.0)
    alone, both = (in_a_box(inner, phases, error=1e3) for phases in ([lit], [lit, dark]))
    assert int(both.effort.n_steps) == 2
    np.testing.assert_allclose(both.effort.error, alone.effort.error, rtol=1e-12)
    step, decay = 4.0, 4.0 / 3.0
    matrix = 1.0 + (1.0 - np.sqrt(0.5)) * decay
    first = 2.0 / matrix
    second = (2.0 - decay * first - 2.0 * first) / matrix
    np.testing.assert_allclose(alone.effort.error, 0.75 * 0.5 * step * abs(first + second), rtol=1e-10)


@pytest.mark.slow
def test_not_reaching_the_end_is_reported():
    """Heat that is not a number at any temperature above 40 degC: there is no way on."""
    broken = lambda temperature, _: jnp.where(temperature > 40.0, jnp.nan, 8e6)  # noqa: E731
    got = in_a_box(broken, [Phase(4.0, 4)], tolerance=1.0)
    assert not bool(got.effort.converged)
    np.testing.assert_allclose(got.temperature[:2, 0, 0], [37.0, 39.0], rtol=1e-12)
    assert np.all(np.isinf(got.temperature[3:]))


def quantity(p, error, mode="forward"):
    result = run(p, options=(("error", error), ("tolerance", 5.0), ("mode", mode)))
    return jnp.mean(result.temperature[1:, :3, 4:9]) + jnp.log(jnp.mean(result.dose[-1, :3, 4:9]))


@pytest.mark.slow
def test_both_modes_agree_where_the_error_chooses_the_steps():
    assert int(adaptive(0.1, 5.0).effort.n_rejected) >= 1
    p = jax.tree.map(jnp.asarray, CONSTANTS)
    forward = jax.jit(jax.jacfwd(lambda p: quantity(p, 0.1)))(p)
    reverse = jax.jit(jax.grad(lambda p: quantity(p, 0.1, "reverse")))(p)
    for name in p:
        assert float(forward[name]) != 0.0
        np.testing.assert_allclose(reverse[name], forward[name], rtol=1e-8, err_msg=name)


@pytest.mark.slow
def test_derivatives_are_those_of_the_result_where_steps_do_not_move():
    """So large an error is allowed that the output times are the steps; where it chooses them, differences see the
    steps and the updates move, which derivatives leave out: percents of what a difference gives then."""
    assert int(adaptive(1.5, 5.0).effort.n_steps) == 5
    p, value, step = jax.tree.map(jnp.asarray, CONSTANTS), jax.jit(lambda p: quantity(p, 1.5)), 1e-3
    forward = jax.jit(jax.jacfwd(lambda p: quantity(p, 1.5)))(p)
    for name, constant in CONSTANTS.items():
        ends = [value(p | {name: jnp.asarray(constant * (1.0 + sign * step))}) for sign in (1.0, -1.0)]
        central = (ends[0] - ends[1]) / (2.0 * step * constant)
        np.testing.assert_allclose(forward[name], central, rtol=2e-6, err_msg=name)


@pytest.mark.parametrize(
    "options", [{"error": 0.0}, {"error": math.nan}, {"error": math.inf}, {"tolerance": 0.0}, {"tolerance": math.nan}]
)
def test_senseless_tolerances_are_refused_in_one_line(options):
    with pytest.raises(InputError, match=r"`error` and `tolerance` must be positive \[K\], got") as caught:
        in_a_box(lambda temperature, _: temperature, [Phase(1.0, 1)], **options)
    assert "\n" not in str(caught.value)


def test_no_phase_is_refused_in_one_line():
    with pytest.raises(InputError, match="`phases` is empty") as caught:
        in_a_box(lambda temperature, _: temperature, [])
    assert "\n" not in str(caught.value)
