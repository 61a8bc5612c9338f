"""Magnetic-resonance thermometry: the mean over a voxel and over the time of a frame, with noise."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, PRNGKeyArray

from arfjax.errors import InputError, as_known
from arfjax.grid import AxisymmetricGrid
from arfjax.instruments.sampling import (
    axial_weights,
    mean_over,
    radial_weights,
    require,
    require_field,
    require_inside,
)
from arfjax.media import Scalar
from arfjax.numerics.quadrature import gauss_legendre
from arfjax.thermal.bioheat import TemperatureHistory

N_POINTS = 16
"""Gauss points along each side of a voxel: enough for a Gaussian as narrow as a tenth of the side (1/e radius)."""

_OVERSHOOT = 1e-9
"""How far a frame may reach beyond the history, relative to its length: rounding of sums of steps."""

Times = Float[Array, "_"] | Float[np.ndarray, "_"]
FrameTimes = Float[Array, " frame"] | Float[np.ndarray, " frame"]


class MagneticResonanceThermometer(eqx.Module):
    """A voxel, a box whose sides are along x, y and the beam axis z.

    Call it with a history of temperature: `thermometer(history, grid, z=focus, frame_times=times)`. For a slice and
    its in-plane resolution use `slice_along_beam` or `slice_across_beam`.

    Attributes:
        width: Side along x, the direction of the lateral offset [m].
        height: Side along y [m].
        length: Side along the beam axis [m].
        lateral_offset: Of the voxel's centre from the beam axis, along x [m].
        axial_offset: Of the voxel's centre beyond its stated z [m].
        acquisition_time: Over which a frame averages [s].
        noise_sd: Standard deviation of the noise of a voxel in a frame [K].
    """

    width: Scalar
    height: Scalar
    length: Scalar
    lateral_offset: Scalar = 0.0
    axial_offset: Scalar = 0.0
    acquisition_time: Scalar = 0.0
    noise_sd: Scalar = 0.0

    def __check_init__(self) -> None:
        """Refuse a voxel without volume, offsets that are not finite, and negative times and noise."""
        for name in ("width", "height", "length"):
            require(name, getattr(self, name), "m", least=0.0, above=True)
        for name in ("lateral_offset", "axial_offset"):
            require(name, getattr(self, name), "m")
        require("acquisition_time", self.acquisition_time, "s", least=0.0)
        require("noise_sd", self.noise_sd, "K", least=0.0)

    def __call__(
        self,
        history: TemperatureHistory,
        grid: AxisymmetricGrid,
        *,
        z: Scalar,
        frame_times: FrameTimes,
        key: PRNGKeyArray | None = None,
    ) -> Float[Array, " frame"]:
        """Temperature that the voxel shows in each frame [degC].

        Args:
            history: Temperature of the tissue, linear between its times.
            grid: Where the cells of `history` lie.
            z: Stated axial position of the voxel's centre [m].
            frame_times: Middle of each frame's acquisition [s].
            key: Of the noise, a new one for every voxel; no noise when None.

        Raises:
            InputError: if shapes disagree, or the voxel or a frame reaches out of the grid or the history (where
                these are not traced).

        Accuracy: exact in time. In space fourth order in the cell size, as long as temperature varies over no less
        than a tenth of a side of the voxel.
        Differentiability: in every attribute, also at zero, in `z`, the times and the history.
        """
        require_field("history.temperature", history.temperature.shape, grid)
        voxel = mean_over(self._weights(grid, z), history.temperature)
        shown = frame_means(history.time, voxel, frame_times, self.acquisition_time)
        if key is None:
            return shown
        return shown + self.noise_sd * jax.random.normal(key, shown.shape, shown.dtype)

    def _weights(self, grid: AxisymmetricGrid, z: Scalar) -> Float[Array, "r z"]:
        middle, half = as_known(z) + as_known(self.axial_offset), 0.5 * as_known(self.length)
        across, up = abs(as_known(self.lateral_offset)) + 0.5 * as_known(self.width), 0.5 * as_known(self.height)
        # What jnp computes under a transformation is traced, whatever of, and could not be refused.
        traced = isinstance(across, Tracer) or isinstance(up, Tracer)
        corner = jnp.hypot(across, up) if traced else math.hypot(float(across), float(up))
        require_inside("voxel", grid, radius=corner, near=middle - half, far=middle + half)
        nodes, weights = gauss_legendre(N_POINTS)
        x = (self.lateral_offset + 0.5 * self.width * nodes)[:, None]
        y = (0.5 * self.height * nodes)[None, :]
        shares = 0.25 * weights[:, None] * weights[None, :]
        radial = radial_weights(jnp.ravel(x**2 + y**2), shares.ravel(), grid)
        axial = axial_weights(jnp.asarray(middle + half * nodes), 0.5 * weights, grid)
        return radial[:, None] * axial[None, :]


def slice_along_beam(
    *, lateral: Scalar, axial: Scalar, thickness: Scalar, **settings: Scalar
) -> MagneticResonanceThermometer:
    """A voxel of a slice that holds the beam axis or is parallel to it (coronal or sagittal to a beam from the side).

    Args:
        lateral: In-plane size across the beam [m].
        axial: In-plane size along the beam [m].
        thickness: Of the slice, across the beam [m].
        **settings: Other attributes of `MagneticResonanceThermometer`; its lateral offset is in the plane.
    """
    return MagneticResonanceThermometer(width=lateral, height=thickness, length=axial, **settings)


def slice_across_beam(
    *, lateral: Scalar, other_lateral: Scalar, thickness: Scalar, **settings: Scalar
) -> MagneticResonanceThermometer:
    """A voxel of a slice whose normal is the beam axis, such as the focal plane.

    Args:
        lateral: In-plane size in the direction of the lateral offset [m].
        other_lateral: The other in-plane size [m].
        thickness: Of the slice, along the beam [m].
        **settings: Other attributes of `MagneticResonanceThermometer`.
    """
    return MagneticResonanceThermometer(width=lateral, height=other_lateral, length=thickness, **settings)


def frame_means(
    time: Float[Array, " time"],
    values: Float[Array, " time"],
    frame_times: FrameTimes,
    duration: Scalar,
) -> Float[Array, " frame"]:
    """Means of values that are linear between `time` over windows of `duration` around `frame_times` [s].

    Exact; the value itself where the duration is zero.

    Raises:
        InputError: if a window reaches out of `time` (where these are not traced).
    """
    frame_times = frame_times if isinstance(frame_times, Tracer) else np.asarray(frame_times)
    duration = as_known(duration)
    start, stop = frame_times - 0.5 * duration, frame_times + 0.5 * duration
    _require_frames(as_known(time), start, stop)
    return _window_means(time, values, *(jnp.asarray(each) for each in (frame_times, start, stop)))


@jax.jit
def _window_means(time: Array, values: Array, middles: Array, start: Array, stop: Array) -> Array:
    # A window is cut into its parts in the intervals; over each the mean of a line is the value in its middle.
    low = jnp.clip(start[:, None], time[None, :-1], time[None, 1:])
    high = jnp.clip(stop[:, None], time[None, :-1], time[None, 1:])
    lengths = jnp.diff(time)[None, :]
    place = (0.5 * (low + high) - time[None, :-1]) / jnp.where(lengths > 0.0, lengths, 1.0)
    lines = values[None, :-1] + place * jnp.diff(values)[None, :]
    parts = high - low
    total = jnp.sum(parts, axis=1)
    lasting = total > 0.0
    means = jnp.sum(parts * lines, axis=1) / jnp.where(lasting, total, 1.0)
    return jnp.where(lasting, means, jnp.interp(middles, time, values))


def _require_frames(time: Times, start: Times, stop: Times) -> None:
    if start.size == 0 or any(isinstance(each, Tracer) for each in (time, start, stop)):
        return
    slack = _OVERSHOOT * (time[-1] - time[0])
    if not (np.min(start) >= time[0] - slack and np.max(stop) <= time[-1] + slack):
        raise InputError(
            f"`frame_times` need temperatures from {np.min(start):g} to {np.max(stop):g} s, the history has them "
            f"from {time[0]:g} to {time[-1]:g} s. Minutes? Pass seconds; or simulate longer."
        )
