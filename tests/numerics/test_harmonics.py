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


def test_sum_of_harmonics():
    tones, phase = np.asarray([1.0 - 2.0j, 0.5j]), np.asarray([0.0, 0.3, 2.0])
    exact = np.cos(phase) + 2.0 * np.sin(phase) - 0.5 * np.sin(2.0 * phase)
    np.testing.assert_allclose(sum_of_harmonics(jnp.asarray(tones), jnp.asarray(phase)), exact, rtol=1e-12)
