r"""The bowl as parabolic codes take it: its converging spherical wave, cut off by the rim, on a plane.

$$ p(r) = p_0 \frac{d}{R} \exp(i k (R - d)), \qquad R^2 = r^2 + (d - z)^2 $$

between the rays from hole and rim to the focus, zero elsewhere; d is the focal length, z the plane. What the edges
diffract on the way from the bowl to the plane is left out.

The power is that of the cap at p_0, whatever the plane: a spherical wave of intensity (p_0 d / R)^2 / (2 Z) crosses the
plane at the cosine (d - z) / R. (What the jumps at the edges put beyond grazing is lost of it: 0.9 percent for a bowl
of 64 mm, F/0.98, with a hole of 20 mm at 1.1 MHz.)

This is the source of Soneson's HITU_Simulator, with the plane at the rim and `fade_grazing`. That program takes another
power: the integral of p^2 / (2 Z) after the fading, without the cosine. For the bowl above its source pressure is 3.7
percent smaller for the same power, 209.16 instead of 217.11 kPa at 50 W (209.14 on its grid). As this depends on the
wavelength, it is no area: give such a source pressure by `PressureDrive`; `plane_wave_power` has the rule.
Source: J. E. Soneson, github.com/jsoneson/HITU_Simulator, WAKZK.m and SourceFilterH.m (formulas only).
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Complex, Float

from arfjax.acoustics.sources.base import PlaneSource, concrete
from arfjax.acoustics.sources.radiating_bowl import check_bowl
from arfjax.errors import InputError
from arfjax.media import Scalar
from arfjax.numerics.hankel import HankelBasis
from arfjax.transducer import FocusedBowl

_FADING_RATE, _FADING_SINE = 20.0 / math.pi, 1.15
"""The simulator's filter."""


class ProjectedBowl(PlaneSource):
    """The spherical wave of a bowl on a plane.

    Attributes:
        bowl: The transducer.
        plane: Axial position of the plane [m], before the focus; by default that of the rim, which then must be
            concrete. It stays where it is when the bowl is differentiated or mapped over: the wave moves on it.
        fade_grazing: Whether to fade out the components about and beyond grazing. At the sine s = kappa / k of its
            angle a component keeps (1 - tanh(20 / pi (s - 1.15))) / 2: half of it at 1.15, 0.87 at 1, 0.9997 at 0.5.
            It serves comparisons with HITU_Simulator, and operators under which such components do not decay.
    """

    bowl: FocusedBowl
    plane: float = eqx.field(static=True)
    fade_grazing: bool = eqx.field(static=True)

    def __init__(self, bowl: FocusedBowl, plane: float | None = None, *, fade_grazing: bool = False) -> None:
        """Take the bowl and the plane."""
        self.fade_grazing = fade_grazing
        if plane is None:
            with jax.ensure_compile_time_eval():  # so that plain numbers stay numbers within `jit`
                depth = bowl.rim_depth
            if isinstance(depth, Tracer):
                raise InputError("`plane` of a projected bowl must be given where the bowl's dimensions are traced.")
            plane = float(depth)
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

    def series(
        self, source_pressure: Scalar, wavenumber: Complex[Array, ""], basis: HankelBasis, *, n_quadrature: int = 320
    ) -> Complex[Array, " mode"]:
        """Coefficients of the Bessel series [Pa], faded where wanted; see `PlaneSource.series`."""
        coefficients = super().series(source_pressure, wavenumber, basis, n_quadrature=n_quadrature)
        if not self.fade_grazing:
            return coefficients
        sine = jnp.asarray(basis.wavenumbers, dtype=float) / wavenumber.real
        return coefficients * (0.5 - 0.5 * jnp.tanh(_FADING_RATE * (sine - _FADING_SINE)))

    def _project(self, radius: Scalar) -> Scalar:
        focal = self.bowl.focal_length
        return radius * (focal - self.plane) / jnp.sqrt(focal**2 - radius**2)
