"""The bowl's field on a plane against direct quadrature of the Rayleigh integral over its surface."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.sources.radiating_bowl import RadiatingBowl
from arfjax.transducer import FocusedBowl
from tests.checks import assert_gradient

APERTURE, HOLE, FOCAL = 32e-3, 10e-3, 62.6e-3
WAVENUMBER = 2.0 * np.pi * 1.1e6 / 1482.0
RADII = np.array([0.0, 1e-3, 10e-3, 31.9e-3, 45e-3, 60e-3])


def rayleigh(r, plane, wavenumber):
    nodes, weights = np.polynomial.legendre.leggauss(500)
    start, stop = np.arcsin(HOLE / FOCAL), np.arcsin(APERTURE / FOCAL)
    angle = (0.5 * (start + stop) + 0.5 * (stop - start) * nodes)[:, None]
    around = ((np.arange(1000) + 0.5) / 1000 * np.pi)[None, :]
    ring = FOCAL * np.sin(angle)
    distance = np.sqrt(
        (r - ring * np.cos(around)) ** 2 + (ring * np.sin(around)) ** 2 + (plane - FOCAL * (1.0 - np.cos(angle))) ** 2
    )
    area = (0.5 * (stop - start) * weights)[:, None] * FOCAL * ring * 2.0 * np.pi / 1000
    return 0.5j * wavenumber.real / np.pi * np.sum(area * np.exp(-1j * wavenumber * distance) / distance)


@pytest.mark.parametrize("attenuation", [0.0, 5.0])
@pytest.mark.parametrize("plane", [11e-3, 12e-3, 40e-3])
def test_it_is_the_rayleigh_integral(plane, attenuation):
    wavenumber = WAVENUMBER - 1j * attenuation
    bowl = FocusedBowl(APERTURE, HOLE, FOCAL)
    pressure = RadiatingBowl(bowl).pressure_on_plane(1.0, jnp.asarray(wavenumber), RADII, plane)
    np.testing.assert_allclose(pressure, [rayleigh(r, plane, wavenumber) for r in RADII], rtol=0.0, atol=1e-9)


def radiated(parameters):
    *dimensions, wavenumber, attenuation, source_pressure = parameters
    bowl = FocusedBowl(*dimensions)
    pressure = RadiatingBowl(bowl).pressure_on_plane(source_pressure, wavenumber - 1j * attenuation, RADII, 12e-3)
    return jnp.sum(jnp.abs(pressure) ** 2)


def test_gradient_in_dimensions_wavenumber_and_pressure():
    parameters = tuple(map(jnp.asarray, (APERTURE, HOLE, FOCAL, WAVENUMBER, 1.0, 2.0)))
    assert_gradient(radiated, parameters, step=2e-6)


def test_gradient_is_finite_without_hole_and_loss():
    parameters = tuple(map(jnp.asarray, (APERTURE, 0.0, FOCAL, WAVENUMBER, 0.0, 2.0)))
    assert np.all(np.isfinite(jax.jit(jax.grad(radiated))(parameters)))


def test_a_plane_inside_the_bowl_gives_nan():
    pressure = RadiatingBowl(FocusedBowl(APERTURE, HOLE, FOCAL)).pressure_on_plane(
        1.0, jnp.asarray(WAVENUMBER + 0j), RADII, 8e-3
    )
    assert np.all(np.isnan(pressure))
