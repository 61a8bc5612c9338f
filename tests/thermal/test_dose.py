"""Thermal dose against closed forms, and its behaviour at the break and at the extremes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from arfjax.errors import InputError
from arfjax.thermal.dose import LETHAL_DOSE_MINUTES, cumulative_equivalent_minutes, dose_rate
from arfjax.thermal.history import require_times
from tests.checks import assert_gradient, assert_order

RAMP = (35.0, 70.0, 60.0)  # from, to [degC], in [s]


def ramp_dose(temperature: float) -> float:
    """CEM43 [min] of the ramp up to a temperature above 43 degC, in closed form."""
    start, stop, duration = RAMP
    slope = (stop - start) / duration
    below = (1.0 - 4.0 ** (start - 43.0)) / np.log(4.0)
    above = (2.0 ** (temperature - 43.0) - 1.0) / np.log(2.0)
    return (below + above) / slope / 60.0


@pytest.mark.parametrize(
    ("temperature", "equivalent"), [(41.0, 1.0 / 16.0), (43.0, 1.0), (50.0, 128.0), (120.0, 2.0**77)]
)
def test_a_minute_at_a_constant_temperature(temperature, equivalent):
    time = np.array([0.0, 10.0, 45.0, 60.0])
    dose = cumulative_equivalent_minutes(np.full(4, temperature), time)
    np.testing.assert_allclose(dose, equivalent * time / 60.0, rtol=1e-13)
    np.testing.assert_allclose(dose_rate(np.full(4, temperature)), equivalent, rtol=1e-13)


def test_a_ramp_across_the_break_is_exact_but_for_the_interval_that_bends():
    """Samples that hit 43 degC exactly lose nothing; else one interval loses its triangle, less than stated."""
    start, stop, duration = RAMP
    for n in (36, 71):
        time = np.linspace(0.0, duration, n)
        dose = cumulative_equivalent_minutes(start + (stop - start) * time / duration, time)
        np.testing.assert_allclose(dose[-1], ramp_dose(stop), rtol=1e-12)
    for n in (31, 60, 62):
        time = np.linspace(0.0, duration, n)
        dose = cumulative_equivalent_minutes(start + (stop - start) * time / duration, time)
        change, interval = (stop - start) / (n - 1), duration / (n - 1) / 60.0
        at = np.searchsorted(start + (stop - start) * time / duration, 50.0)
        lost = ramp_dose(start + (stop - start) * time[at] / duration) - float(dose[at])
        assert 0.0 < lost <= 1.02 * interval * change * np.log(2.0) / 8.0


def test_second_order_where_temperature_bends():
    """A temperature that is quadratic in time, 44 to 60 degC: the error is that of its second derivative, as stated."""
    samples, bend = [16, 31, 61, 121], -2.0 * 16.0 / 20.0**2

    def temperature(time):
        return 60.0 + 0.5 * bend * (time - 20.0) ** 2

    exact, _ = quad(lambda t: 2.0 ** (temperature(t) - 43.0) / 60.0, 0.0, 20.0, epsrel=1e-13)
    errors = []
    for n in samples:
        time = np.linspace(0.0, 20.0, n)
        errors.append(1.0 - float(cumulative_equivalent_minutes(temperature(time), time)[-1]) / exact)
    assert_order([1.0 / (n - 1) for n in samples], errors, order=2.0, slack=0.05)
    np.testing.assert_allclose(errors[-1], -np.log(2.0) / 12.0 * bend * (20.0 / 120.0) ** 2, rtol=0.01)


def test_the_ramp_is_lethal_near_55_degrees():
    start, stop, duration = RAMP
    time = np.linspace(0.0, duration, 6001)
    temperature = start + (stop - start) * time / duration
    dose = np.asarray(cumulative_equivalent_minutes(temperature, time))
    lethal = np.interp(LETHAL_DOSE_MINUTES, dose, temperature)
    np.testing.assert_allclose(lethal, 55.507, atol=2e-3)
    np.testing.assert_allclose(ramp_dose(lethal), LETHAL_DOSE_MINUTES, rtol=1e-4)


def test_uneven_sampling_of_a_field():
    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(0.0, 60.0, 9))
    temperature = rng.uniform(38.0, 60.0, (9, 3, 2))
    dose = cumulative_equivalent_minutes(temperature, time)
    for index in np.ndindex(3, 2):
        column = temperature[(slice(None), *index)]
        rate = np.where(column >= 43.0, 2.0, 4.0) ** (column - 43.0)
        log_means = np.diff(rate) / np.diff(np.log(rate))
        np.testing.assert_allclose(dose[(-1, *index)], np.sum(log_means * np.diff(time) / 60.0), rtol=1e-12)
    assert np.all(np.diff(dose, axis=0) >= 0.0)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize("temperature", [-200.0, 37.0, 43.0, 120.0])
def test_values_and_slopes_are_finite(temperature, dtype):
    time = jnp.linspace(0.0, 60.0, 5, dtype=dtype)
    dose, slope = jax.value_and_grad(lambda shift: cumulative_equivalent_minutes(shift + 0.0 * time, time)[-1])(
        jnp.asarray(temperature, dtype)
    )
    assert dose.dtype == dtype
    rate = np.log(2.0) if temperature >= 43.0 else np.log(4.0)
    np.testing.assert_allclose(slope, rate * dose, rtol=1e-5)
    assert np.isfinite(slope)


def test_courses_that_are_none_are_refused():
    for time in ([0.0, 20.0, 10.0], [0.0, np.nan, 10.0], [0.0, 10.0, np.inf]):
        with pytest.raises(InputError, match="must be finite and ascend"):
            cumulative_equivalent_minutes(np.full(3, 50.0), np.asarray(time))
    with pytest.raises(InputError, match="Kelvin"):
        cumulative_equivalent_minutes(jnp.asarray([310.0, 323.0]), jnp.asarray([0.0, 20.0]))
    with pytest.raises(InputError, match=r"shape \(2,\) for 3 temperatures"):
        require_times(np.asarray([0.0, 20.0]), 3)
    # What runs away is not a matter of units, and traced times are not looked at.
    assert float(cumulative_equivalent_minutes(np.asarray([37.0, 400.0]), np.asarray([0.0, 1.0]))[-1]) > 1e100
    course = jnp.full(3, 50.0)
    falling = jax.jit(lambda time: cumulative_equivalent_minutes(course, time))(jnp.asarray([0.0, 20.0, 10.0]))
    assert float(falling[2]) < float(falling[1])


def test_gradient():
    time = jnp.linspace(0.0, 30.0, 12)
    temperature = jnp.asarray(np.random.default_rng(1).uniform(36.0, 60.0, (12, 4)))
    assert_gradient(lambda t: jnp.sum(jnp.log(cumulative_equivalent_minutes(t, time)[1:])), temperature)
