"""How amplitude and phase vary over the surface of a transducer."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Complex, Float

from arfjax.acoustics.sources.base import concrete
from arfjax.acoustics.sources.positions import as_radii
from arfjax.errors import InputError
from arfjax.media import Scalar

_POINTS_MORE = 4
"""Gauss points that every piece between two radii gets beyond its share."""

_SAME_RADIUS = 1e-6
"""By how much [m] the radii may fall short of hole or rim."""


class Apodisation(eqx.Module):
    """Relative amplitude and phase of a surface's normal velocity, linear between radii from the axis.

    A radius given twice is a jump: the first value holds inwards of it, the second outwards. A ring of an array that
    is silent, a kerf, is two such jumps with amplitude 0 between them.

    Attributes:
        radius: Concrete radii of the values, ascending, at most two the same [m]; from the hole to the rim.
        amplitude: Relative to the source pressure [1].
        phase: Ahead of the source's [rad]: the velocity is that of exp(i (omega t + phase)).

    Raises:
        InputError: if radii are not ascending, or values do not fit them or are not finite (as far as concrete).
    """

    radius: tuple[float, ...] = eqx.field(static=True, converter=as_radii)
    amplitude: Float[Array, " _"] | Float[np.ndarray, " _"]
    phase: Float[Array, " _"] | Float[np.ndarray, " _"]

    def __check_init__(self) -> None:
        """Refuse radii and values that cannot be meant."""
        radius = np.asarray(self.radius)
        if np.any(np.diff(radius) < 0.0) or np.any(radius[2:] == radius[:-2]) or radius[0] == radius[-1]:
            raise InputError(
                f"`radius` of an apodisation must ascend [m], with at most two the same for a jump, got {radius}."
            )
        if radius[0] == radius[1] or radius[-1] == radius[-2]:
            raise InputError(f"an apodisation cannot jump at its first or last `radius`, got {radius} m.")
        for name, values in (("amplitude", self.amplitude), ("phase", self.phase)):
            if len(values) != len(radius):
                raise InputError(f"`{name}` of an apodisation has {len(values)} values for {len(radius)} radii.")
            if not isinstance(values, Tracer) and not np.all(np.isfinite(values)):
                raise InputError(f"`{name}` of an apodisation holds values that are not finite.")

    def check_covers(self, hole_radius: Scalar, aperture_radius: Scalar) -> None:
        """Raise `InputError` where values are lacking between a concrete hole and rim [m]."""
        first, last = self.radius[0], self.radius[-1]
        hole, rim = concrete(hole_radius), concrete(aperture_radius)
        if first > hole + _SAME_RADIUS or last < rim - _SAME_RADIUS:
            raise InputError(
                f"an apodisation from {first} to {last} m does not cover the surface from {hole} to {rim} m. "
                "Millimetres? Pass metres; where it is silent give amplitude 0."
            )

    def edges(self, hole_radius: Scalar, aperture_radius: Scalar) -> Float[Array, " edge"]:
        """Radii between which amplitude and phase are linear on the surface [m]; pieces outside it are empty."""
        inner = np.asarray(self.radius)[np.append(0, self._right)][1:-1]
        between = jnp.clip(jnp.asarray(inner, dtype=float), hole_radius, aperture_radius)
        ends = (jnp.asarray(end, dtype=float)[None] for end in (hole_radius, aperture_radius))
        return jnp.concatenate([next(ends), between, next(ends)])

    def counts(self, n: int) -> tuple[int, ...]:
        """Gauss points of each piece, when the whole surface needs `n`."""
        width = np.asarray(self.radius)[self._right] - np.asarray(self.radius)[self._left]
        return tuple(int(count) for count in _POINTS_MORE + np.ceil(n * width / width.sum()))

    def weight(self, radius: Float[Array, " ring"], counts: tuple[int, ...]) -> Complex[Array, " ring"]:
        """Amplitude and phase as complex numbers at the Gauss points of the pieces."""
        left, right = np.repeat(self._left, counts), np.repeat(self._right, counts)
        start, stop = (np.asarray(self.radius)[ends] for ends in (left, right))
        # The piece is known, not searched for: a point that rounding puts across a jump keeps its own side.
        fraction = (radius - jnp.asarray(start, dtype=float)) / jnp.asarray(stop - start, dtype=float)
        amplitude, phase = (
            values[left] + fraction * (values[right] - values[left])
            for values in (jnp.asarray(self.amplitude, dtype=float), jnp.asarray(self.phase, dtype=float))
        )
        return amplitude * jnp.exp(1j * phase)

    @property
    def _left(self) -> np.ndarray:
        """Index of the first radius of each piece of positive width."""
        return np.flatnonzero(np.diff(self.radius) > 0.0)

    @property
    def _right(self) -> np.ndarray:
        return self._left + 1
