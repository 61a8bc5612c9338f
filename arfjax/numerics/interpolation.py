"""Interpolation between uneven positions, as weights."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

STENCIL = 4
"""Nodes in a row that a point is interpolated from, where there are so many: fourth order."""


@jax.jit
def interpolation_weights(
    points: Float[Array, " point"], nodes: Float[Array, " n"] | Float[np.ndarray, " n"]
) -> Float[Array, "point n"]:
    """Weight of each node at each point: the Lagrange polynomial through the four nearest nodes.

    Args:
        points: Where values are wanted; beyond the outermost nodes the last cubic is continued.
        nodes: Where values are known, ascending.

    Accuracy: fourth order in the spacing (of lower order with fewer than four nodes).
    Differentiability: in the points and the nodes, with jumps of slope of third order at the nodes.
    """
    count = min(STENCIL, nodes.shape[0])
    same, positions = np.eye(count, dtype=bool), jnp.asarray(nodes)

    def at(point: Float[Array, ""]) -> Float[Array, " n"]:
        # Which nodes are nearest has no derivative.
        first = jnp.searchsorted(*jax.lax.stop_gradient((positions, point))) - count // 2
        chosen = jnp.clip(first, 0, nodes.shape[0] - count) + jnp.arange(count)
        near = positions[chosen]
        gaps = jnp.where(same, 1.0, near[:, None] - near[None, :])
        weights = jnp.prod(jnp.where(same, 1.0, (point - near)[None, :] / gaps), axis=1)
        return jnp.zeros(nodes.shape[0]).at[chosen].set(weights)

    return jax.vmap(at)(points)
