"""Steepening of plane waves against closed forms, what shocks dissipate, order, stability, gradients.

In units of the source's amplitude and the length of shock formation, scaled to 1 MPa so that nothing is near zero.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize

from arfjax.acoustics.nonlinearity import (
    FEWEST_HARMONICS,
    courant_number,
    shock_absorption,
    shock_fraction,
    steepen,
    steepening_rate,
)
from arfjax.acoustics.settings import MarchSettings
from arfjax.errors import InputError
from arfjax.exact.burgers import blackstock, fay, fubini, mendousse
from arfjax.media import AcousticMedium
from tests.checks import assert_gradient, assert_order

FIRST_FIVE = np.arange(1, 6)
AMPLITUDE = 1e6
RATE = jnp.asarray(1.0 / AMPLITUDE)


def as_harmonics(amplitudes):
    """p = sum of B_n sin n theta, theta = omega t."""
    return jnp.asarray(-1j * AMPLITUDE * np.asarray(amplitudes))


def amplitudes(pressure):
    np.testing.assert_allclose(np.asarray(pressure).real, 0.0, atol=1e-9 * AMPLITUDE)
    return -np.asarray(pressure).imag / AMPLITUDE


def sine(n_harmonics):
    return as_harmonics(np.eye(n_harmonics)[0])


def intensity(pressure):
    return jnp.sum(jnp.abs(pressure / AMPLITUDE) ** 2, axis=-1)


def dissipation(pressure):
    """-d intensity / d sigma by the absorption at shocks."""
    return jnp.sum(2.0 * shock_absorption(pressure, RATE) * jnp.abs(pressure / AMPLITUDE) ** 2, axis=-1)


@functools.partial(jax.jit, static_argnames="n_steps")
def march(pressure, sigma, n_steps, attenuation=0.0):
    """Steps of half the absorption, steepening, half the absorption; intensity and dissipation along the path."""
    step, orders = sigma / n_steps, jnp.arange(1.0, pressure.shape[-1] + 1.0)
    half = jnp.exp(-0.5 * step * attenuation * orders**2)

    def advance(pressure, _):
        pressure = half * steepen(half * pressure, step, RATE)
        return pressure, (intensity(pressure), dissipation(pressure))

    end, (kept, lost) = jax.lax.scan(advance, pressure, None, length=n_steps)
    first = (intensity(pressure)[None], dissipation(pressure)[None])
    return end, jnp.concatenate([first[0], kept]), jnp.concatenate([first[1], lost])


def steps_of(courant, n_harmonics, sigma):
    return int(np.ceil(np.sqrt(2.0) * n_harmonics * sigma / courant))


def test_the_rate_is_that_of_the_medium():
    medium = AcousticMedium(1060.0, 1584.0, 4.0, 1.1, 7.2)
    np.testing.assert_allclose(
        steepening_rate(medium, 1.1e6), 2.0 * np.pi * 1.1e6 * 4.6 / (1060.0 * 1584.0**3), rtol=1e-14
    )


@pytest.mark.parametrize("sigma", [0.25, 0.5, 0.75])
def test_before_the_shock_it_is_fubinis(sigma):
    end, _, _ = march(sine(32), sigma, 100)
    np.testing.assert_allclose(amplitudes(end)[:5], fubini(FIRST_FIVE, sigma), rtol=1e-6)


@pytest.mark.parametrize(("n_harmonics", "tolerance"), [(64, 6e-4), (40, 1e-3), (32, 3e-3)])
def test_beyond_the_shock_it_is_blackstocks(n_harmonics, tolerance):
    """With 64 harmonics the first five are good to 0.3 per mille at sigma 3 and 0.1 at 1.5; the first three to 0.2."""
    for sigma in (1.5, 3.0):
        end, _, _ = march(sine(n_harmonics), sigma, steps_of(0.65, n_harmonics, sigma))
        np.testing.assert_allclose(amplitudes(end)[:5], blackstock(FIRST_FIVE, sigma), rtol=tolerance)
        np.testing.assert_allclose(amplitudes(end)[:3], blackstock(FIRST_FIVE[:3], sigma), rtol=6e-4)


def extrapolated(start, sigma, attenuation, n_steps):
    """Without the error of the second order that absorption in turns makes."""
    coarse, fine = (march(start, sigma, n, attenuation)[0] for n in (n_steps, 2 * n_steps))
    return amplitudes((4.0 * fine - coarse) / 3.0)[:5]


def test_fays_solution_stays_fays():
    start = as_harmonics(fay(np.arange(1, 65), 1.0, 10.0))
    np.testing.assert_allclose(extrapolated(start, 3.0, 0.1, 200), fay(FIRST_FIVE, 4.0, 10.0), rtol=1e-6)


@pytest.mark.parametrize(("goldberg_number", "tolerance"), [(10.0, 1e-6), (50.0, 3e-5)])
def test_from_a_sine_it_is_the_exact_solution(goldberg_number, tolerance):
    end = extrapolated(sine(64), 3.0, 1.0 / goldberg_number, 200)
    np.testing.assert_allclose(end, mendousse(FIRST_FIVE, 3.0, goldberg_number), rtol=tolerance)


def test_energy_is_kept_before_the_shock():
    _, kept, lost = march(sine(32), 0.6, 100)
    np.testing.assert_allclose(kept, 1.0, rtol=1e-10)
    assert np.max(lost) < 1e-11


@pytest.mark.parametrize(("courant", "tolerance"), [(1.3, 2.5e-3), (0.65, 3e-4)])
def test_what_shocks_take_from_the_wave_is_heat(courant, tolerance):
    """2 alpha I, summed along the path, is the drop of intensity, and that is Blackstock's."""
    n_steps = steps_of(courant, 32, 3.0)
    _, kept, lost = march(sine(32), 3.0, n_steps)
    for first in (0, n_steps // 2):
        heat = np.sum(0.5 * (lost[first + 1 :] + lost[first:-1])) * 3.0 / n_steps
        np.testing.assert_allclose(heat, kept[first] - kept[-1], rtol=tolerance)
    np.testing.assert_allclose(kept[0] - kept[-1], 1.0 - energy_of_blackstock(3.0), rtol=1e-3)


def energy_of_blackstock(sigma):
    r"""Sum of B_n^2: 2 / pi \int sin^2 Phi dtheta over what the shock has left, theta = Phi - sigma sin Phi."""
    shock = optimize.brentq(lambda phase: phase - sigma * np.sin(phase), 1.0, np.pi, xtol=1e-15)
    peak = np.sin(shock)
    return 2.0 / np.pi * (0.5 * (np.pi - shock) + 0.25 * np.sin(2.0 * shock) + sigma / 3.0 * peak**3)


def test_heat_does_not_depend_on_the_number_of_harmonics():
    lost = [1.0 - march(sine(n), 3.0, steps_of(0.65, n, 3.0))[1][-1] for n in (32, 64, 128)]
    np.testing.assert_allclose(lost, 1.0 - energy_of_blackstock(3.0), rtol=5e-4)


SAWTOOTH = as_harmonics(blackstock(np.arange(1, 33), 3.0))
SMOOTH = jnp.pad(AMPLITUDE * jnp.asarray([1.0, 0.3j, -0.1 + 0.1j]), (0, 29))


@pytest.mark.parametrize(("start", "length"), [(SMOOTH, 0.3), (SAWTOOTH, 0.2)])
def test_fourth_order_in_the_substep(start, length):
    counts = (8, 16, 32)
    reference = march(start, length, 512)[0]
    errors = [np.linalg.norm(march(start, length, n)[0] - reference) for n in counts]
    assert_order(1.0 / np.array(counts), errors, order=4, slack=0.3)


def test_substeps_are_steps():
    whole = steepen(SAWTOOTH, jnp.asarray(0.06), RATE, 3)
    np.testing.assert_allclose(whole, march(SAWTOOTH, 0.06, 3)[0], rtol=1e-10, atol=1e-9)


def test_a_length_for_each_point_equals_calls_one_by_one():
    waves, lengths = jnp.stack([SAWTOOTH, SMOOTH, sine(32)]), jnp.asarray([0.0, 0.02, 0.05])
    each = [steepen(wave, length, RATE, 2) for wave, length in zip(waves, lengths, strict=True)]
    np.testing.assert_allclose(steepen(waves, lengths, RATE, 2), jnp.stack(each), rtol=1e-12, atol=1e-9)
    np.testing.assert_array_equal(each[0], SAWTOOTH)


def test_nothing_is_absorbed_where_the_waveform_is_resolved():
    resolved = as_harmonics(mendousse(np.arange(1, 65), 0.5, 10.0))
    assert np.max(shock_absorption(resolved, RATE)) < 1e-18
    assert shock_fraction(resolved) < 1e-10
    assert np.all(shock_absorption(SMOOTH, RATE) == 0.0)


def test_with_the_fewest_harmonics_a_second_one_is_no_shock():
    """Any wave has it; the sensor would taper its waveform, and the highest pressure with it, by percents."""
    wave = jnp.zeros(FEWEST_HARMONICS, complex).at[:2].set(AMPLITUDE * jnp.asarray([1.0, 0.2]))
    assert shock_fraction(wave) < 1e-10
    assert np.all(shock_absorption(wave, RATE) < 1e-10)
    for n_harmonics in (2, FEWEST_HARMONICS - 1):
        with pytest.raises(InputError, match="must be 1, for linear sound, or 5 or more"):
            MarchSettings(n_harmonics=n_harmonics)


def test_at_a_shock_the_upper_harmonics_are_absorbed():
    """S / A of a sawtooth, whose n B_n is b for all n: b over b sqrt(sum of 1/n^2); alpha = 3 N g A (S / A)^2."""
    sawtooth = as_harmonics(0.4 / np.arange(1, 33))
    fraction = 1.0 / np.sqrt(np.sum(1.0 / np.arange(1, 33) ** 2))
    np.testing.assert_allclose(shock_fraction(sawtooth), fraction, rtol=1e-10)
    absorption = np.asarray(shock_absorption(sawtooth, RATE))
    np.testing.assert_allclose(absorption[-1], 3.0 * 32.0 * 0.4 * fraction, rtol=1e-10)
    assert np.all(absorption[:9] == 0.0)  # 0.3 of 32
    np.testing.assert_allclose(absorption[15] / absorption[-1], (2.0 / 7.0) ** 4, rtol=1e-10)
    np.testing.assert_allclose(shock_absorption(7.0 * sawtooth, RATE), 7.0 * absorption, rtol=1e-10)
    np.testing.assert_allclose(shock_absorption(sawtooth, 7.0 * RATE), 7.0 * absorption, rtol=1e-10)


def test_courant_number():
    """Of a sine N g p h; up to the stated bound nothing grows, and beyond it the wave is wrong but stays finite."""
    np.testing.assert_allclose(courant_number(sine(32), jnp.asarray(0.02), RATE), np.sqrt(2.0) * 32 * 0.02, rtol=1e-12)
    exact = march(sine(32), 3.0, steps_of(0.3, 32, 3.0))[1][-1]
    for courant, wrong in ((1.3, 1e-3), (2.7, 1e-2)):
        _, kept, _ = march(sine(32), 3.0, steps_of(courant, 32, 3.0))
        assert np.all(np.diff(kept) < 1e-4)
        np.testing.assert_allclose(kept[-1], exact, rtol=wrong)


def smooth_functional(values):
    pressure = values["real"] + 1j * values["imag"]
    end = steepen(pressure, values["length"], values["rate"] / AMPLITUDE, 2)
    weights = jnp.arange(1.0, 9.0)
    heat = jnp.sum(shock_absorption(end, values["rate"] / AMPLITUDE) * (end.real**2 + end.imag**2))
    return (jnp.sum(weights * (end.real**2 + 0.5 * end.imag)) + heat) / AMPLITUDE**2


@pytest.mark.parametrize("tail", [0.05, 1.0])
def test_gradient(tail):
    """At a smooth wave, and at a shock, whose harmonics fall as 1 / n."""
    rng = np.random.default_rng(3)
    order = np.arange(1, 9)
    wave = AMPLITUDE * tail ** (order - 1.0) / order * np.exp(0.3j * rng.normal(size=8))
    values = {"real": wave.real, "imag": wave.imag, "length": jnp.asarray(0.1), "rate": jnp.asarray(1.0)}
    assert_gradient(smooth_functional, values, step=1e-3)


def test_gradient_at_zero_pressure():
    """There the wave is what it was: the derivative is one."""
    zeros = jnp.zeros(8)
    end = lambda real: jnp.sum(jnp.arange(1.0, 9.0) * steepen(real + 0j, jnp.asarray(0.1), RATE).real)  # noqa: E731
    np.testing.assert_allclose(jax.jit(jax.grad(end))(zeros), np.arange(1.0, 9.0), rtol=1e-12)
    for sensor in (shock_fraction, lambda p: courant_number(p, jnp.asarray(0.1), RATE)):
        assert np.isfinite(sensor(zeros + 0j))


def test_single_precision_agrees():
    double = steepen(SAWTOOTH, jnp.asarray(0.05), RATE, 3)
    with jax.enable_x64(False):
        single = steepen(jnp.asarray(np.asarray(SAWTOOTH)), jnp.asarray(0.05), jnp.asarray(1.0 / AMPLITUDE), 3)
    assert single.dtype == np.complex64
    np.testing.assert_allclose(single, double, rtol=0.0, atol=3e-6 * AMPLITUDE)
