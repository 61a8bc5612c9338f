"""A flat piston."""

import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from arfjax.acoustics.sources.apodisation import Apodisation
from arfjax.acoustics.sources.base import Radii, Source, concrete
from arfjax.acoustics.sources.rings import Rings, composite_gauss, radiated_pressure
from arfjax.errors import InputError
from arfjax.media import Scalar

_AREA_POINTS = 64


class Piston(Source):
    """A flat disc or ring on the plane z = 0 in a rigid baffle, by the Rayleigh integral, which is exact for it.

    Attributes:
        radius: [m].
        hole_radius: Radius of the central hole, 0 for none [m].
        apodisation: How its normal velocity varies with the radius; uniform where None.
    """

    radius: Scalar
    hole_radius: Scalar = 0.0
    apodisation: Apodisation | None = None

    @property
    def aperture_radius(self) -> Scalar:
        """Radius of the disc [m]."""
        return self.radius

    @property
    def depth(self) -> float:
        """The plane of the disc [m]."""
        return 0.0

    @property
    def area(self) -> Scalar:
        """Area of the disc [m^2], counted by the square of the amplitude."""
        return self._rings(_AREA_POINTS).area

    def check(self) -> None:
        """Raise `InputError` where concrete dimensions make no sense; traced ones pass."""
        hole, radius = concrete(self.hole_radius), concrete(self.radius)
        if hole < 0.0 or hole >= radius or radius <= 0.0:
            raise InputError(f"a piston needs 0 <= hole_radius < radius, got {hole} and {radius} m.")
        if self.apodisation is not None:
            self.apodisation.check_covers(self.hole_radius, self.radius)

    def steepening_length(self, r: Radii, plane: float) -> Float[Array, " r"]:
        """The distance of the plane: plane waves leave the disc."""
        return jnp.full(len(r), plane)

    def pressure_on_plane(
        self,
        source_pressure: Scalar,
        wavenumber: Complex[Array, ""],
        r: Radii,
        plane: float,
        *,
        n_quadrature: int = 320,
    ) -> Complex[Array, " r"]:
        """Pressure [Pa] at radii `r` on a plane at least a wavelength before the disc; see `radiated_pressure`."""
        rings = self._rings(n_quadrature // 2)
        return radiated_pressure(rings, 0.0, source_pressure, wavenumber, r, plane, n_quadrature=n_quadrature)

    def _rings(self, n: int) -> Rings:
        hole, rim = (jnp.asarray(value, dtype=float) for value in (self.hole_radius, self.radius))
        apodisation = self.apodisation
        edges = jnp.stack([hole, rim]) if apodisation is None else apodisation.edges(hole, rim)
        counts = (n,) if apodisation is None else apodisation.counts(n)
        radius, width = composite_gauss(edges, counts)
        weight = jnp.ones_like(radius) if apodisation is None else apodisation.weight(radius, counts)
        return Rings(radius, jnp.zeros_like(radius), width, weight)
