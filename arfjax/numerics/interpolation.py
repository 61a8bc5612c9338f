"""Interpolation between uneven positions, as weights."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

STENCIL = 4
"""Nodes in a row that a point is interpolated from, where there are so many: fourth order."""

Positions = Float[Array, " n"] | Float[np.ndarray, " n"]


@jax.jit
def stencil_weights(
    points: Float[Array, " point"] | Float[np.ndarray, " point"], nodes: Positions
) -> tuple[Int[Array, " point"], Float[Array, "point stencil"]]:
    """First of the four nodes nearest to each point, and their weights in the Lagrange polynomial through them.

    Args:
        points: Where values are wanted; beyond the outermost nodes the last cubic is continued.
        nodes: Where values are known, ascending; with fewer than four, the polynomial is through all of them.

    Accuracy: fourth order in the spacing (of lower order with fewer than four nodes).
    Differentiability: in the points and the nodes, with jumps of slope of third order at the nodes.
    """
    count = min(STENCIL, nodes.shape[0])
    same, positions, points = np.eye(count, dtype=bool)[None], jnp.asarray(nodes), jnp.asarray(points)
    # Which nodes are nearest has no derivative.
    after = jnp.searchsorted(*jax.lax.stop_gradient((positions, points)))
    first = jnp.clip(after - count // 2, 0, nodes.shape[0] - count)
    near = positions[first[:, None] + np.arange(count)[None, :]]
    gaps = jnp.where(same, 1.0, near[:, :, None] - near[:, None, :])
    factors = jnp.where(same, 1.0, (points[:, None] - near)[:, None, :] / gaps)
    return first, jnp.prod(factors, axis=2)


@jax.jit
def interpolation_weights(points: Float[Array, " point"], nodes: Positions) -> Float[Array, "point n"]:
    """Weight of each node at each point, most of them 0; see `stencil_weights`."""
    first, weights = stencil_weights(points, nodes)
    rows = np.arange(points.shape[0])[:, None]
    chosen = first[:, None] + np.arange(weights.shape[1])[None, :]
    return jnp.zeros((points.shape[0], nodes.shape[0]), weights.dtype).at[rows, chosen].set(weights)
