"""The power that a field carries through a plane."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

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
