"""Shape functions on the reference square [-1, 1] x [-1, 1]: biquadratic (Q2) and discontinuous linear (P1).

Nodes and points of a square are numbered row by row: the first coordinate (r) runs fastest, the second (z) slowest.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

N_NODES = 9
"""Nodes of a biquadratic element: corners, middles of the sides, centre."""

Coordinate = Float[Array, "*point"] | Float[np.ndarray, "*point"]


def quadratic(coordinate: Coordinate) -> Float[Array, "*point 3"]:
    """Lagrange polynomials of the nodes -1, 0, 1."""
    x = jnp.asarray(coordinate, dtype=float)
    return jnp.stack([0.5 * x * (x - 1.0), 1.0 - x**2, 0.5 * x * (x + 1.0)], axis=-1)


def quadratic_slope(coordinate: Coordinate) -> Float[Array, "*point 3"]:
    """First derivatives of the Lagrange polynomials of the nodes -1, 0, 1."""
    x = jnp.asarray(coordinate, dtype=float)
    return jnp.stack([x - 0.5, -2.0 * x, x + 0.5], axis=-1)


def product(along_r: Float[Array, "r 3"], along_z: Float[Array, "z 3"]) -> Float[Array, "z*r 9"]:
    """Products of shape functions along r and along z at every pair of points."""
    table = along_z[:, None, :, None] * along_r[None, :, None, :]
    return table.reshape(len(along_z) * len(along_r), N_NODES)


def linear_pressure(points_r: Float[np.ndarray, " r"], points_z: Float[np.ndarray, " z"]) -> Float[Array, "z*r 3"]:
    """The functions 1, r, z of the reference square at every pair of points."""
    z, r = np.meshgrid(points_z, points_r, indexing="ij")
    return jnp.asarray(np.stack([np.ones_like(r), r, z], axis=-1).reshape(-1, 3), dtype=float)
