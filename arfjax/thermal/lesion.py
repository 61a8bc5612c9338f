"""Size of the region whose damage reaches a threshold, measured between the cells of the grid.

The sharp contour is for reporting; the smoothed one, which every cell takes part in, is for fitting.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.coagulation import require_transition
from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.media import Scalar
from arfjax.thermal.bioheat import on_axis
from arfjax.thermal.damage import LETHAL_DOSE_MINUTES, log_excess

GAUSS_BELOW = 0.5
"""Change of the scaled level along a line below which the mean of the logistic comes from Gauss points: closed form
would lose digits there, and four points have an error of 1e-11 at most."""

GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)

MeanOnLine = Callable[[Array, Array], Array]
"""Mean of the coagulated fraction on a straight line, from the levels at its ends."""


class LesionSize(eqx.Module):
    """How large a lesion is and where.

    Attributes:
        length: Of its part of the axis [m].
        diameter: Twice its largest radius [m].
        volume: [m^3].
        centre: Axial position of the middle of its part of the axis [m]; of the highest dose on the axis when empty.
    """

    length: Float[Array, "*time"]
    diameter: Float[Array, "*time"]
    volume: Float[Array, "*time"]
    centre: Float[Array, "*time"]


def lesion_size(
    dose: Float[Array, "r z"] | Float[np.ndarray, "r z"],
    grid: AxisymmetricGrid,
    *,
    threshold: Scalar = LETHAL_DOSE_MINUTES,
) -> LesionSize:
    """Length, diameter, volume and centre of the region where `dose` reaches `threshold`.

    Both are equivalent minutes, or the damage of any other law and that law's threshold.

    The logarithm of dose, which is as smooth as temperature, is taken to be linear between neighbouring centres, for
    the volume linear in r^2; on the axis it is extrapolated evenly in r, to the walls linearly. A region that reaches
    a wall is cut there. Length and radius are *measures*: the part of the axis, or of one radius, that is above the
    threshold. So a second lesion on the axis adds its own length and not the gap, a ring counts by its thickness, and
    the size has no jumps. The diameter is the largest over the cells of z, not smoothed between them: that costs
    (h / 2L)^2 of it, in the worst case, where cells are h long and the lesion L.

    Raises:
        InputError: if `dose` does not fit the grid.

    Accuracy: second order in the cell size. A lesion shorter than two cells is measured by one or no point in it.
    Differentiability: in `dose` and `threshold`, with zero derivatives when no cell reaches the threshold; the slope
    (not the value) jumps when the contour crosses a cell centre or the widest place moves to another cell.
    """
    level = _level(dose, grid, threshold)
    axis, positions = _whole_axis(level, grid)
    measure = jnp.asarray(np.diff(positions)) * _fraction_above(axis[:-1], axis[1:])
    middle = jnp.where(
        axis[:-1] >= axis[1:], positions[:-1] + 0.5 * measure, positions[1:] - 0.5 * measure
    )  # of the part at the higher end of each interval
    diameter, volume = _across(level, grid, _fraction_above)
    return LesionSize(jnp.sum(measure), diameter, volume, _centre(measure, middle, axis, positions))


def smoothed_lesion_size(
    damage: Float[Array, "r z"] | Float[np.ndarray, "r z"],
    grid: AxisymmetricGrid,
    *,
    threshold: Scalar = LETHAL_DOSE_MINUTES,
    width: Scalar,
) -> LesionSize:
    r"""Length, diameter, volume and centre of the coagulated fraction, in place of the region above the threshold.

    The length is the integral of `coagulated_fraction` over the axis, the volume that over the grid, the diameter
    twice the largest integral over a radius, the centre the fraction's mean position on the axis. Interpolated as in
    `lesion_size`, which this becomes as `width` goes to zero, on any grid. It has slopes where no cell has reached
    the threshold yet; there the sizes say how near tissue is, about (damage / threshold)^(1 / width), and none is zero.

    Subtract `lesion_size` for the difference. With $a$ the logarithm of the highest damage over the threshold and
    damage falling like a Gaussian, length and diameter come out smaller by $(\pi width / a)^2 / 24$ of themselves and
    the volume larger by $(\pi width / a)^2 / 8$: at `width` 0.5 and 30 times the threshold, 0.9 and 2.7 percent. Tissue
    far away adds its share too: keep `width` below 1 for thermal dose.

    Args:
        damage: Of any law.
        grid: Where the cells lie.
        threshold: In the same unit.
        width: Of the transition in the logarithm of damage, positive.

    Raises:
        InputError: if `damage` does not fit the grid, or threshold or width is a number that is not positive.

    Accuracy: second order in the cell size, with respect to the smoothed size.
    Differentiability: in `damage` and `threshold` (and `width`); the slope of the diameter jumps when the widest place
    moves to another cell.
    """
    require_transition(threshold=threshold, width=width)
    level = _level(damage, grid, threshold) / width
    axis, positions = _whole_axis(level, grid)
    measure = jnp.asarray(np.diff(positions)) * _mean_logistic(axis[:-1], axis[1:])
    diameter, volume = _across(level, grid, _mean_logistic)
    middle = jnp.asarray(0.5 * (positions[:-1] + positions[1:]))
    return LesionSize(jnp.sum(measure), diameter, volume, _centre(measure, middle, axis, positions))


def lesion_growth(
    dose: Float[Array, "time r z"] | Float[np.ndarray, "time r z"],
    grid: AxisymmetricGrid,
    *,
    threshold: Scalar = LETHAL_DOSE_MINUTES,
) -> LesionSize:
    """`lesion_size` at each time of a history of dose, or of the damage of any law."""
    return jax.vmap(lambda now: lesion_size(now, grid, threshold=threshold))(jnp.asarray(dose))


def _level(
    damage: Float[Array, "r z"] | Float[np.ndarray, "r z"], grid: AxisymmetricGrid, threshold: Scalar
) -> Float[Array, "r z"]:
    if damage.shape != grid.shape:
        raise InputError(f"`dose` has shape {damage.shape}, the grid has {grid.shape} cells (r, z).")
    return log_excess(damage, threshold)


def _whole_axis(level: Float[Array, "r z"], grid: AxisymmetricGrid) -> tuple[Array, Float[np.ndarray, " n"]]:
    """Level on the axis at the cell centres and at both walls, and where that is."""
    axis = on_axis(level, grid)
    near = _extrapolate(axis[::-1], grid.z[::-1], grid.z_faces[0])
    far = _extrapolate(axis, grid.z, grid.z_faces[-1])
    positions = np.concatenate([grid.z_faces[:1], grid.z, grid.z_faces[-1:]])
    return jnp.concatenate([near[None], axis, far[None]]), positions


def _centre(measure: Array, middle: Array, axis: Array, positions: Float[np.ndarray, " n"]) -> Float[Array, ""]:
    total = jnp.sum(measure)
    empty = total == 0.0
    mean = jnp.sum(measure * middle) / jnp.where(empty, 1.0, total)
    return jnp.where(empty, jnp.asarray(positions)[jnp.argmax(axis)], mean)


def _across(level: Float[Array, "r z"], grid: AxisymmetricGrid, mean: MeanOnLine) -> tuple[Array, Array]:
    """Diameter and volume: radial integrals of the fraction at each z, over dr and over pi d(r^2)."""
    edge = _extrapolate(level.T, grid.r, grid.r_faces[-1])
    lines = jnp.concatenate([on_axis(level, grid)[None, :], level, edge[None, :]])
    fraction = mean(lines[:-1], lines[1:])
    radii = np.concatenate([[0.0], grid.r, grid.r_faces[-1:]])
    areas = np.pi * jnp.asarray(np.diff(radii**2)) @ fraction
    return 2.0 * jnp.max(jnp.asarray(np.diff(radii)) @ fraction), areas @ jnp.asarray(np.diff(grid.z_faces))


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


def _mean_logistic(start: Float[Array, "*shape"], end: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Mean of 1 / (1 + exp(-level)) on a straight line of levels from `start` to `end`."""
    change = end - start
    short = jnp.abs(change) < GAUSS_BELOW
    middle, half = 0.5 * (start + end), 0.5 * jnp.where(short, change, 0.0)
    by_points = sum(
        0.5 * weight * jax.nn.sigmoid(middle + point * half)
        for point, weight in zip(GAUSS_POINTS.tolist(), GAUSS_WEIGHTS.tolist(), strict=True)
    )
    closed = (jax.nn.softplus(end) - jax.nn.softplus(start)) / jnp.where(short, 1.0, change)
    return jnp.where(short, by_points, closed)
