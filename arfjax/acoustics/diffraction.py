"""How fast a plane-wave component advances along the axis: the choice of diffraction operator.

The march is diagonal in radial wavenumber: a step of length dz multiplies each component by exp(-i k_z dz). An operator
is the rule for k_z. The approximate ones are functions of s = kappa^2 / (Re k)^2, the squared sine of the angle.
"""

import abc
import math
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

_GRAZING_LOSS = 1e-12
"""Relative loss in k^2 that keeps the square root away from zero and on the decaying side in a lossless medium.

It takes 1e-10 of a wave's amplitude over 80 wavelengths.
"""

_STEEPEST = 0.6
"""Cosine of the largest angle of whose path the march takes account, 53 degrees: near grazing the path has no end. Of
bowls deeper than F/0.63 the outermost rays steepen as if they came from there."""


class Diffraction(eqx.Module):
    """Rule for the axial wavenumber."""

    @abc.abstractmethod
    def axial_wavenumber(
        self,
        wavenumber: Complex[Array, " harmonic"],
        radial_wavenumber: Float[Array, " mode"],
        lossless: Float[Array, " harmonic"] | None = None,
    ) -> Complex[Array, "harmonic mode"]:
        """Axial wavenumber k_z [rad/m], with an imaginary part that is never positive.

        Args:
            wavenumber: k = omega / c - i alpha [rad/m].
            radial_wavenumber: [rad/m].
            lossless: omega / c without dispersion [rad/m], from which operators that absorb along the axis take the
                angle; None for Re k.
        """

    def path(
        self, wavenumber: Float[Array, " harmonic"], radial_wavenumber: Float[Array, " mode"]
    ) -> Float[Array, "harmonic mode"] | None:
        """Path of each component per axial distance [1], along which it steepens; None for 1: along the axis."""
        del wavenumber, radial_wavenumber
        return None


class ExactOneWay(Diffraction):
    """The one-way Helmholtz operator k_z = sqrt(k^2 - kappa^2): no limit on angle.

    Components beyond grazing decay.

    Attributes:
        absorption_along_ray: Whether absorption acts along each component's own path; otherwise along the axis, as
            other codes have it, and dispersion with it: k_z = sqrt(k_0^2 - kappa^2) + k - k_0, k_0 without either.
        steepening_along_ray: Whether steepening, and what varies within a layer, acts along each component's path, as
            Westervelt's equation has it; along the axis, as in the KZK equation, a bowl as deep as its aperture makes
            7 percent too little of the second harmonic at its focus.
    """

    absorption_along_ray: bool = eqx.field(static=True, default=True)
    steepening_along_ray: bool = eqx.field(static=True, default=True)

    def axial_wavenumber(
        self,
        wavenumber: Complex[Array, " harmonic"],
        radial_wavenumber: Float[Array, " mode"],
        lossless: Float[Array, " harmonic"] | None = None,
    ) -> Complex[Array, "harmonic mode"]:
        """The square root with positive real and negative imaginary part [rad/m]."""
        k, kappa = wavenumber[:, None], radial_wavenumber[None, :]
        along_axis = 0.0 * k if self.absorption_along_ray else k - _lossless(wavenumber, lossless)
        k = k - along_axis
        return jnp.sqrt((k - kappa) * (k + kappa) - 1j * _GRAZING_LOSS * (k * jnp.conj(k)).real) + along_axis

    def path(
        self, wavenumber: Float[Array, " harmonic"], radial_wavenumber: Float[Array, " mode"]
    ) -> Float[Array, "harmonic mode"] | None:
        """1 / cos(angle to the axis), held beyond `_STEEPEST`."""
        if not self.steepening_along_ray:
            return None
        sine = radial_wavenumber[None, :] / wavenumber[:, None]
        return 1.0 / jnp.sqrt(1.0 - jnp.minimum(sine**2, 1.0 - _STEEPEST**2))


class Parabolic(Diffraction):
    """The KZK operator k_z = k - kappa^2 / (2 k_0): small angles only, absorption along the axis.

    For a bowl as deep as its aperture the focus comes out too strong and too far: 6 % and 5 mm at F/1.
    """

    def axial_wavenumber(
        self,
        wavenumber: Complex[Array, " harmonic"],
        radial_wavenumber: Float[Array, " mode"],
        lossless: Float[Array, " harmonic"] | None = None,
    ) -> Complex[Array, "harmonic mode"]:
        """The parabola [rad/m]."""
        k, kappa = wavenumber[:, None], radial_wavenumber[None, :]
        return k - kappa**2 / (2.0 * _lossless(wavenumber, lossless))


class Pade11(Diffraction):
    """First-order rational approximation, k_z = k_0 (1 - 3 s / 4) / (1 - s / 4): too large by s^3 / 32.

    Absorption acts along the axis. For a bowl as deep as its aperture the peak pressure is 1 % too large.
    """

    def axial_wavenumber(
        self,
        wavenumber: Complex[Array, " harmonic"],
        radial_wavenumber: Float[Array, " mode"],
        lossless: Float[Array, " harmonic"] | None = None,
    ) -> Complex[Array, "harmonic mode"]:
        """The ratio up to its zero at s = 4 / 3, decay beyond [rad/m]."""
        return _rational(
            wavenumber, radial_wavenumber, lossless, lambda s: (1.0 - 0.75 * s) / (1.0 - 0.25 * s), 4.0 / 3.0
        )


class Pade12(Diffraction):
    """Second-order rational approximation, k_z = k_0 (1 - s + s^2 / 8) / (1 - s / 2): too large by s^4 / 128.

    The limit, as the step goes to zero, of the propagator with numerator of first and denominator of second order in s
    that wide-angle beam codes call Pade(1,2). Absorption acts along the axis.
    """

    def axial_wavenumber(
        self,
        wavenumber: Complex[Array, " harmonic"],
        radial_wavenumber: Float[Array, " mode"],
        lossless: Float[Array, " harmonic"] | None = None,
    ) -> Complex[Array, "harmonic mode"]:
        """The ratio up to its zero at s = 4 - sqrt(8), decay beyond [rad/m]."""
        return _rational(
            wavenumber,
            radial_wavenumber,
            lossless,
            lambda s: (1.0 - s + 0.125 * s**2) / (1.0 - 0.5 * s),
            4.0 - math.sqrt(8.0),
        )


def _rational(
    wavenumber: Complex[Array, " harmonic"],
    radial_wavenumber: Float[Array, " mode"],
    lossless: Float[Array, " harmonic"] | None,
    ratio: Callable[[Array], Array],
    zero: float,
) -> Complex[Array, "harmonic mode"]:
    """k_0 ratio(s) + k - k_0; past the first `zero` of the ratio, where its pole lies, components decay instead."""
    k, k_0 = wavenumber[:, None], _lossless(wavenumber, lossless)
    s = (radial_wavenumber[None, :] / k_0) ** 2
    propagating = jnp.minimum(s, zero)
    return k_0 * (ratio(propagating) - 1j * (s - propagating)) + k - k_0


def _lossless(
    wavenumber: Complex[Array, " harmonic"], lossless: Float[Array, " harmonic"] | None
) -> Float[Array, "harmonic 1"]:
    return (wavenumber.real if lossless is None else lossless)[:, None]
