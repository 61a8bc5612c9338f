"""Sums of harmonics against the same sum, finely sampled."""

import jax
import jax.numpy as jnp
import numpy as np

from arfjax.numerics.harmonics import peak_to_peak, sum_of_harmonics
from tests.checks import assert_gradient


def test_peak_to_peak():
    rng = np.random.default_rng(0)
    for n in (1, 2, 7):
        tones = rng.normal(size=(n, 3)) + 1j * rng.normal(size=(n, 3))
        phase = np.linspace(0.0, 2.0 * np.pi, 200_001)
        course = np.einsum("ns,nt->st", tones, np.exp(1j * np.outer(np.arange(1, n + 1), phase))).real
        np.testing.assert_allclose(peak_to_peak(jnp.asarray(tones)), np.ptp(course, axis=1), rtol=1e-8)
    np.testing.assert_allclose(peak_to_peak(jnp.asarray([2.0 + 0j, 0j])), 4.0, rtol=1e-14)
    parts = {"re": jnp.asarray(rng.normal(size=4)), "im": jnp.asarray(rng.normal(size=4))}
    assert_gradient(lambda x: peak_to_peak(jax.lax.complex(x["re"], x["im"])), parts, step=1e-4)


def test_between_two_flat_crests_is_no_crest():
    """Of cos x - b cos 2x for b above a quarter: 1 / 8 b + b between, less -1 - b. A sample lies in the valley."""

    def swing(b):
        return peak_to_peak(jnp.stack([jnp.exp(0.1j), -b * jnp.exp(0.2j)]))

    for b in (0.251, 0.256, 0.3, 1.0):
        value, slope = jax.value_and_grad(swing)(b)
        np.testing.assert_allclose(value, 0.125 / b + 2.0 * b + 1.0, rtol=1e-14)
        np.testing.assert_allclose(slope, 2.0 - 0.125 / b**2, rtol=1e-7)


def test_of_two_crests_the_higher_one_counts():
    """Which is known to rounding, where samples are lower by a hundredth: a second harmonic with little of a first."""
    rng = np.random.default_rng(1)
    turned, phase = np.exp(2j * np.pi * rng.random((3, 2000))), np.linspace(0.0, 2.0 * np.pi, 20_001)
    tones = turned * np.asarray([[1e-3], [1.0], [1e-4]])
    found = np.asarray(jax.jit(peak_to_peak)(jnp.asarray(tones)))
    for j in range(0, 2000, 500):
        course = np.einsum("ns,nt->st", tones[:, j : j + 500], np.exp(1j * np.outer([1, 2, 3], phase))).real
        np.testing.assert_allclose(found[j : j + 500], np.ptp(course, axis=1), rtol=2e-7)


def test_sum_of_harmonics():
    tones, phase = np.asarray([1.0 - 2.0j, 0.5j]), np.asarray([0.0, 0.3, 2.0])
    exact = np.cos(phase) + 2.0 * np.sin(phase) - 0.5 * np.sin(2.0 * phase)
    np.testing.assert_allclose(sum_of_harmonics(jnp.asarray(tones), jnp.asarray(phase)), exact, rtol=1e-12)
