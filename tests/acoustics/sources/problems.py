"""What the tests of sources share: the bowl, water, and the way from a source to its field farther on."""

import jax
import jax.numpy as jnp
import numpy as np

from arfjax.acoustics.diffraction import ExactOneWay
from arfjax.numerics.hankel import hankel_basis
from arfjax.transducer import FocusedBowl

APERTURE, HOLE, FOCAL = 32e-3, 10e-3, 62.6e-3
BOWL = FocusedBowl(APERTURE, HOLE, FOCAL)
FREQUENCY, DENSITY, SOUND_SPEED = 1.1e6, 1000.0, 1482.0
IMPEDANCE = DENSITY * SOUND_SPEED
WAVENUMBER = 2.0 * np.pi * FREQUENCY / SOUND_SPEED
COMPLEX_WAVENUMBER = jnp.asarray(WAVENUMBER + 0j)
BASIS = hankel_basis(256, 62e-3)


def axial_wavenumber(basis=BASIS, diffraction=ExactOneWay()):  # noqa: B008  frozen and without state
    return diffraction.axial_wavenumber(COMPLEX_WAVENUMBER[None], jnp.asarray(basis.wavenumbers))


def series(source, basis=BASIS, plane=12e-3, **options):
    """Coefficients of a source on its own plane, or of a surface's field on `plane`."""
    if source.is_on_plane:
        return jax.jit(lambda: source.series(1.0, COMPLEX_WAVENUMBER, basis, **options))()
    radiated = jax.jit(lambda: source.pressure_on_plane(1.0, COMPLEX_WAVENUMBER, basis.nodes, plane, **options))
    return jnp.asarray(basis.to_series) @ radiated()


def advanced(coefficients, distance, r, basis=BASIS, diffraction=ExactOneWay()):  # noqa: B008
    """The field (r, z) at distances from the plane, in one step each: uniform medium, no sponge."""
    advance = jnp.exp(-1j * axial_wavenumber(basis, diffraction)[0][:, None] * jnp.asarray(distance)[None, :])
    return np.asarray(basis.evaluation_matrix(r) @ (coefficients[:, None] * advance))


def rayleigh(r, plane, wavenumber, profile, n=500):
    """Direct sum over a surface: `profile(points on [0, 1])` gives radius, depth, length and weight of its rings."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    ring, depth, length, weight = (values[:, None] for values in profile(0.5 * (nodes + 1.0)))
    around = ((np.arange(1000) + 0.5) / 1000 * np.pi)[None, :]
    distance = np.sqrt((r - ring * np.cos(around)) ** 2 + (ring * np.sin(around)) ** 2 + (plane - depth) ** 2)
    area = weight * length * 0.5 * weights[:, None] * ring * 2.0 * np.pi / 1000
    return 0.5j * wavenumber.real / np.pi * np.sum(area * np.exp(-1j * wavenumber * distance) / distance)


def bowl_profile(weight=np.ones_like, start=HOLE, stop=APERTURE):
    """Rings of the bowl between two radii, weighted by a function of the radius."""

    def profile(points):
        first, last = np.arcsin(start / FOCAL), np.arcsin(stop / FOCAL)
        angle = first + (last - first) * points
        ring = FOCAL * np.sin(angle)
        return ring, FOCAL * (1.0 - np.cos(angle)), np.full_like(ring, FOCAL * (last - first)), weight(ring)

    return profile
