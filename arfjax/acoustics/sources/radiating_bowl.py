"""The true bowl: every point of its surface radiates."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from arfjax.acoustics.sources.apodisation import Apodisation
from arfjax.acoustics.sources.base import Radii, Source, concrete
from arfjax.acoustics.sources.rings import Rings, composite_gauss, radiated_pressure
from arfjax.errors import InputError
from arfjax.media import Scalar
from arfjax.transducer import FocusedBowl

_AREA_POINTS = 64


class RadiatingBowl(Source):
    """A spherical bowl by the Rayleigh integral over its surface.

    Attributes:
        bowl: The transducer.
        apodisation: How its normal velocity varies with the radius; uniform where None.
    """

    bowl: FocusedBowl
    apodisation: Apodisation | None = None

    @property
    def aperture_radius(self) -> Scalar:
        """Radius of the rim [m]."""
        return self.bowl.aperture_radius

    @property
    def depth(self) -> Scalar:
        """Axial position of the rim [m]."""
        return self.bowl.rim_depth

    @property
    def area(self) -> Scalar:
        """Area of the cap [m^2], counted by the square of the amplitude."""
        return self.bowl.area if self.apodisation is None else self._rings(_AREA_POINTS).area

    def check(self) -> None:
        """Raise `InputError` where concrete dimensions make no sense; traced ones pass."""
        check_bowl(self.bowl)
        if self.apodisation is not None:
            self.apodisation.check_covers(self.bowl.hole_radius, self.bowl.aperture_radius)

    def steepening_length(self, r: Radii, plane: float) -> Float[Array, " r"]:
        """R ln(F / R), R being the distance from the focus: the pressure of a converging wave grows as 1 / R."""
        radii, focal = jnp.asarray(r, dtype=float), jnp.asarray(self.bowl.focal_length, dtype=float)
        distance = jnp.sqrt(radii**2 + (focal - plane) ** 2)
        return distance * jnp.maximum(jnp.log(focal / distance), 0.0)

    def pressure_on_plane(
        self,
        source_pressure: Scalar,
        wavenumber: Complex[Array, ""],
        r: Radii,
        plane: float,
        *,
        n_quadrature: int = 320,
    ) -> Complex[Array, " r"]:
        """Pressure [Pa] at radii `r` on a plane at least a wavelength beyond the rim; see `radiated_pressure`."""
        rings = self._rings(n_quadrature // 2)
        return radiated_pressure(rings, self.depth, source_pressure, wavenumber, r, plane, n_quadrature=n_quadrature)

    def _rings(self, n: int) -> Rings:
        bowl, apodisation = self.bowl, self.apodisation
        hole, rim, focal = (
            jnp.asarray(v, dtype=float) for v in (bowl.hole_radius, bowl.aperture_radius, bowl.focal_length)
        )
        edges = jnp.stack([hole, rim]) if apodisation is None else apodisation.edges(hole, rim)
        counts = (n,) if apodisation is None else apodisation.counts(n)
        angle, width = composite_gauss(jnp.arcsin(edges / focal), counts)
        radius = focal * jnp.sin(angle)
        weight = jnp.ones_like(radius) if apodisation is None else apodisation.weight(radius, counts)
        return Rings(radius, 2.0 * focal * jnp.sin(0.5 * angle) ** 2, focal * width, weight)


def check_bowl(bowl: FocusedBowl) -> None:
    """Raise `InputError` where a bowl's concrete dimensions make no sense; traced ones pass."""
    hole, aperture, focal = map(concrete, (bowl.hole_radius, bowl.aperture_radius, bowl.focal_length))
    if math.isinf(focal):
        raise InputError("`focal_length` of a bowl must be finite [m], got inf. A flat disc is a `Piston`.")
    if hole < 0.0 or hole >= aperture or aperture > focal:
        raise InputError(
            f"a bowl needs 0 <= hole_radius < aperture_radius <= focal_length, got {hole}, {aperture}, {focal} m."
        )


def as_source(source: FocusedBowl | Source) -> Source:
    """The source itself, and for a bowl its true radiation."""
    return RadiatingBowl(source) if isinstance(source, FocusedBowl) else source
