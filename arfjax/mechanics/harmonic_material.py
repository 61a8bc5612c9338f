r"""Viscoelastic solids as seen by a motion that is harmonic in time: complex shear moduli at the Gauss points.

The time convention is exp(+i omega t): storage modulus plus i times loss modulus. The volume answers elastically.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from arfjax.mechanics.complex_modulus import complex_modulus
from arfjax.mechanics.viscoelastic import FieldOrScalar, ModulusReading, ViscoelasticField
from arfjax.media import FractionalZener, Scalar, Zener


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


class ZenerField(HarmonicMaterial):
    """A conventional or fractional Zener solid with its exact complex modulus; `zener_field` makes one.

    Attributes:
        density: [kg/m^3].
        bulk_modulus: [Pa].
        solid: Constants of the relaxing shear modulus, each a field.
    """

    density: Float[Array, "rq zq"]
    bulk_modulus: Float[Array, "rq zq"]
    solid: Zener | FractionalZener

    def at_frequency(self, angular_frequency: Scalar) -> HarmonicField:
        """The solid at an angular frequency [rad/s]."""
        flat = jax.tree.map(jnp.ravel, self.solid)
        modulus = jax.vmap(lambda point: complex_modulus(point, angular_frequency))(flat)
        return HarmonicField(self.density, self.bulk_modulus, modulus.reshape(self.density.shape))


def zener_field(
    solid: Zener | FractionalZener,
    shape: tuple[int, int],
    *,
    density: FieldOrScalar,
    bulk_modulus: FieldOrScalar,
    reading: ModulusReading,
    poisson_ratio: Scalar,
) -> ZenerField:
    """A Zener solid at the Gauss points, as `viscoelastic_field` takes it, without the sum of exponentials.

    Args:
        solid: Constants as measured, numbers or fields.
        shape: Number of Gauss points, radial and axial.
        density: [kg/m^3], a number or a field.
        bulk_modulus: [Pa], a number or a field; `reading.bulk_modulus` gives it from a modulus.
        reading: Which modulus was measured.
        poisson_ratio: Of the reading [1]; the same at all frequencies.
    """

    def fill(value: FieldOrScalar) -> Float[Array, "rq zq"]:
        return jnp.broadcast_to(jnp.asarray(value, dtype=float), shape)

    as_shear = eqx.tree_at(
        lambda s: (s.relaxed_modulus, s.unrelaxed_modulus),
        solid,
        (
            reading.shear_modulus(solid.relaxed_modulus, poisson_ratio),
            reading.shear_modulus(solid.unrelaxed_modulus, poisson_ratio),
        ),
    )
    return ZenerField(fill(density), fill(bulk_modulus), jax.tree.map(fill, as_shear))


def harmonic_field(material: HarmonicMaterial | ViscoelasticField, angular_frequency: Scalar) -> HarmonicField:
    r"""A solid at one frequency: its own complex modulus, or that of the sum of exponentials of a transient run.

    $$ G^* = G_0 + \sum_b \Delta G_b \, \frac{i \omega \tau_b}{1 + i \omega \tau_b} $$

    Args:
        material: The solid; a `ViscoelasticField` is exactly what `solve_push` moves, a `ZenerField` has no error of a
            sum of exponentials.
        angular_frequency: [rad/s], not negative.

    Accuracy: rounding, for any product of frequency and relaxation time.
    Differentiability: in every constant and the frequency.
    """
    if isinstance(material, HarmonicMaterial):
        return material.at_frequency(angular_frequency)
    turn = angular_frequency * material.relaxation_times
    branches = material.branch_shear_moduli
    # Below the relaxation frequency in omega tau, above it in its inverse, so that no square overflows.
    below = turn <= 1.0
    small = jnp.where(below, turn, 1.0 / jnp.where(below, 1.0, turn))
    share = 1.0 / (1.0 + small**2)
    storage = material.relaxed_shear_modulus + jnp.sum(branches * share * jnp.where(below, small**2, 1.0), axis=0)
    loss = jnp.sum(branches * share * small, axis=0)
    return HarmonicField(material.density, material.bulk_modulus, jax.lax.complex(storage, loss))


def shear_wavelength(field: HarmonicField, frequency: Scalar) -> Float[np.ndarray, "rq zq"] | Float[Array, "rq zq"]:
    """Length [m] of shear waves of a frequency [Hz] at each Gauss point, for choosing elements and layers."""
    wave_number = 2.0 * jnp.pi * frequency * jnp.sqrt(field.density / field.shear_modulus)
    return 2.0 * jnp.pi / wave_number.real
