"""Between the nodes of a structured mesh of biquadratic elements and its elements.

Nodes are numbered row by row (a row holds all radial positions at one z). A row of elements spans three node rows and
shares the last with the next one.
"""

import jax.numpy as jnp
from jaxtyping import Array, Inexact

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
