"""The thermocouple against closed forms: where it reads, how it lags, how its artefact grows."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.instruments.thermocouple import Thermocouple, relaxation
from arfjax.thermal.bioheat import TemperatureHistory, focal_temperature
from tests.checks import assert_gradient, assert_order
from tests.instruments.problems import FOCUS, gaussian, grid, history_of, on_cells

GRID = grid(20)
FLAT = jnp.ones(GRID.shape)
# Uneven, with an interval of no length: a jump.
TIMES = np.asarray([0.0, 0.1, 0.1, 0.35, 0.6, 1.5, 1.6, 3.0])
CAPACITY = 3.6e6


def read(thermocouple, history, where=GRID, z=FOCUS, **settings):
    return np.asarray(thermocouple(history, where, z=z, **settings))


def test_perfect_point_is_the_focal_temperature():
    history = history_of(TIMES, np.cos(TIMES), on_cells(gaussian, GRID))
    np.testing.assert_allclose(read(Thermocouple(), history), focal_temperature(history, GRID, FOCUS), rtol=1e-4)
    course = 5.0 + TIMES**2
    np.testing.assert_allclose(read(Thermocouple(), history_of(TIMES, course, FLAT)), 37.0 + course, rtol=1e-14)


def test_place_is_read_to_fourth_order():
    """The largest error over many places, since the error at one depends on where in its cell it lies."""
    offsets, errors, spacings = np.linspace(-2.5e-3, 2.5e-3, 41), [], []
    for n in (12, 18, 27, 40):
        where = grid(n)
        history = history_of([0.0], [1.0], on_cells(gaussian, where))

        def at(offset, history=history, where=where):
            return Thermocouple(radial_offset=offset, axial_offset=offset)(history, where, z=FOCUS)[0] - 37.0

        shown = jax.jit(jax.vmap(at))(jnp.asarray(offsets))
        errors.append(np.abs(np.asarray(shown) - gaussian(offsets, FOCUS + offsets)).max())
        spacings.append(1.0 / n)
    assert errors[-1] < 1e-5
    assert_order(spacings, errors, order=4.0, slack=0.3)


def test_bead_reads_the_mean_over_its_ball():
    couple = Thermocouple(radial_offset=0.8e-3, axial_offset=-0.2e-3, junction_diameter=1.2e-3)
    # Exact: the mean of x^2, y^2 and z^2 over a ball about its centre is a fifth of the squared radius.
    shape = on_cells(lambda r, z: 2e6 * r**2 - 3e6 * (z - FOCUS) ** 2 + 1e3 * (z - FOCUS), GRID)
    fifth = (0.6e-3) ** 2 / 5.0
    exact = 2e6 * (0.8e-3**2 + 2.0 * fifth) - 3e6 * (0.2e-3**2 + fifth) - 0.2
    np.testing.assert_allclose(read(couple, history_of([0.0], [1.0], shape))[0] - 37.0, exact, rtol=1e-10)


def test_bead_in_a_gaussian_by_many_random_points():
    couple = Thermocouple(radial_offset=0.8e-3, junction_diameter=1.0e-3)
    points = np.random.default_rng(3).uniform(-0.5e-3, 0.5e-3, (400_000, 3))
    x, y, z = points[np.sum(points**2, axis=1) < 0.25e-6].T
    mean = np.mean(gaussian(np.hypot(x + 0.8e-3, y), FOCUS + z))
    fine = grid(40)
    got = read(couple, history_of([0.0], [1.0], on_cells(gaussian, fine)), fine)[0] - 37.0
    assert abs(got - mean) < 4.0 * 0.1 / np.sqrt(len(x)) and abs(got - gaussian(0.8e-3, FOCUS)) > 10.0 * abs(got - mean)


def test_step_is_followed_exponentially():
    course = np.where(np.arange(len(TIMES)) >= 2, 10.0, 0.0)  # the jump at 0.1 s
    shown = read(Thermocouple(time_constant=0.4), history_of(TIMES, course, FLAT))
    exact = np.where(np.arange(len(TIMES)) >= 2, 10.0 * -np.expm1(-(TIMES - 0.1) / 0.4), 0.0)
    np.testing.assert_allclose(shown - 37.0, exact, atol=1e-13)


@pytest.mark.parametrize("time_constant", [1e-6, 0.01, 0.4, 30.0, 1e5])
def test_ramp_is_followed_with_a_lag(time_constant):
    shown = read(Thermocouple(time_constant=time_constant), history_of(TIMES, 7.0 * TIMES, FLAT))
    exact = 7.0 * (TIMES + time_constant * np.expm1(-TIMES / time_constant))
    np.testing.assert_allclose(shown - 37.0, exact, atol=1e-9)


def test_artefact_saturates_and_drains():
    times = np.concatenate([np.linspace(0.0, 12.0, 9), np.linspace(12.0, 14.0, 6)[1:]])
    still = history_of(times, np.zeros(len(times)), FLAT)
    heat, power = 8e6 * np.ones(GRID.shape), (times[1:] <= 12.0).astype(float)
    couple = Thermocouple(viscous_fraction=0.5, viscous_time_constant=0.9, time_constant=5.0)
    shown = read(couple, still, heat=heat, power=power, heat_capacity=CAPACITY) - 37.0
    saturation = 0.5 * 8e6 * 0.9 / CAPACITY
    on = saturation * -np.expm1(-np.minimum(times, 12.0) / 0.9)
    np.testing.assert_allclose(shown, on * np.exp(-np.maximum(times - 12.0, 0.0) / 0.9), rtol=1e-12, atol=1e-13)
    assert shown[8] == pytest.approx(saturation, rel=1e-5)
    by_interval = read(couple, still, heat=power[:, None, None] * heat, heat_capacity=CAPACITY * FLAT) - 37.0
    np.testing.assert_allclose(by_interval, shown, rtol=1e-12, atol=1e-13)


def test_artefact_is_that_of_the_heat_at_the_bead():
    heat, still = 8e6 * on_cells(gaussian, GRID), history_of([0.0, 0.5], [0.0, 0.0], FLAT)
    couple = Thermocouple(radial_offset=1e-3, viscous_fraction=1.2, viscous_time_constant=1e7)
    shown = read(couple, still, heat=heat, heat_capacity=CAPACITY * on_cells(lambda r, z: 1.0 + 200.0 * r, GRID))
    exact = 1.2 * 8e6 * gaussian(1e-3, FOCUS) / (1.2 * CAPACITY) * 0.5
    np.testing.assert_allclose(shown[1] - 37.0, exact, rtol=2e-3)


def test_without_time_constants_nothing_is_added_and_nothing_lags():
    course = np.sin(TIMES)
    history = history_of(TIMES, course, FLAT)
    couple = Thermocouple(viscous_fraction=2.0)
    shown = read(couple, history, heat=np.full(GRID.shape, 1e7), heat_capacity=CAPACITY)
    np.testing.assert_array_equal(shown, read(Thermocouple(), history))


def test_times_that_do_not_ascend_are_refused():
    history = history_of(TIMES, np.sin(TIMES), FLAT)
    with pytest.raises(InputError, match="must be finite and ascend"):
        TemperatureHistory(history.time[::-1], history.temperature)


def test_without_a_viscous_share_heat_may_be_given_alone():
    history = history_of(TIMES, np.sin(TIMES), FLAT)
    shown = Thermocouple(time_constant=0.3)(history, GRID, z=FOCUS, heat=jnp.full(GRID.shape, 1e7))
    np.testing.assert_array_equal(shown, Thermocouple(time_constant=0.3)(history, GRID, z=FOCUS))


def heated_problem():
    history = history_of(TIMES, TIMES, 9.0 * on_cells(gaussian, GRID))
    heat = 2e7 * on_cells(gaussian, GRID)

    def total(couple, times=None, z=FOCUS):
        given = history if times is None else TemperatureHistory(times, history.temperature)
        shown = couple(given, GRID, z=z, heat=heat, heat_capacity=CAPACITY)
        return jnp.sum(shown * jnp.cos(jnp.arange(len(TIMES))))

    return total


def test_gradient_in_every_attribute():
    total = heated_problem()
    couple = Thermocouple(0.63e-3, 0.31e-3, 0.8e-3, 0.4, 0.8, 0.7)
    assert_gradient(total, couple, rtol=2e-6)
    times = np.cumsum(np.asarray([0.0, 0.1, 0.2, 0.25, 0.25, 0.9, 0.1, 1.4]))
    assert_gradient(lambda values: total(couple, *values), (jnp.asarray(times), jnp.asarray(FOCUS)), rtol=2e-6)


def test_gradient_at_zero_is_finite_and_right():
    """Where the formulas divide by zero: the derivative is that of the one-sided limit."""
    total, zero = heated_problem(), Thermocouple(viscous_fraction=0.5)
    gradient = jax.grad(total)(jax.tree.map(jnp.asarray, zero))
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(gradient))
    for name in ("time_constant", "viscous_time_constant"):
        step = 1e-5

        def at(value, name=name):
            return float(total(eqx.tree_at(lambda c: getattr(c, name), zero, value)))

        one_sided = (4.0 * at(step) - at(2.0 * step) - 3.0 * at(0.0)) / (2.0 * step)
        assert float(getattr(gradient, name)) == pytest.approx(one_sided, rel=1e-6), name
    # By symmetry nothing changes to first order in the distance from the axis and in the size.
    assert abs(float(gradient.radial_offset)) < 1e-9 and abs(float(gradient.junction_diameter)) < 1e-9
    assert abs(float(gradient.axial_offset)) > 1.0


def test_relaxation_from_no_time_to_very_long():
    intervals = jnp.asarray([0.0, 1e-9, 1e-3, 1.0, 1e3, 1e9])
    for time_constant in (0.0, 1e-100, 1e-6, 1.0, 1e6, 1e200):
        decay, mean = relaxation(intervals, time_constant)
        slopes = jax.jacfwd(lambda tau: jnp.stack(relaxation(intervals, tau)))(time_constant)
        assert np.all(np.isfinite(slopes))
        assert np.all((decay >= 0.0) & (decay <= 1.0) & (mean >= 0.0) & (mean <= 1.0))
    x = intervals[1:]
    decay, mean = relaxation(x, 1.0)
    np.testing.assert_allclose(decay, np.exp(-x), rtol=1e-12, atol=1e-34)
    np.testing.assert_allclose(mean, -np.expm1(-x) / x, rtol=1e-13)


def test_jit_and_vmap_agree_with_one_by_one():
    total = heated_problem()
    offsets, lags = jnp.linspace(0.0, 1e-3, 3), jnp.asarray([0.0, 0.2, 2.0])
    couples = eqx.filter_vmap(lambda offset, lag: Thermocouple(radial_offset=offset, time_constant=lag))(offsets, lags)
    batched = eqx.filter_jit(eqx.filter_vmap(total))(couples)
    single = [
        total(Thermocouple(radial_offset=float(a), time_constant=float(b))) for a, b in zip(offsets, lags, strict=True)
    ]
    np.testing.assert_allclose(batched, single, rtol=1e-12)


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        ({"time_constant": -1.0}, "`time_constant` must be a finite number not below 0 [s], got -1.0"),
        ({"junction_diameter": -1e-3}, "`junction_diameter` must be a finite number not below 0 [m]"),
        ({"viscous_time_constant": np.nan}, "`viscous_time_constant` must be a finite number"),
        ({"viscous_fraction": -0.1}, "`viscous_fraction` must be a finite number not below 0 [1]"),
        ({"radial_offset": np.inf}, "`radial_offset` must be a finite number [m], got inf"),
    ],
)
def test_impossible_settings(settings, cause):
    with pytest.raises(InputError) as error:
        Thermocouple(**settings)
    assert cause in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("couple", "settings", "cause"),
    [
        (Thermocouple(), {"z": 61.3}, "Millimetres? Pass metres"),
        (Thermocouple(radial_offset=-5e-3), {}, "reaches from z"),
        (Thermocouple(junction_diameter=5e-2), {}, "reaches from z"),
        (Thermocouple(viscous_fraction=0.3), {}, "needs `heat`"),
        (Thermocouple(viscous_fraction=0.3), {"heat": np.ones(GRID.shape)}, "and `heat_capacity`"),
        (Thermocouple(), {"heat": np.ones((3, 4)), "heat_capacity": CAPACITY}, "`heat` has shape (3, 4)"),
        (Thermocouple(), {"heat": np.ones((2, *GRID.shape)), "heat_capacity": CAPACITY}, "2 entries for 7 intervals"),
        (Thermocouple(), {"heat": np.ones(GRID.shape), "heat_capacity": np.ones((3, 4))}, "`heat_capacity` has shape"),
    ],
)
def test_impossible_readings(couple, settings, cause):
    with pytest.raises(InputError) as error:
        couple(history_of(TIMES, TIMES, FLAT), GRID, **({"z": FOCUS} | settings))
    assert cause in str(error.value) and "\n" not in str(error.value)
