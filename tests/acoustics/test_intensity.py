"""Intensity, heat and force: exact for a plane wave, and bookkeeping between them."""

import jax
import jax.numpy as jnp
import numpy as np

from arfjax.acoustics.field import Convergence, HarmonicField
from arfjax.acoustics.intensity import (
    force_density_of_intensity,
    heat_deposition,
    intensity,
    radiation_force_density,
)

Z = np.linspace(0.0, 0.1, 2001)
ALPHA = np.array([4.0, 9.0])
DENSITY, SPEED = 1060.0, 1584.0


def plane_wave(amplitude=1e6, absorption_fraction=1.0):
    """Two harmonics that decay along z; the second at half the amplitude."""
    k = 4000.0 * np.array([1.0, 2.0]) - 1j * ALPHA
    pressure = amplitude * np.array([1.0, 0.5])[:, None, None] * np.exp(-1j * k[:, None, None] * Z[None, None, :])
    return HarmonicField(
        pressure=jnp.asarray(pressure),
        r=np.zeros(1),
        z=Z,
        frequency=jnp.asarray([1.1e6, 2.2e6]),
        density=jnp.full(Z.shape, DENSITY),
        sound_speed=jnp.full((1, Z.size), SPEED),
        attenuation=jnp.broadcast_to(jnp.asarray(ALPHA)[:, None, None], (2, 1, Z.size)),
        absorption_fraction=jnp.full(Z.shape, absorption_fraction),
        steepening_rate=jnp.zeros(Z.shape),
        layer_power=jnp.zeros((1, 2)),
        convergence=Convergence(*[jnp.zeros(())] * 5),
    )


def test_intensity_of_a_plane_wave():
    expected = 1e12 * np.array([[1.0], [0.25]]) / (2.0 * DENSITY * SPEED) * np.exp(-2.0 * ALPHA[:, None] * Z[None, :])
    np.testing.assert_allclose(intensity(plane_wave())[:, 0], expected, rtol=1e-12)


def test_heat_is_the_divergence_of_intensity():
    field = plane_wave()
    lost = -np.gradient(np.asarray(intensity(field)).sum(axis=0)[0], Z, edge_order=2)
    np.testing.assert_allclose(heat_deposition(field)[0], lost, rtol=1e-6)


def test_scattering_heats_not_but_pushes():
    field = plane_wave()
    scattering = plane_wave(absorption_fraction=0.7)
    np.testing.assert_allclose(heat_deposition(scattering), 0.7 * heat_deposition(field), rtol=1e-14)
    for each in (field, scattering):
        np.testing.assert_allclose(radiation_force_density(each), heat_deposition(field) / SPEED, rtol=1e-14)


def test_force_by_the_fundamentals_attenuation_misses_what_the_harmonics_lose():
    # I_2 = I_1 / 4 at z = 0: (4 + 9 / 4) against 4 (1 + 1 / 4).
    field = plane_wave()
    ratio = force_density_of_intensity(field)[0, 0] / radiation_force_density(field)[0, 0]
    np.testing.assert_allclose(ratio, 5.0 / 6.25, rtol=1e-14)


def test_gradient_is_finite_at_zero_pressure():
    assert jax.grad(lambda amplitude: intensity(plane_wave(amplitude))[0, 0, 0])(0.0) == 0.0
