"""The transducer: a spherical bowl with a central hole, and how it is driven."""

import abc
import math

import equinox as eqx
import jax.numpy as jnp

from arfjax.errors import InputError
from arfjax.media import Scalar


class Radiator(eqx.Module):
    """Whatever a drive can drive."""

    @property
    @abc.abstractmethod
    def area(self) -> Scalar:
        """Area S [m^2] by which the source pressure p0 sends out the power p0^2 S / (2 Z)."""

    @property
    def peak_pressure(self) -> Scalar | None:
        """Source pressure of a source that was measured [Pa]; None for others."""
        return None


class FocusedBowl(Radiator):
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
    """A source driven to a given acoustic power.

    Differentiable for powers above 0: pressure goes as the square root, whose slope at 0 is infinite.

    Attributes:
        frequency: [Hz].
        acoustic_power: Power that leaves the source [W].
    """

    frequency: Scalar
    acoustic_power: Scalar

    def source_pressure(self, source: Radiator, impedance: Scalar) -> Scalar:
        """Peak pressure on the source's surface [Pa] that sends out the acoustic power.

        Every point of the surface is taken to radiate like a plane wave into a fluid of characteristic impedance
        `impedance` [Pa s/m]: p0 = sqrt(2 Z P / S). For bowls many wavelengths wide that holds within a few per mille.
        """
        return jnp.sqrt(2.0 * impedance * self.acoustic_power / source.area)


class PressureDrive(eqx.Module):
    """A source driven to a given source pressure.

    Attributes:
        frequency: [Hz].
        pressure: Peak pressure on the surface, rho c u, or what the source takes for it [Pa]; None leaves a measured
            source as it was measured.
    """

    frequency: Scalar
    pressure: Scalar | None = None

    def source_pressure(self, source: Radiator, impedance: Scalar) -> Scalar:
        """The pressure itself [Pa], whatever the fluid's impedance.

        Raises:
            InputError: if none was given and the source knows none.
        """
        del impedance
        if self.pressure is not None:
            return self.pressure
        if source.peak_pressure is None:
            raise InputError("a `PressureDrive` needs a pressure [Pa]: only a measured source brings its own.")
        return source.peak_pressure
