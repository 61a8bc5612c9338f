"""What every source of the march can tell: where it is, how much power it sends, and its field on a plane."""

import abc
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Complex, Float

from arfjax.acoustics.layers import SAME_POSITION
from arfjax.errors import InputError
from arfjax.media import Scalar
from arfjax.numerics.bessel import bessel_j0
from arfjax.numerics.hankel import HankelBasis
from arfjax.numerics.precision import constant
from arfjax.numerics.quadrature import gauss_legendre
from arfjax.transducer import Radiator

Radii = Float[np.ndarray, " r"] | Float[Array, " r"]


class Source(Radiator):
    """Something on the axis that sends sound forward, symmetric about the axis.

    Its strength is one number, the source pressure [Pa], which a drive computes from the source's `area`.
    """

    @property
    @abc.abstractmethod
    def aperture_radius(self) -> Scalar:
        """Radius of the outermost point that radiates [m]."""

    @property
    @abc.abstractmethod
    def depth(self) -> Scalar:
        """Axial position of the foremost point [m]; the march starts beyond it, for a `PlaneSource` on it."""

    @abc.abstractmethod
    def check(self) -> None:
        """Raise `InputError` where concrete dimensions make no sense; traced ones pass."""

    @abc.abstractmethod
    def steepening_length(self, r: Radii, plane: float) -> Float[Array, " r"]:
        """Length along which sound that crosses the plane [m] at radii `r` has steepened before [m].

        It is the integral of the pressure along the ray from the source over the pressure on the plane, the amplitude
        of the ray being that of geometrical acoustics.
        """

    @abc.abstractmethod
    def pressure_on_plane(
        self,
        source_pressure: Scalar,
        wavenumber: Complex[Array, ""],
        r: Radii,
        plane: float,
        *,
        n_quadrature: int = 320,
    ) -> Complex[Array, " r"]:
        """Pressure [Pa] at radii `r` on a plane, in a uniform medium.

        Args:
            source_pressure: Strength of the source [Pa].
            wavenumber: k = omega / c - i alpha [rad/m].
            r: Radii [m].
            plane: Axial position of the plane [m]: beyond a surface that radiates, that of a source on a plane.
            n_quadrature: Gauss points of the source's integrals.
        """


class PlaneSource(Source):
    """A field given on a plane, zero outside one ring or disc on which it is smooth.

    At its rim the field may jump. Sampled at nodes such a field would start the march with errors of first order in
    their spacing. `series` integrates over the smooth piece instead: every coefficient is right, and leaving out the
    higher ones leaves out evanescent waves only, once pi n_modes / radius exceeds the wavenumber.
    """

    plane: eqx.AbstractVar[float]

    @property
    def depth(self) -> float:
        """Axial position of the plane [m]."""
        return self.plane

    def steepening_length(self, r: Radii, plane: float) -> Float[Array, " r"]:
        """None: the march starts where the field is given."""
        del plane
        return jnp.zeros(len(r))

    @abc.abstractmethod
    def extent(self, limit: float) -> tuple[Scalar, Scalar]:
        """Inner and outer radius of where the field is not zero [m], `limit` being the radius of the domain."""

    @abc.abstractmethod
    def pressure_at(
        self, source_pressure: Scalar, wavenumber: Complex[Array, ""], r: Float[Array, " r"]
    ) -> Complex[Array, " r"]:
        """Pressure [Pa] at radii within the extent [m]."""

    def pressure_on_plane(
        self,
        source_pressure: Scalar,
        wavenumber: Complex[Array, ""],
        r: Radii,
        plane: float,
        *,
        n_quadrature: int = 320,
    ) -> Complex[Array, " r"]:
        """Pressure [Pa] at radii `r` on the source's own plane; `n_quadrature` is not needed.

        Raises:
            InputError: for another plane.
        """
        del n_quadrature
        if abs(plane - self.plane) > SAME_POSITION:
            raise InputError(f"the source is given on the plane {self.plane} m, not on {plane} m. March from there.")
        radii = jnp.asarray(r, dtype=float)
        inner, outer = self.extent(math.inf)
        # Outside the extent the field is asked for at its edge: nothing there may spoil the gradient.
        inside = (radii >= inner) & (radii <= outer)
        pressure = self.pressure_at(source_pressure, wavenumber, jnp.clip(radii, inner, outer))
        return jnp.where(inside, pressure, 0.0)

    def series(
        self, source_pressure: Scalar, wavenumber: Complex[Array, ""], basis: HankelBasis, *, n_quadrature: int = 320
    ) -> Complex[Array, " mode"]:
        """Coefficients of the Bessel series of the field [Pa], by Gauss quadrature over its extent.

        Args:
            source_pressure: Strength of the source [Pa].
            wavenumber: k = omega / c - i alpha [rad/m].
            basis: Whose series; its disc must hold the source.
            n_quadrature: Gauss points for the field itself; as many as the basis has terms are added for the terms.

        Accuracy: rounding, where the points resolve the field's own phase: half of it in radians, and 30 more.
        Differentiability: in whatever the field depends on, its rims included.
        """
        nodes, weights = map(constant, gauss_legendre(n_quadrature + len(basis.norms)))
        inner, outer = self.extent(basis.radius)
        half_width = 0.5 * (outer - inner)
        radii = inner + half_width * (nodes + 1.0)
        pressure = self.pressure_at(source_pressure, wavenumber, radii)
        bessel = bessel_j0(constant(basis.wavenumbers)[:, None] * radii[None, :])
        weighted = half_width * weights * radii * pressure
        # Real and imaginary part apart: half the work of a complex table.
        integrals = jnp.stack([weighted.real, weighted.imag]) @ bessel.T
        return (integrals[0] + 1j * integrals[1]) / constant(basis.norms)


def concrete(value: Scalar) -> float:
    """The value as a number, NaN (for which every comparison fails) where it is traced."""
    return math.nan if isinstance(value, Tracer) else float(value)
