"""Inverses of very many very small matrices."""

import jax.numpy as jnp
from jaxtyping import Array, Inexact


def inverse_of_symmetric(matrices: Inexact[Array, "3 3 *each"]) -> Inexact[Array, "3 3 *each"]:
    """Inverses of symmetric 3 x 3 matrices by cofactors; for matrices that are far from singular.

    They are scaled by their trace, which must not vanish: products of three entries may be beyond the range of float32.
    """
    scale = matrices[0, 0] + matrices[1, 1] + matrices[2, 2]
    scaled = matrices / scale[None, None]
    rows = [jnp.cross(scaled[(i + 1) % 3], scaled[(i + 2) % 3], axis=0) for i in range(3)]
    determinant = jnp.sum(scaled[0] * rows[0], axis=0)
    return jnp.stack(rows, axis=1) / (determinant * scale)[None, None]
