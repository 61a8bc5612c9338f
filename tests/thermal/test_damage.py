"""Damage laws against literature and adaptive quadrature; their integral at the break and at the extremes."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad, simpson
from scipy.optimize import brentq

from arfjax.exact.bioheat import gaussian_source_rise
from arfjax.media import ThermalMedium
from arfjax.thermal.damage import (
    LETHAL_DOSE_MINUTES,
    ArrheniusDamage,
    ThermalDose,
    TransitionStateDamage,
    accumulated_damage,
    coagulated_fraction,
    damage_increment,
)
from tests.checks import assert_gradient, assert_order

LAWS = [ThermalDose(), ArrheniusDamage(), TransitionStateDamage()]
BY_NAME = pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
PRECISIONS = pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])


def rate_of(law, temperature: float) -> float:
    """Damage per second, written out anew in plain numbers."""
    kelvin = temperature + 273.15
    if isinstance(law, ThermalDose):
        return (2.0 if temperature >= 43.0 else 4.0) ** (temperature - 43.0) / 60.0
    if isinstance(law, ArrheniusDamage):
        return 7.39e39 * math.exp(-2.577e5 / (8.314462618 * kelvin))
    eyring = 1.380649e-23 * kelvin / 6.62607015e-34
    return eyring * math.exp(553.5 / 8.314462618) * math.exp(-2.768e5 / (8.314462618 * kelvin))


def pulse(time):
    """A sonication: up to 65 degC within 20 s, then back."""
    return 37.0 + 28.0 * (time / 20.0) * np.exp(1.0 - time / 20.0)


@functools.cache
def short_sonication():
    """1 s of heat to 60 degC and 4 s of cooling."""
    tissue = ThermalMedium(0.51, 3.8e6, 3.6e4)
    source = {"heat": 2e7, "radius": 0.8e-3, "half_length": 5e-3, "heating_duration": 1.0}
    time = np.linspace(0.0, 5.0, 401)
    rise = np.array([float(gaussian_source_rise(0.0, 0.0, at, tissue, **source)) for at in time])
    return time, 37.0 + 23.0 * rise / rise.max()


def exact_damage(law, end: float) -> float:
    crossings = [brentq(lambda t: pulse(t) - 43.0, *ends) for ends in ((0.0, 20.0), (20.0, 200.0))]
    edges = [0.0, *[at for at in crossings if at < end], end]
    pieces = zip(edges[:-1], edges[1:], strict=True)
    return sum(quad(lambda t: rate_of(law, pulse(t)), *piece, epsabs=0.0, epsrel=1e-12)[0] for piece in pieces)


@BY_NAME
@pytest.mark.parametrize("temperature", [37.0, 43.0, 57.0, 80.0, 120.0])
def test_rates_as_the_literature_writes_them(law, temperature):
    np.testing.assert_allclose(np.exp(law.log_rate(temperature)), rate_of(law, temperature), rtol=1e-12)


@pytest.mark.parametrize(
    ("law", "duration", "temperature"),
    [
        (ThermalDose(), 1.0, 43.0 + math.log2(240.0 * 60.0)),
        (ArrheniusDamage(), 1.0, 2.577e5 / (8.314462618 * math.log(7.39e39)) - 273.15),
        (ArrheniusDamage(), 1.0, 64.47),
        (ArrheniusDamage(), 60.0, 50.06),
        (TransitionStateDamage(), 60.0, 57.80),
    ],
)
def test_temperature_that_coagulates_in_a_given_time(law, duration, temperature):
    """The laws differ by some kelvin at a minute, as their sources do."""
    time = jnp.asarray([0.0, duration])
    coagulates = brentq(
        lambda at: float(accumulated_damage(law, jnp.asarray([at, at]), time)[-1] / law.threshold) - 1.0, 40.0, 90.0
    )
    np.testing.assert_allclose(coagulates, temperature, atol=0.005)


@BY_NAME
def test_second_order_against_adaptive_quadrature(law):
    exact = exact_damage(law, 60.0)
    samples = [16, 31, 61, 121]
    errors = []
    for n in samples:
        time = np.linspace(0.0, 60.0, n)
        errors.append(abs(float(accumulated_damage(law, pulse(time), time)[-1]) / exact - 1.0))
    assert_order([1.0 / (n - 1) for n in samples], errors, order=2.0, slack=0.1)
    assert errors[-1] < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(("law", "gain"), [(ThermalDose(), 25.0), (ArrheniusDamage(), 20.0)])
def test_a_short_sonication_is_far_closer_than_by_trapezia(law, gain):
    """Exact temperatures every 0.1 s; the rate has a sharp peak where the heat is switched off."""
    time, temperature = short_sonication()
    rate = np.array([rate_of(law, at) for at in temperature])
    exact = simpson(rate[:81], x=time[:81]) + simpson(rate[80:], x=time[80:])
    error = float(accumulated_damage(law, temperature[::8], time[::8])[-1]) / exact - 1.0
    trapezia = np.trapezoid(rate[::8], time[::8]) / exact - 1.0
    assert 0.0 < error < trapezia / gain < 4e-3


def test_thermal_dose_is_exact_for_temperature_linear_in_time():
    start, stop, duration = 44.0, 75.0, 30.0
    time = np.array([0.0, 4.0, 5.0, 17.0, 30.0])
    dose = accumulated_damage(ThermalDose(), start + (stop - start) * time / duration, time)
    slope = (stop - start) / duration * math.log(2.0)
    np.testing.assert_allclose(dose, (2.0 ** (start - 43.0) * np.expm1(slope * time)) / slope / 60.0, rtol=1e-13)
    cooling = accumulated_damage(ThermalDose(), stop + (start - stop) * time / duration, time)
    np.testing.assert_allclose(cooling[-1], dose[-1], rtol=1e-13)


def test_arrhenius_error_on_a_ramp_is_the_stated_one():
    time = np.linspace(0.0, 1.0, 2)
    got = accumulated_damage(ArrheniusDamage(), 59.5 + time, time)[-1]
    exact, _ = quad(lambda t: rate_of(ArrheniusDamage(), 59.5 + t), 0.0, 1.0, epsabs=0.0, epsrel=1e-13)
    np.testing.assert_allclose(got / exact - 1.0, -1.4e-4, rtol=0.01)
    ends = [rate_of(ArrheniusDamage(), temperature) for temperature in (59.5, 60.5)]
    np.testing.assert_allclose((np.mean(ends) / exact - 1.0) / 1.4e-4, 45.0, rtol=0.03)


def test_an_interval_across_43_degrees_loses_the_stated_dose():
    """The chord of the logarithm is below its bend by a triangle of height d ln(2) f (1 - f), f where it bends."""
    duration, change = 1.0, 0.01
    lost = []
    for below in np.linspace(0.0, 1.0, 101):
        start = 43.0 - below * change
        got = float(damage_increment(ThermalDose(), jnp.asarray(start), jnp.asarray(start + change), duration))
        down = (1.0 - 4.0 ** (-below * change)) / (2.0 * math.log(2.0))
        up = (2.0 ** ((1.0 - below) * change) - 1.0) / math.log(2.0)
        lost.append((down + up) / change * duration / 60.0 - got)
    worst = duration / 60.0 * change * math.log(2.0) / 8.0
    np.testing.assert_allclose(max(lost), worst, rtol=0.01)
    np.testing.assert_allclose(np.mean(lost), worst * 8.0 / 12.0, rtol=0.02)


def test_one_rate_throughout_is_a_choice():
    time = jnp.asarray([0.0, 60.0])
    for temperature, minutes in ((41.0, 0.25), (45.0, 4.0)):
        dose = accumulated_damage(ThermalDose(doublings_per_kelvin_below=1.0), jnp.full(2, temperature), time)
        np.testing.assert_allclose(dose[-1], minutes, rtol=1e-13)


@BY_NAME
def test_intervals_add_up(law):
    """Steps of a stepper, one by one, give what the whole history gives; field by field as well."""
    time = jnp.asarray([0.0, 1.0, 3.0, 3.5, 9.0])
    temperature = jnp.asarray(np.random.default_rng(0).uniform(38.0, 70.0, (5, 3, 2)))
    total = accumulated_damage(law, temperature, time)
    stepped = jnp.zeros((3, 2))
    for i in range(4):
        stepped = stepped + damage_increment(law, temperature[i], temperature[i + 1], float(time[i + 1] - time[i]))
        np.testing.assert_allclose(total[i + 1], stepped, rtol=1e-13)
    assert np.all(total[0] == 0.0)
    np.testing.assert_allclose(accumulated_damage(law, temperature[:, 1, 1], time), total[:, 1, 1], rtol=1e-14)


@BY_NAME
@PRECISIONS
def test_values_and_slopes_are_finite_to_120_degrees(law, dtype):
    """Also at equal ends, where the mean rate is 0/0, and from the coldest start, where it spans the most decades."""
    starts = np.array([-20.0, 37.0, 43.0, 119.0, 119.99, 120.0])

    @jax.jit
    @jax.vmap
    def value_and_slopes(before):
        return jax.value_and_grad(lambda ends: damage_increment(law, ends[0], ends[1], 0.5))(
            (before, 0.0 * before + 120)
        )

    value, slopes = value_and_slopes(jnp.asarray(starts, dtype))
    assert value.dtype == dtype and slopes[0].dtype == dtype
    high = rate_of(law, 120.0)
    low = np.array([rate_of(law, start) for start in starts[:-1]])
    exact = [*(0.5 * (high - low) / np.log(high / low)), 0.5 * high]
    np.testing.assert_allclose(value, exact, rtol=1e-10 if dtype == jnp.float64 else 2e-5)
    assert np.all(slopes[1] > 0.0) and np.all(slopes[0] >= 0.0) and np.all(np.isfinite(slopes))


def test_slopes_and_curvature_where_the_ends_are_equal():
    """Half of the rate's slope each; the second derivatives are those of the smooth function, not of its cases."""
    law = ThermalDose()
    at = jnp.asarray([[55.0, 55.0], [55.0, 55.0 + 1e-7]])

    def increment(ends):
        return damage_increment(law, ends[0], ends[1], 60.0)

    slope = math.log(2.0) * 2.0**12
    np.testing.assert_allclose(jax.jit(jax.grad(increment))(at[0]), 0.5 * slope, rtol=1e-12)
    curvature = jax.jit(jax.vmap(jax.hessian(increment)))(at)
    exact = math.log(2.0) ** 2 * 2.0**12 * np.array([[1 / 3, 1 / 6], [1 / 6, 1 / 3]])
    np.testing.assert_allclose(curvature, np.stack([exact, exact]), rtol=1e-6)


@PRECISIONS
def test_single_precision_holds_where_stated(dtype):
    time = jnp.linspace(0.0, 60.0, 61, dtype=dtype)
    for law in LAWS:
        got = accumulated_damage(law, pulse(np.asarray(time)).astype(dtype), time)
        assert got.dtype == dtype
        reference = accumulated_damage(law, pulse(np.linspace(0.0, 60.0, 61)), np.linspace(0.0, 60.0, 61))
        np.testing.assert_allclose(got[-1], reference[-1], rtol=1e-5 if dtype == jnp.float32 else 1e-14)


@BY_NAME
def test_gradient_in_temperature_time_and_constants(law):
    rng = np.random.default_rng(1)
    temperature, time = rng.uniform(37.5, 65.0, (8, 4)), np.sort(rng.uniform(0.0, 30.0, 8))
    temperature[3] = temperature[2] + 0.01 * rng.uniform(size=4)  # the series, too

    def logarithm(arguments):
        law, temperature, time = arguments
        return jnp.sum(jnp.log(accumulated_damage(law, temperature, time)[1:]))

    assert_gradient(logarithm, (law, temperature, time), step=1e-6)


def test_smooth_closure_goes_to_the_sharp_threshold():
    damage = jnp.asarray([0.0, 1.0, 200.0, 240.0, 288.0, 1e30])
    np.testing.assert_allclose(
        coagulated_fraction(damage, 240.0, width=1e-3), [0.0, 0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-12
    )
    width = 0.4
    tenths = coagulated_fraction(
        240.0 * jnp.asarray([81.0 ** (-width / 2.0), 81.0 ** (width / 2.0)]), 240.0, width=width
    )
    np.testing.assert_allclose(tenths, [0.1, 0.9], rtol=1e-12)
    some = jnp.asarray([3.0, 100.0, 1e4])
    hill = 1.0 / (1.0 + (LETHAL_DOSE_MINUTES / some) ** (1.0 / width))
    np.testing.assert_allclose(coagulated_fraction(some, LETHAL_DOSE_MINUTES, width=width), hill, rtol=1e-12)


@PRECISIONS
@pytest.mark.parametrize("width", [0.1, 1.0])
def test_smooth_closure_has_finite_slopes(width, dtype):
    damage = jnp.asarray([0.0, 1e-35, 1e-30, 1e-3, 240.0, 1e30], dtype)
    value, slope = jax.vmap(jax.value_and_grad(lambda d: coagulated_fraction(d, 240.0, width=width)))(damage)
    assert value.dtype == dtype and np.all(value >= 0.0) and np.all(value <= 1.0)
    assert np.all(np.isfinite(slope)) and np.all(slope >= 0.0) and slope[0] == 0.0
    np.testing.assert_allclose(slope[4], 0.25 / width / 240.0, rtol=1e-5)


def test_gradient_of_the_closure():
    damage = jnp.asarray([0.3, 100.0, 300.0, 5e4])
    assert_gradient(
        lambda arguments: jnp.sum(jnp.sin(coagulated_fraction(arguments[0], arguments[1], width=arguments[2]))),
        (damage, jnp.asarray(200.0), jnp.asarray(0.7)),
    )
