"""Waveforms and peaks: exact sums, Fubini's and the sawtooth's crests, derivatives at the crest."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.field import Convergence, HarmonicField
from arfjax.acoustics.waveform import peak_pressures, readout, waveform
from arfjax.errors import InputError
from arfjax.exact.burgers import blackstock, fubini, mendousse
from tests.checks import assert_gradient


def field_of(pressure):
    """A field in water whose harmonics are given."""
    pressure = jnp.asarray(pressure, dtype=complex)
    n, n_r, n_z = pressure.shape
    zero = jnp.zeros(())
    return HarmonicField(
        pressure=pressure,
        r=np.linspace(0.0, 1e-3, n_r),
        z=np.linspace(0.05, 0.06, n_z),
        frequency=1.1e6 * jnp.arange(1.0, n + 1.0),
        density=jnp.full(n_z, 1000.0),
        sound_speed=jnp.full((n_r, n_z), 1482.0),
        attenuation=jnp.zeros((n, n_r, n_z)),
        absorption_fraction=jnp.ones(n_z),
        steepening_rate=jnp.full(n_z, 5e-6),
        layer_power=jnp.ones((1, 2)),
        convergence=Convergence(zero, zero, zero, zero, zero),
    )


def sines(amplitudes):
    """Harmonics of sum B_n sin(n theta) at one point, in MPa."""
    return -1e6j * np.asarray(amplitudes)


PEAKS = jax.jit(peak_pressures)


def peaks_of(harmonics):
    positive, negative = PEAKS(field_of(harmonics[:, None, None]))
    return float(positive[0, 0]), float(negative[0, 0])


def random_harmonics(shape, seed=0):
    random = np.random.default_rng(seed)
    falling = 1e6 / np.arange(1, shape[0] + 1).reshape(-1, *[1] * (len(shape) - 1)) ** 3
    return falling * (random.normal(size=shape) + 1j * random.normal(size=shape))


def test_waveform_is_the_sum_of_its_harmonics():
    harmonics = random_harmonics((5, 3))
    phase = 2.0 * np.pi * np.arange(16) / 16.0
    order = np.arange(1, 6)
    expected = np.sum(harmonics[None] * np.exp(1j * order[None, :, None] * phase[:, None, None]), axis=1).real
    np.testing.assert_allclose(waveform(jnp.asarray(harmonics), 16), expected, rtol=1e-12, atol=1e-6)


def test_too_few_instants_are_refused():
    with pytest.raises(InputError, match="more than twice the 5 harmonics, got 10"):
        waveform(jnp.ones((5, 2), complex), 10)


def test_peaks_of_one_and_of_two_harmonics():
    """cos(theta) + a cos(2 theta + phi): at phi = 0 the crest is 1 + a, the trough -(1 / 8a + a) for a > 1/4.

    Six more harmonics, zero, show that the waveform is resolved.
    """
    positive, negative = peaks_of(np.array([3e6 * np.exp(0.7j)]))
    np.testing.assert_allclose([positive, negative], [3e6, -3e6], rtol=1e-14)
    for amplitude in (0.3, 0.6):
        harmonics = 1e6 * np.array([1.0, amplitude, *[0.0] * 6]) * np.exp(0.9j * np.arange(1, 9))
        positive, negative = peaks_of(harmonics)
        expected = [1.0 + amplitude, -(0.125 / amplitude + amplitude)]
        np.testing.assert_allclose([positive, negative], 1e6 * np.array(expected), rtol=1e-13)


def test_peaks_at_every_point_are_those_of_a_fine_sampling():
    harmonics = random_harmonics((12, 4, 5)) * np.linspace(0.2, 1.0, 5)
    positive, negative = PEAKS(field_of(harmonics))
    wave = np.asarray(waveform(readout(jnp.asarray(harmonics)), 40000))
    np.testing.assert_allclose(positive, wave.max(axis=0), rtol=1e-6)
    np.testing.assert_allclose(negative, wave.min(axis=0), rtol=1e-6)


def test_peak_of_fubini_is_that_of_the_sine_it_came_from():
    """Without a shock no loss: the crest stays at p0 while it moves; the taper changes nothing."""
    for sigma, rtol in ((0.3, 1e-12), (0.75, 2e-5)):
        order = np.arange(1, 41)
        np.testing.assert_allclose(peaks_of(sines(fubini(order, sigma))), [1e6, -1e6], rtol=rtol)
    resolved = jnp.asarray(sines(fubini(np.arange(1, 65), 0.5)))
    np.testing.assert_allclose(readout(resolved), resolved, rtol=1e-12)


@pytest.mark.parametrize("n_harmonics", [40, 128])
def test_peak_of_a_sawtooth(n_harmonics):
    """Blackstock's shock: the crest of the bare sum is 9 percent of the jump too high, that of the read-out is not."""
    order = np.arange(1, n_harmonics + 1)
    for sigma, crest in ((2.0, 0.947747), (3.0, 0.759621)):  # sin(Phi), Phi = sigma sin(Phi)
        harmonics = sines(blackstock(order, sigma))
        bare = np.asarray(waveform(jnp.asarray(harmonics), 8192)).max()
        assert bare > 1.12e6 * crest
        np.testing.assert_allclose(peaks_of(harmonics), [1e6 * crest, -1e6 * crest], rtol=4e-2)


def test_peak_of_a_shock_of_finite_thickness():
    """Gamma = 20, sigma = 1.5: 40 harmonics hold the shock, and the read-out changes its crest by less than 1e-3."""
    exact = np.asarray(waveform(jnp.asarray(sines(mendousse(np.arange(1, 201), 1.5, 20.0))), 20000)).max()
    np.testing.assert_allclose(peaks_of(sines(mendousse(np.arange(1, 41), 1.5, 20.0)))[0], exact, rtol=1e-3)


def test_gradients_at_the_crest():
    """At once of resolved waveforms, of one whose taper is half way, and of no sound; to second order."""
    direction, base = jnp.asarray(random_harmonics((16, 3, 2), 3)), jnp.asarray(random_harmonics((16, 3, 2), 4))
    rough = jnp.arange(1.0, 17.0)[:, None] ** 1.3
    base = base.at[:, 1].multiply(rough).at[:, 2, 0].set(0.0)
    direction = direction.at[:, 1].multiply(rough).at[:, 2, 0].set(0.0)
    tapered = jnp.abs(readout(base)[-1] / base[-1])
    assert jnp.any((tapered > 0.1) & (tapered < 0.9))
    template, weight = field_of(base), 1e-6 * jnp.arange(1.0, 7.0).reshape(3, 2)

    def peak(amplitude):
        positive, negative = peak_pressures(dataclasses.replace(template, pressure=base + amplitude * direction))
        return jnp.sum(weight * (positive - 0.7 * negative))

    assert_gradient(peak, 0.3)
    slope = jax.jit(jax.grad(peak))
    second = jax.jit(jax.jacfwd(jax.grad(peak)))(0.3)
    np.testing.assert_allclose(second, (slope(0.3 + 1e-5) - slope(0.3 - 1e-5)) / 2e-5, rtol=1e-5)
