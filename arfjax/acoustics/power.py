"""The power that a field carries through a plane, and where it goes."""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from arfjax.acoustics.field import HarmonicField
from arfjax.media import Scalar
from arfjax.numerics.hankel import HankelBasis


def power_through_plane(
    amplitude: Complex[Array, "harmonic mode"],
    axial_wavenumber: Complex[Array, "harmonic mode"],
    basis: HankelBasis,
    density: Scalar,
    frequency: Float[Array, " harmonic"],
) -> Float[Array, " harmonic"]:
    r"""Power [W] of each harmonic through the plane on which its Bessel series is given.

    $$ P = \pi \sum_m N_m |a_m|^2 \mathrm{Re}(k_{z,m}) / (\rho \omega) $$

    with the norms N_m of the terms: every component counts with the cosine of its own angle, what is beyond grazing
    not at all.

    Args:
        amplitude: Coefficients of the series [Pa].
        axial_wavenumber: Of each term [rad/m], by `ExactOneWay`; other operators have other cosines.
        basis: Whose series.
        density: Of the medium [kg/m^3].
        frequency: Of each harmonic [Hz].

    Accuracy: exact, the medium's loss within a wavelength aside.
    """
    square = amplitude.real**2 + amplitude.imag**2
    flux = jnp.sum(jnp.asarray(basis.norms, dtype=float)[None, :] * square * axial_wavenumber.real, axis=1)
    return math.pi * flux / (density * 2.0 * math.pi * frequency)


def plane_wave_power(
    amplitude: Complex[Array, "harmonic mode"], basis: HankelBasis, impedance: Scalar
) -> Float[Array, " harmonic"]:
    """Power [W] of each harmonic as if all of it crossed the plane at right angles: the integral of p^2 / (2 Z).

    It is too large, by a few percent for a bowl of F/1, and components beyond grazing count. Other programs set their
    source by it.

    Args:
        amplitude: Coefficients of the series [Pa].
        basis: Whose series.
        impedance: Density times sound speed [Pa s/m].
    """
    square = amplitude.real**2 + amplitude.imag**2
    return math.pi * jnp.sum(jnp.asarray(basis.norms, dtype=float)[None, :] * square, axis=1) / impedance


class PowerBudget(eqx.Module):
    """Where the power of a beam goes, layer by layer up to the last axial position of the field.

    Attributes:
        entering: Behind each layer's front, or the start plane [W].
        leaving: In front of each layer's back, or the last position [W].
        reflected: What does not get past each layer's front [W]. As the march reflects at all angles what it would at
            normal incidence, refraction adds to it or makes up for it, and it may be below zero. 0 for the first
            layer.
        lost: Absorbed, scattered or sent out sideways inside each layer [W].
    """

    entering: Float[Array, " layer"]
    leaving: Float[Array, " layer"]
    reflected: Float[Array, " layer"]
    lost: Float[Array, " layer"]


def power_budget(field: HarmonicField) -> PowerBudget:
    """Where a field's power goes; the entering power is the sum of all that is lost, reflected and leaves at last."""
    entering, leaving = field.layer_power[:, 0], field.layer_power[:, 1]
    reflected = jnp.concatenate([jnp.zeros_like(leaving[:1]), leaving[:-1] - entering[1:]])
    return PowerBudget(entering, leaving, reflected, entering - leaving)
