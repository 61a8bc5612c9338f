"""Size of the region whose thermal dose reaches a threshold, measured between the cells of the grid."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.media import Scalar
from arfjax.thermal.bioheat import on_axis
from arfjax.thermal.dose import LETHAL_DOSE_MINUTES

SMALLEST_DOSE = 1e-30
"""Dose [min] below which its logarithm is held, so that no dose has a finite one, in float32 as well."""


class LesionSize(eqx.Module):
    """How large a lesion is and where.

    Attributes:
        length: Of its part of the axis [m].
        diameter: Twice its largest radius [m].
        centre: Axial position of the middle of its part of the axis [m]; of the highest dose on the axis when empty.
    """

    length: Float[Array, ""]
    diameter: Float[Array, ""]
    centre: Float[Array, ""]


def lesion_size(
    dose: Float[Array, "r z"] | Float[np.ndarray, "r z"],
    grid: AxisymmetricGrid,
    *,
    threshold: Scalar = LETHAL_DOSE_MINUTES,
) -> LesionSize:
    """Length, diameter and centre of the region where `dose` reaches `threshold`, both in min.

    The logarithm of dose, which is as smooth as temperature, is taken to be linear between neighbouring centres; on
    the axis it is extrapolated evenly in r, to the walls linearly. A region that reaches a wall is cut there.
    Length and radius are *measures*: the part of the axis, or of one radius, that is above the threshold. So a
    second lesion on the axis adds its own length and not the gap, a ring counts by its thickness, and the size has
    no jumps. The diameter is the largest over the cells of z, not smoothed between them.

    Raises:
        InputError: if `dose` does not fit the grid.

    Accuracy: second order in the cell size. A lesion shorter than two cells is measured by one or no point in it.
    Differentiability: in `dose` and `threshold`, with zero derivatives when no cell reaches the threshold; the slope
    (not the value) jumps when the contour crosses a cell centre or the widest place moves to another cell.
    """
    if dose.shape != grid.shape:
        raise InputError(f"`dose` has shape {dose.shape}, the grid has {grid.shape} cells (r, z).")
    level = jnp.log(jnp.maximum(dose, SMALLEST_DOSE)) - jnp.log(threshold)
    axis = on_axis(level, grid)
    length, centre = _extent(_reach_walls(axis, grid), np.concatenate([grid.z_faces[:1], grid.z, grid.z_faces[-1:]]))
    return LesionSize(length, 2.0 * jnp.max(_radii(level, axis, grid)), centre)


def _extent(level: Float[Array, " n"], positions: Float[np.ndarray, " n"]) -> tuple[Array, Array]:
    """Measure and middle of the part of a line on which `level` is positive."""
    spacing = np.diff(positions)
    measure = spacing * _fraction_above(level[:-1], level[1:])
    middle = jnp.where(
        level[:-1] >= level[1:], positions[:-1] + 0.5 * measure, positions[1:] - 0.5 * measure
    )  # of the part at the higher end of each interval
    total = jnp.sum(measure)
    empty = total == 0.0
    mean = jnp.sum(measure * middle) / jnp.where(empty, 1.0, total)
    return total, jnp.where(empty, jnp.asarray(positions)[jnp.argmax(level)], mean)


def _radii(level: Float[Array, "r z"], axis: Float[Array, " z"], grid: AxisymmetricGrid) -> Float[Array, " z"]:
    """Measure of the part of each radius on which `level` is positive."""
    edge = _extrapolate(level.T, grid.r, grid.r_faces[-1])
    lines = jnp.concatenate([axis[None, :], level, edge[None, :]])
    spacing = np.diff(grid.r, prepend=0.0, append=grid.r_faces[-1])
    return jnp.asarray(spacing) @ _fraction_above(lines[:-1], lines[1:])


def _reach_walls(level: Float[Array, " z"], grid: AxisymmetricGrid) -> Float[Array, " z_and_walls"]:
    near = _extrapolate(level[::-1], grid.z[::-1], grid.z_faces[0])
    far = _extrapolate(level, grid.z, grid.z_faces[-1])
    return jnp.concatenate([near[None], level, far[None]])


def _extrapolate(
    level: Float[Array, "*batch n"], positions: Float[np.ndarray, " n"], target: float
) -> Float[Array, "*batch"]:
    """Value at `target` of the line through the last two values; the last value where there is no other."""
    if len(positions) == 1:
        return level[..., -1]
    beyond = (target - positions[-1]) / (positions[-1] - positions[-2])
    return level[..., -1] + beyond * (level[..., -1] - level[..., -2])


def _fraction_above(start: Float[Array, "*shape"], end: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Part of a straight line from `start` to `end` that is positive: 1, 0, or the positive end over the height."""
    height = jnp.abs(start) + jnp.abs(end)
    positive = jnp.maximum(start, 0.0) + jnp.maximum(end, 0.0)
    return positive / jnp.where(height > 0.0, height, 1.0)
