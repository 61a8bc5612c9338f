"""The transducer: a spherical bowl with a central hole, and how it is driven."""

import math

import equinox as eqx
import jax.numpy as jnp

from arfjax.media import Scalar


class FocusedBowl(eqx.Module):
    """A spherical bowl whose apex is the origin of z and whose axis is the z axis.

    Attributes:
        aperture_radius: Radius of the rim [m].
        hole_radius: Radius of the central hole, 0 for none [m].
        focal_length: Radius of curvature, which is the distance from apex to geometric focus [m].
    """

    aperture_radius: Scalar
    hole_radius: Scalar
    focal_length: Scalar

    @property
    def rim_depth(self) -> Scalar:
        """Axial position of the plane through the rim [m]."""
        return self.focal_length - jnp.sqrt(self.focal_length**2 - self.aperture_radius**2)

    @property
    def area(self) -> Scalar:
        """Area of the radiating cap [m^2]."""
        hole_depth = self.focal_length - jnp.sqrt(self.focal_length**2 - self.hole_radius**2)
        return 2.0 * math.pi * self.focal_length * (self.rim_depth - hole_depth)


class Drive(eqx.Module):
    """How the bowl is driven.

    Attributes:
        frequency: [Hz].
        acoustic_power: Power that leaves the bowl [W].
    """

    frequency: Scalar
    acoustic_power: Scalar

    def source_pressure(self, bowl: FocusedBowl, impedance: Scalar) -> Scalar:
        """Peak pressure on the bowl's surface [Pa] that sends out the acoustic power.

        Every point of the bowl is taken to radiate like a plane wave into a fluid of characteristic impedance
        `impedance` [Pa s/m]: p0 = sqrt(2 Z P / S). For bowls many wavelengths wide that holds within a few per mille.
        """
        return jnp.sqrt(2.0 * impedance * self.acoustic_power / bowl.area)
