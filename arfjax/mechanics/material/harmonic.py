r"""Viscoelastic solids as seen by a motion that is harmonic in time: complex shear moduli at the Gauss points.

The time convention is exp(+i omega t): storage modulus plus i times loss modulus. The volume answers elastically.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from arfjax.mechanics.material.complex_modulus import complex_modulus, complex_shear_field
from arfjax.mechanics.material.viscoelastic import FieldOrScalar, ModulusReading, ViscoelasticField
from arfjax.media import Prony, Scalar, Solid


class HarmonicMaterial(eqx.Module):
    """A solid whose complex shear modulus is known at any frequency; derive from it for other solids."""

    @abc.abstractmethod
    def at_frequency(self, angular_frequency: Scalar) -> "HarmonicField":
        """The solid at an angular frequency [rad/s]."""


class HarmonicField(HarmonicMaterial):
    """A solid at one frequency, on the tensor grid of Gauss points of a mesh; used at others, it stays as it is.

    Attributes:
        density: [kg/m^3].
        bulk_modulus: [Pa].
        shear_modulus: Storage modulus plus i times loss modulus [Pa].
    """

    density: Float[Array, "rq zq"]
    bulk_modulus: Float[Array, "rq zq"]
    shear_modulus: Complex[Array, "rq zq"]

    def at_frequency(self, angular_frequency: Scalar) -> "HarmonicField":
        """The same solid."""
        return self


class SolidField(HarmonicMaterial):
    """Any solid with its exact complex modulus; `solid_field` makes one.

    Attributes:
        density: [kg/m^3].
        bulk_modulus: [Pa].
        solid: Constants as measured, numbers or fields.
        reading: Which modulus was measured.
        poisson_ratio: Of the reading [1].
    """

    density: Float[Array, "rq zq"]
    bulk_modulus: Float[Array, "rq zq"]
    solid: Solid
    reading: ModulusReading
    poisson_ratio: Scalar

    def at_frequency(self, angular_frequency: Scalar) -> HarmonicField:
        """The solid at an angular frequency [rad/s]."""
        n_r, n_z = self.density.shape
        shear = complex_shear_field(
            self.solid, (n_r, n_z), angular_frequency, reading=self.reading, poisson_ratio=self.poisson_ratio
        )
        return HarmonicField(self.density, self.bulk_modulus, shear)


def solid_field(
    solid: Solid,
    shape: tuple[int, int],
    *,
    density: FieldOrScalar,
    bulk_modulus: FieldOrScalar,
    reading: ModulusReading,
    poisson_ratio: Scalar,
) -> SolidField:
    """A solid at the Gauss points, as `viscoelastic_field` takes it, without the sum of exponentials.

    Args:
        solid: Constants as measured, numbers or fields; of any kind.
        shape: Number of Gauss points, radial and axial.
        density: [kg/m^3], a number or a field.
        bulk_modulus: [Pa], a number or a field; `reading.bulk_modulus` gives it from a modulus.
        reading: Which modulus was measured.
        poisson_ratio: Of the reading [1]; the same at all frequencies.
    """
    density, bulk_modulus = (
        jnp.broadcast_to(jnp.asarray(value, dtype=float), shape) for value in (density, bulk_modulus)
    )
    return SolidField(density, bulk_modulus, solid, reading, poisson_ratio)


def harmonic_field(material: HarmonicMaterial | ViscoelasticField, angular_frequency: Scalar) -> HarmonicField:
    """A solid at one frequency: its own complex modulus, or that of the sum of exponentials of a transient run.

    Args:
        material: The solid; a `ViscoelasticField` is exactly what `solve_push` moves, a `SolidField` has no error of a
            sum of exponentials.
        angular_frequency: [rad/s], not negative.

    Accuracy and differentiability: those of `complex_modulus`.
    """
    if isinstance(material, HarmonicMaterial):
        return material.at_frequency(angular_frequency)
    branches = Prony(material.relaxed_shear_modulus, material.branch_shear_moduli, material.relaxation_times)
    return HarmonicField(material.density, material.bulk_modulus, complex_modulus(branches, angular_frequency))


def shear_wavelength(field: HarmonicField, frequency: Scalar) -> Float[np.ndarray, "rq zq"] | Float[Array, "rq zq"]:
    """Length [m] of shear waves of a frequency [Hz] at each Gauss point, for choosing elements and layers."""
    wave_number = 2.0 * jnp.pi * frequency * jnp.sqrt(field.density / field.shear_modulus)
    return 2.0 * jnp.pi / wave_number.real
