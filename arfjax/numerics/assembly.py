"""Between the nodes of a structured mesh of biquadratic elements, its elements, and a block-tridiagonal matrix.

Nodes are numbered row by row (a row holds all radial positions at one z). A row of elements spans three node rows and
shares the last with the next one, so that two node rows make one block; the last block is padded with an empty row.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Inexact

from arfjax.numerics.block_tridiagonal import BlockTridiagonal
from arfjax.numerics.elements import N_NODES


def gather(nodal: Inexact[Array, "row column component"]) -> Inexact[Array, "ez er 9 component"]:
    """The nodal values of each element."""
    n_rows, n_columns, n_components = nodal.shape
    along_r = _split(nodal.transpose(1, 0, 2))
    both = _split(along_r.transpose(2, 0, 1, 3))
    return both.transpose(0, 2, 1, 3, 4).reshape(n_rows // 2, n_columns // 2, N_NODES, n_components)


def scatter(elements: Inexact[Array, "ez er 9 component"]) -> Inexact[Array, "row column component"]:
    """Sums what the elements give to each node: the transpose of `gather`."""
    n_z, n_r, _, n_components = elements.shape
    both = elements.reshape(n_z, n_r, 3, 3, n_components).transpose(0, 2, 1, 3, 4)
    along_r = _join(both).transpose(1, 2, 0, 3)
    return _join(along_r).transpose(1, 0, 2)


def _split(line: Inexact[Array, "node *rest"]) -> Inexact[Array, "element 3 *rest"]:
    own = line[:-1].reshape(len(line) // 2, 2, *line.shape[1:])
    return jnp.concatenate([own, line[2::2, None]], axis=1)


def _join(elements: Inexact[Array, "element 3 *rest"]) -> Inexact[Array, "node *rest"]:
    n_elements, _, *rest = elements.shape
    own = elements[:, :2].reshape(2 * n_elements, *rest)
    shared = jnp.stack([jnp.zeros_like(elements[:, 2]), elements[:, 2]], axis=1).reshape(2 * n_elements, *rest)
    unpadded = [(0, 0)] * len(rest)
    return jnp.pad(own, [(0, 1), *unpadded]) + jnp.pad(shared, [(1, 0), *unpadded])


def apply_elements(
    matrices: Inexact[Array, "ez er n n"], nodal: Inexact[Array, "row column component"]
) -> Inexact[Array, "row column component"]:
    """The assembled matrix times nodal values, without assembling it.

    Element matrices act on all components together (n = 9 components) or on each alike (n = 9).
    """
    elements = gather(nodal)
    n_z, n_r, n_nodes, n_components = elements.shape
    columns = 1 if matrices.shape[-1] == n_nodes * n_components else n_components
    stacked = elements.reshape(n_z, n_r, matrices.shape[-1], columns)
    return scatter(jnp.einsum("zrij,zrjc->zric", matrices, stacked).reshape(elements.shape))


def to_blocks(nodal: Float[Array, "row column component"]) -> Float[Array, "block m"]:
    """Nodal values as block rows, the padding zero."""
    n_rows, n_columns, n_components = nodal.shape
    padded = jnp.pad(nodal, ((0, 1), (0, 0), (0, 0)))
    return padded.reshape((n_rows + 1) // 2, 2 * n_columns * n_components)


def from_blocks(blocks: Float[Array, "block m"], n_components: int) -> Float[Array, "row column component"]:
    """Nodal values from block rows, the padding dropped."""
    n_blocks, size = blocks.shape
    return blocks.reshape(2 * n_blocks, size // (2 * n_components), n_components)[:-1]


def assemble(matrices: Float[Array, "ez er n n"]) -> BlockTridiagonal:
    """The global matrix of symmetric element matrices of `n` = 9 components unknowns (node major).

    The rows and columns of the padding stay zero; `constrain` makes them an identity.
    """
    n_z, n_r, n_unknowns, _ = matrices.shape
    n_components = n_unknowns // N_NODES
    own, shared = _positions_in_block(n_r, n_components)
    split = own.shape[1]  # unknowns of an element on its own two node rows; the third row is the next block's first
    size = 2 * (2 * n_r + 1) * n_components
    zero = jnp.zeros((n_z, size, size), matrices.dtype)

    def place(part: Array, rows: np.ndarray, columns: np.ndarray) -> Array:
        return zero.at[:, rows[:, :, None], columns[:, None, :]].add(part)

    here = place(matrices[:, :, :split, :split], own, own)
    following = place(matrices[:, :, split:, split:], shared, shared)
    below = place(matrices[:, :, split:, :split], shared, own)
    diagonal = jnp.pad(here, ((0, 1), (0, 0), (0, 0))) + jnp.pad(following, ((1, 0), (0, 0), (0, 0)))
    return BlockTridiagonal(diagonal, jnp.pad(below, ((1, 0), (0, 0), (0, 0))))


def _positions_in_block(n_r: int, n_components: int) -> tuple[np.ndarray, np.ndarray]:
    # Position inside a block of each unknown of each element of a row: first two node rows, and third node row.
    n_columns = 2 * n_r + 1
    column = 2 * np.arange(n_r)[:, None, None, None] + np.arange(3)[None, None, :, None]
    row = np.arange(2)[None, :, None, None]
    component = np.arange(n_components)[None, None, None, :]
    own = ((row * n_columns + column) * n_components + component).reshape(n_r, -1)
    shared = (column * n_components + component).reshape(n_r, -1)
    return own, shared


def constrain(matrix: BlockTridiagonal, free: Float[Array, "block m"]) -> BlockTridiagonal:
    """Replaces rows and columns where `free` is zero by those of the identity."""
    diagonal = matrix.diagonal * free[:, :, None] * free[:, None, :] + jax.vmap(jnp.diag)(1.0 - free)
    previous = jnp.concatenate([jnp.zeros_like(free[:1]), free[:-1]])
    return BlockTridiagonal(diagonal, matrix.lower * free[:, :, None] * previous[:, None, :])
