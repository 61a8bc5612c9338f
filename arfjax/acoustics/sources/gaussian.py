"""A Gaussian beam where it starts."""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from arfjax.acoustics.sources.base import PlaneSource, concrete
from arfjax.errors import InputError
from arfjax.media import Scalar

_CUT_OFF = 6.0
"""Radii at which the Gaussian, 2e-16 of its centre, is cut off."""

_APERTURE = 3.0
"""Radii within which all but 2e-8 of the power leaves."""


class GaussianSource(PlaneSource):
    """Pressure p_0 exp(-r^2 / radius^2), with the phase of a thin lens where it is focused.

    Attributes:
        radius: Where the pressure is 1/e of that on the axis [m].
        focal_length: Of the lens, whose phase is quadratic in r (the parabolic approximation); inf for none [m].
        plane: Axial position [m].
    """

    radius: Scalar
    focal_length: Scalar = math.inf
    plane: float = eqx.field(static=True, default=0.0)

    @property
    def aperture_radius(self) -> Scalar:
        """Three radii [m]; beyond are 2e-8 of the power."""
        return _APERTURE * self.radius

    @property
    def area(self) -> Scalar:
        """Integral of (p / p_0)^2 [m^2].

        As for plane waves: the power is smaller by (1 / (k radius))^2 + (radius / focal_length)^2 / 4 about.
        """
        return 0.5 * math.pi * self.radius**2

    def check(self) -> None:
        """Raise `InputError` where concrete dimensions make no sense; traced ones pass."""
        radius, focal = concrete(self.radius), concrete(self.focal_length)
        if radius <= 0.0 or focal == 0.0:
            raise InputError(f"a Gaussian source needs a positive radius and a focal length, got {radius}, {focal} m.")

    def extent(self, limit: float) -> tuple[Scalar, Scalar]:
        """From the axis to where the Gaussian is below rounding, or to `limit` [m]."""
        return 0.0, jnp.minimum(_CUT_OFF * self.radius, limit)

    def pressure_at(
        self, source_pressure: Scalar, wavenumber: Complex[Array, ""], r: Float[Array, " r"]
    ) -> Complex[Array, " r"]:
        """The Gaussian [Pa]."""
        exponent = -((r / self.radius) ** 2) + 1j * wavenumber.real * (r * (r / (2.0 * self.focal_length)))
        return source_pressure * jnp.exp(exponent)
