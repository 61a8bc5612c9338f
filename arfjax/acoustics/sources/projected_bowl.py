r"""The bowl as parabolic codes take it: its converging spherical wave, cut off by the rim, on a plane.

$$ p(r) = p_0 \frac{d}{R} \exp(i k (R - d)), \qquad R^2 = r^2 + (d - z)^2 $$

between the rays from hole and rim to the focus, zero elsewhere; d is the focal length, z the plane. What the edges
diffract on the way from the bowl to the plane is left out. In phase and amplitude this is the source of Soneson's
HITU_Simulator, on the plane of the rim; that program then filters out what is beyond grazing, which dies in the march.

The power is that of the cap at p_0, whatever the plane: a spherical wave of intensity (p_0 d / R)^2 / (2 Z) crosses the
plane at the cosine (d - z) / R. HITU_Simulator counts p^2 without that cosine, `plane_wave_area` below, and after its
filter: for a bowl of 64 mm, F/0.98, with a hole of 20 mm its source pressure comes out 3.7 percent smaller for the same
power (4.0 by the area, 0.3 back by the filter). Give such a source pressure directly.
Source: J. E. Soneson, github.com/jsoneson/HITU_Simulator, WAKZK.m (formulas only).
"""

import math

import equinox as eqx
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Complex, Float

from arfjax.acoustics.sources.base import PlaneSource, concrete
from arfjax.acoustics.sources.radiating_bowl import check_bowl
from arfjax.errors import InputError
from arfjax.media import Scalar
from arfjax.transducer import FocusedBowl


class ProjectedBowl(PlaneSource):
    """The spherical wave of a bowl on a plane.

    Attributes:
        bowl: The transducer.
        plane: Axial position of the plane [m], before the focus; by default that of the rim, which then must be
            concrete. It stays where it is when the bowl is differentiated or mapped over: the wave moves on it.
    """

    bowl: FocusedBowl
    plane: float = eqx.field(static=True)

    def __init__(self, bowl: FocusedBowl, plane: float | None = None) -> None:
        """Take the bowl and the plane."""
        if plane is None:
            if isinstance(bowl.rim_depth, Tracer):
                raise InputError("`plane` of a projected bowl must be given where the bowl's dimensions are traced.")
            plane = float(bowl.rim_depth)
        self.bowl = bowl
        self.plane = plane

    @property
    def aperture_radius(self) -> Scalar:
        """Radius of the rim's projection [m]."""
        return self._project(self.bowl.aperture_radius)

    @property
    def area(self) -> Scalar:
        """Area of the cap [m^2]: what crosses the plane, its obliquity counted."""
        return self.bowl.area

    @property
    def plane_wave_area(self) -> Scalar:
        """Integral of (p / p_0)^2 over the plane [m^2], as if every part crossed it at right angles."""
        inner, outer = self.extent(math.inf)
        height = self.bowl.focal_length - self.plane
        ratio = (outer**2 + height**2) / (inner**2 + height**2)
        return math.pi * self.bowl.focal_length**2 * jnp.log(ratio)

    def check(self) -> None:
        """Raise `InputError` where concrete dimensions make no sense; traced ones pass."""
        check_bowl(self.bowl)
        aperture, focal = concrete(self.bowl.aperture_radius), concrete(self.bowl.focal_length)
        if aperture == focal or self.plane >= focal:
            raise InputError(
                f"a bowl of radius {aperture} m and focal length {focal} m cannot be projected onto the plane "
                f"{self.plane} m: its rim must lie before the focus, and the plane too."
            )

    def extent(self, limit: float) -> tuple[Scalar, Scalar]:
        """Radii of hole and rim on the plane [m]."""
        del limit
        return self._project(self.bowl.hole_radius), self.aperture_radius

    def pressure_at(
        self, source_pressure: Scalar, wavenumber: Complex[Array, ""], r: Float[Array, " r"]
    ) -> Complex[Array, " r"]:
        """The spherical wave [Pa], with the phase of the bowl's own surface and what it lost since."""
        focal = self.bowl.focal_length
        distance = jnp.sqrt(r**2 + (focal - self.plane) ** 2)
        # R - d as a quotient of differences of squares: nothing cancels in single precision.
        ahead = (r**2 - self.plane * (2.0 * focal - self.plane)) / (distance + focal)
        return source_pressure * (focal / distance) * jnp.exp(1j * wavenumber * ahead)

    def _project(self, radius: Scalar) -> Scalar:
        focal = self.bowl.focal_length
        return radius * (focal - self.plane) / jnp.sqrt(focal**2 - radius**2)
