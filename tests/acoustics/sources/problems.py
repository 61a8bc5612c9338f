"""What the tests of sources share: the bowl, water, and the way from a source to its field farther on."""

import jax.numpy as jnp
import numpy as np

from arfjax.acoustics.diffraction import ExactOneWay
from arfjax.acoustics.sources.base import PlaneSource
from arfjax.numerics.hankel import hankel_basis
from arfjax.transducer import FocusedBowl

APERTURE, HOLE, FOCAL = 32e-3, 10e-3, 62.6e-3
BOWL = FocusedBowl(APERTURE, HOLE, FOCAL)
FREQUENCY, DENSITY, SOUND_SPEED = 1.1e6, 1000.0, 1482.0
IMPEDANCE = DENSITY * SOUND_SPEED
WAVENUMBER = 2.0 * np.pi * FREQUENCY / SOUND_SPEED
COMPLEX_WAVENUMBER = jnp.asarray(WAVENUMBER + 0j)
RADII = np.array([0.0, 1e-3, 10e-3, 31.9e-3, 45e-3, 60e-3])
"""Of many tests: as many each time, since every new shape is compiled anew."""
BASIS = hankel_basis(256, 62e-3)


def axial_wavenumber(basis=BASIS, diffraction=ExactOneWay()):  # noqa: B008  frozen and without state
    return diffraction.axial_wavenumber(COMPLEX_WAVENUMBER[None], jnp.asarray(basis.wavenumbers))


def series(source, basis=BASIS, plane=12e-3):
    """Coefficients of a source on its own plane, or of a surface's field on `plane`, faded out beyond 34 mm."""
    if isinstance(source, PlaneSource):
        return source.series(1.0, COMPLEX_WAVENUMBER, basis)
    pressure = source.pressure_on_plane(1.0, COMPLEX_WAVENUMBER, basis.nodes, plane)
    return jnp.asarray(basis.to_series @ (np.asarray(pressure) * np.cos(0.5 * np.pi * _sponge_depth(basis)) ** 2))


def marched(coefficients, distance, r, basis=BASIS, diffraction=ExactOneWay(), step=0.5e-3):  # noqa: B008
    """The field (r, z) at ascending distances from the plane, in water with a sponge, by plain numpy."""
    axial, rate = np.asarray(axial_wavenumber(basis, diffraction)[0]), 400.0 / basis.radius * _sponge_depth(basis) ** 2
    coefficients, columns, position = np.asarray(coefficients), [], 0.0
    for end in distance:
        count = max(1, int(np.ceil((end - position) / step)))
        length, position = (end - position) / count, end
        half, sponge = np.exp(-0.5j * length * axial), np.exp(-length * rate)
        for _ in range(count):
            coefficients = half * (basis.to_series @ (sponge * (basis.from_series @ (half * coefficients))))
        columns.append(basis.evaluation_matrix(r) @ coefficients)
    return np.stack(columns, axis=1)


def _sponge_depth(basis):
    return np.clip((basis.nodes / basis.radius - 0.55) / 0.42, 0.0, 1.0)


def rayleigh(r, plane, wavenumber, profile, n=240):
    """Direct sum over a surface: `profile(points on [0, 1])` gives radius, depth, length and weight of its rings."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    ring, depth, length, weight = (values[:, None] for values in profile(0.5 * (nodes + 1.0)))
    around = ((np.arange(500) + 0.5) / 500 * np.pi)[None, :]
    distance = np.sqrt((r - ring * np.cos(around)) ** 2 + (ring * np.sin(around)) ** 2 + (plane - depth) ** 2)
    area = weight * length * 0.5 * weights[:, None] * ring * 2.0 * np.pi / 500
    return 0.5j * wavenumber.real / np.pi * np.sum(area * np.exp(-1j * wavenumber * distance) / distance)


def bowl_profile(weight=np.ones_like, start=HOLE, stop=APERTURE):
    """Rings of the bowl between two radii, weighted by a function of the radius."""

    def profile(points):
        first, last = np.arcsin(start / FOCAL), np.arcsin(stop / FOCAL)
        angle = first + (last - first) * points
        ring = FOCAL * np.sin(angle)
        return ring, FOCAL * (1.0 - np.cos(angle)), np.full_like(ring, FOCAL * (last - first)), weight(ring)

    return profile
