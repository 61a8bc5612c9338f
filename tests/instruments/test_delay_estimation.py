"""The bound on jitter against its integral and against the cross-correlation of simulated speckle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from arfjax.errors import InputError
from arfjax.instruments.delay_estimation import DelayEstimation
from tests.checks import assert_gradient_of_each_leaf

BAND = {"centre_frequency": 7.25e6, "fractional_bandwidth": 2.82 / 7.25}
SAMPLING = 100e6
WINDOW = 260
"""Samples: 2 mm of depth."""


def estimation(**settings):
    return DelayEstimation(**BAND, window_duration=WINDOW / SAMPLING, **settings)


@pytest.mark.parametrize(("noise", "correlation"), [(0.1, 1.0), (0.0, 0.95), (0.3, 0.9), (1e-6, 1.0)])
def test_bound_is_the_integral_over_the_coherence(noise, correlation):
    coherence = (correlation / (1.0 + noise**2)) ** 2
    information, _ = quad(lambda f: (2.0 * np.pi * f) ** 2, 5.84e6, 8.66e6)
    # 1 - coherence from small numbers, since noise of 1e-6 leaves 4 digits of it otherwise.
    rest = 1.0 - correlation**2 + 2.0 * noise**2 + noise**4
    information *= 2.0 * WINDOW / SAMPLING * coherence * (1.0 + noise**2) ** 2 / rest
    np.testing.assert_allclose(estimation(noise_to_signal=noise, correlation=correlation).delay_sd, information**-0.5)


def test_bound_is_walker_and_traheys_expression():
    f0, b, t, snr, rho = 7.25e6, 2.82 / 7.25, WINDOW / SAMPLING, 10.0, 0.97
    printed = np.sqrt(3.0 / (2.0 * f0**3 * np.pi**2 * t * (b**3 + 12.0 * b)) * ((1 + 1 / snr**2) ** 2 / rho**2 - 1.0))
    got = estimation(noise_to_signal=1.0 / snr, correlation=rho)
    np.testing.assert_allclose(got.delay_sd, printed, rtol=1e-12)
    np.testing.assert_allclose(got.displacement_sd, 770.0 * printed, rtol=1e-12)


def speckle(rng, shape):
    """Gaussian echoes with a flat spectrum over the band and a mean square of 1, one period of many samples."""
    frequencies = np.fft.rfftfreq(shape[1], 1.0 / SAMPLING)
    inside = (frequencies >= 5.84e6) & (frequencies <= 8.66e6)
    parts = rng.normal(size=(2, shape[0], len(frequencies)))
    spectrum = (parts[0] + 1j * parts[1]) * inside
    return spectrum / (2.0 * np.sqrt(np.sum(inside))) * shape[1], frequencies


def tracked_delays(noise, correlation, *, n_trials=1500, delay=0.37 / SAMPLING, seed=11):
    """Peaks of the normalised cross-correlation of simulated windows, by a parabola through three lags."""
    rng, length, reach = np.random.default_rng(seed), 1024, 9
    same, frequencies = speckle(rng, (n_trials, length))
    other = correlation * same + np.sqrt(1.0 - correlation**2) * speckle(rng, same.shape[:1] + (length,))[0]
    other = other * np.exp(-2j * np.pi * frequencies * delay)
    first, second = (np.fft.irfft(each + noise * speckle(rng, (n_trials, length))[0], axis=1) for each in (same, other))
    start = (length - WINDOW) // 2
    window = first[:, start : start + WINDOW]
    lags = np.arange(-reach, reach + 1)
    moved = np.stack([second[:, start + lag : start + lag + WINDOW] for lag in lags], axis=1)
    scores = np.einsum("tn,tln->tl", window, moved) / np.linalg.norm(moved, axis=2)
    best = np.clip(np.argmax(scores, axis=1), 1, len(lags) - 2)
    left, middle, right = (scores[np.arange(n_trials), best + step] for step in (-1, 0, 1))
    return (lags[best] + 0.5 * (left - right) / (left - 2.0 * middle + right)) / SAMPLING - delay


@pytest.mark.parametrize(("noise", "correlation"), [(10**-1.5, 1.0), (0.1, 1.0), (0.0, 0.99), (0.1, 0.98)])
def test_cross_correlation_of_speckle_nearly_reaches_the_bound(noise, correlation):
    """Within four standard errors of a standard deviation, 7 %, and for a bound a little more above."""
    errors = tracked_delays(noise, correlation)
    bound = float(estimation(noise_to_signal=noise, correlation=correlation).delay_sd)
    ratio = errors.std() / bound
    assert 1.0 - 4.0 / np.sqrt(2.0 * len(errors)) < ratio < 1.05 + 4.0 / np.sqrt(2.0 * len(errors))


def test_jitter_falls_with_the_window_and_vanishes_without_noise():
    assert float(estimation().delay_sd) == 0.0
    short, long = (DelayEstimation(**BAND, window_duration=t, noise_to_signal=0.1) for t in (1e-6, 4e-6))
    np.testing.assert_allclose(short.delay_sd / long.delay_sd, 2.0, rtol=1e-12)


def test_gradient():
    assert_gradient_of_each_leaf(
        lambda each: 1e9 * each.displacement_sd, estimation(noise_to_signal=0.2, correlation=0.97), step=1e-4
    )
    perfect = jax.grad(lambda each: each.displacement_sd)(jax.tree.map(jnp.asarray, estimation()))
    assert all(float(leaf) == 0.0 for leaf in jax.tree.leaves(perfect))


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        ({"centre_frequency": 7.5}, "`centre_frequency` is 7.5 Hz. Megahertz? Pass hertz."),
        ({"centre_frequency": np.nan}, "`centre_frequency` must be a finite number above 0 [Hz]"),
        ({"window_duration": 2.6}, "`window_duration` is 2.6 s. Microseconds? Pass seconds."),
        ({"fractional_bandwidth": 39.0}, "`fractional_bandwidth` must lie above 0 and not above 2, got 39.0. Percent?"),
        ({"correlation": 0.0}, "`correlation` must be a finite number above 0 [1]"),
        ({"noise_to_signal": -0.1}, "`noise_to_signal` must be a finite number not below 0 [1]"),
        ({"sound_speed": 0.0}, "`sound_speed` must be"),
    ],
)
def test_impossible_settings(settings, cause):
    with pytest.raises(InputError) as error:
        DelayEstimation(**(BAND | {"window_duration": 2.6e-6} | settings))
    assert cause in str(error.value) and "\n" not in str(error.value)
