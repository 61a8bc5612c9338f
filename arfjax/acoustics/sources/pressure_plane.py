"""A measured field as the source: a hologram, or a hydrophone's scan across the axis."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Complex, Float

from arfjax.acoustics.sources.base import PlaneSource
from arfjax.acoustics.sources.positions import as_radii
from arfjax.errors import InputError
from arfjax.media import Scalar
from arfjax.numerics.hankel import HankelBasis
from arfjax.numerics.quadrature import gauss_legendre
from arfjax.numerics.radial_spline import even_spline_matrix

_DIED_OUT = 0.03
"""Largest pressure at the last radius, relative to the largest of all, that is no sign of a scan cut short."""

_POINTS = 4
"""Gauss points between two samples, beyond one for every radian of the series' last term: exact to rounding."""


class PressurePlane(PlaneSource):
    """Complex pressure sampled at radii on a plane; zero beyond the last.

    Between samples it is the cubic spline that is even in r: linear in the data, of fourth order, and as smooth across
    the axis as a field is. Complex values are interpolated as they are, so the spacing must resolve the shortest radial
    wavelength, the wavelength over the sine of the steepest angle. Of a bowl of F/1, scanned before its rim, nine
    samples to it give the focus within 2e-4 of its pressure, six within 1e-3, four within 4e-3.

    The source pressure is what the largest measured magnitude is scaled to; a `PressureDrive` without a pressure
    leaves the data as measured.

    Attributes:
        radius: Concrete radii of the samples, ascending, from the axis or half a spacing off it [m].
        pressure: Complex peak amplitude at them [Pa], time going as exp(+i omega t).
        plane: Axial position of the plane [m].
        taper: Outer part of the radius over which the data are faded out by a squared cosine, from 0 to 1; for data
            that have not died out at the last radius.

    Raises:
        InputError: if radii are not ascending or miss the axis, if pressures do not fit them, are not finite, or are
            cut off at the last radius (as far as they are concrete).
    """

    radius: tuple[float, ...] = eqx.field(static=True, converter=as_radii)
    pressure: Complex[Array, " _"] | Complex[np.ndarray, " _"]
    plane: float = eqx.field(static=True)
    taper: float = eqx.field(static=True, default=0.0)

    def __check_init__(self) -> None:
        """Refuse data that cannot be meant."""
        spacing = np.diff(self.radius)
        if np.any(spacing <= 0.0):
            raise InputError(f"`radius` of a pressure plane must ascend [m], got {np.asarray(self.radius)}.")
        if self.radius[0] > spacing.max():
            raise InputError(f"a pressure plane must begin at the axis or a spacing off it, not at {self.radius[0]} m.")
        if not 0.0 <= self.taper <= 1.0:
            raise InputError(f"`taper` is a part of the radius from 0 to 1, got {self.taper}.")
        if len(self.pressure) != len(self.radius):
            raise InputError(
                f"`pressure` of a pressure plane has {len(self.pressure)} values for {len(self.radius)} radii."
            )
        if not isinstance(self.pressure, Tracer):
            _check_values(np.abs(np.asarray(self.pressure)), self.taper)

    @property
    def aperture_radius(self) -> float:
        """The last radius [m]."""
        return self.radius[-1]

    @property
    def peak_pressure(self) -> Scalar:
        """Largest magnitude of the samples [Pa]: the source pressure that leaves them as measured."""
        return jnp.max(jnp.abs(self.pressure))

    @property
    def area(self) -> Scalar:
        """Integral of (p / p_0)^2 over the plane [m^2].

        As for plane waves, which near a strongly focused bowl is several percent too much: for its true power measure
        `power_through_plane` once, and scale the pressure.
        """
        points, weights = self._points(0.0)
        pressure = self._sampling(points) @ self._relative()
        power = jnp.asarray(weights * points, dtype=float) * (pressure.real**2 + pressure.imag**2)
        return 2.0 * np.pi * jnp.sum(power)

    def check(self) -> None:
        """Nothing is left to check: the data were when they came."""

    def extent(self, limit: float) -> tuple[float, float]:
        """From the axis to the last radius [m]."""
        del limit
        return 0.0, self.radius[-1]

    def pressure_at(
        self, source_pressure: Scalar, wavenumber: Complex[Array, ""], r: Float[Array, " r"]
    ) -> Complex[Array, " r"]:
        """The spline through the samples [Pa], at concrete radii."""
        del wavenumber
        if isinstance(r, Tracer):
            raise InputError("a pressure plane is interpolated to concrete radii only.")
        return source_pressure * (self._sampling(np.asarray(r, dtype=float)) @ self._relative())

    def series(
        self, source_pressure: Scalar, wavenumber: Complex[Array, ""], basis: HankelBasis, *, n_quadrature: int = 320
    ) -> Complex[Array, " mode"]:
        """Coefficients of the Bessel series of the spline [Pa], exact to rounding.

        `wavenumber` and `n_quadrature` are not needed: the data are what they are, and points lie between samples.
        """
        del wavenumber, n_quadrature
        if self.radius[-1] > basis.radius:
            raise InputError(
                f"a pressure plane of {self.radius[-1]} m does not fit a domain of {basis.radius} m. Enlarge "
                "`domain_radius`, or leave samples out."
            )
        points, weights = self._points(basis.wavenumbers[-1])
        terms = basis.evaluation_matrix(points).T * (weights * points)[None, :]
        matrix = terms @ _tapered(even_spline_matrix(points, np.asarray(self.radius)), points, self)
        return source_pressure * (jnp.asarray(matrix / basis.norms[:, None], dtype=float) @ self._relative())

    def _relative(self) -> Complex[Array, " n"]:
        return jnp.asarray(self.pressure) / self.peak_pressure

    def _sampling(self, points: Float[np.ndarray, " point"]) -> Float[Array, "point n"]:
        spline = even_spline_matrix(np.minimum(points, self.radius[-1]), np.asarray(self.radius))
        return jnp.asarray(_tapered(spline, points, self), dtype=float)

    def _points(self, highest: float) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
        """Gauss points and weights between the samples, for terms of radial wavenumbers up to `highest` [rad/m]."""
        edges = np.append(0.0, np.asarray(self.radius)[1 if self.radius[0] == 0.0 else 0 :])
        count = _POINTS + int(np.ceil(highest * np.diff(edges).max()))
        nodes, weights = gauss_legendre(count)
        half_width = 0.5 * np.diff(edges)[:, None]
        return (edges[:-1, None] + half_width * (nodes + 1.0)).ravel(), (half_width * weights).ravel()


def _check_values(magnitude: Float[np.ndarray, " n"], taper: float) -> None:
    if not np.all(np.isfinite(magnitude)):
        raise InputError(
            f"`pressure` of a pressure plane is not finite at {np.count_nonzero(~np.isfinite(magnitude))} radii. "
            "Leave such samples out."
        )
    if magnitude.max() == 0.0:
        raise InputError("`pressure` of a pressure plane is zero everywhere.")
    if taper == 0.0 and magnitude[-1] > _DIED_OUT * magnitude.max():
        raise InputError(
            f"`pressure` of a pressure plane is {magnitude[-1] / magnitude.max():.0%} of the largest at the last "
            "radius, where it is cut off. Measure farther out, or pass taper=0.2."
        )


def _tapered(
    matrix: Float[np.ndarray, "point n"], points: Float[np.ndarray, " point"], source: PressurePlane
) -> Float[np.ndarray, "point n"]:
    if source.taper == 0.0:
        return matrix
    start = source.radius[-1] * (1.0 - source.taper)
    fade = np.cos(0.5 * np.pi * np.clip((points - start) / (source.radius[-1] - start), 0.0, 1.0)) ** 2
    return matrix * fade[:, None]
