"""Which unknowns of a mesh meet in an element, and in which order to eliminate them."""

import functools

import numpy as np

from arfjax.mechanics.elements.mesh import Mesh
from arfjax.numerics.sparse_direct import Pattern, nested_dissection


def displacement_pattern(mesh: Mesh) -> Pattern:
    """Pattern of matrices that act on fields of displacement in the order component, row, column; kept by the mesh.

    Element matrices are sorted by elements, axial first; their rows by nodes and then components.
    """
    return _pattern(*mesh.shape, np.asarray(mesh.free, bool).tobytes())


@functools.lru_cache(maxsize=16)
def _pattern(n_r: int, n_z: int, free: bytes) -> Pattern:
    n_rows, n_columns = 2 * n_z + 1, 2 * n_r + 1
    corner = 2 * np.arange(n_z)[:, None] * n_columns + 2 * np.arange(n_r)[None, :]
    inside = np.arange(3)[:, None] * n_columns + np.arange(3)[None, :]
    nodes = corner.reshape(-1, 1) + inside.reshape(1, -1)
    components = np.arange(2) * n_rows * n_columns
    mask = np.frombuffer(free, bool).reshape(n_rows, n_columns, 2).transpose(2, 0, 1).ravel()
    order = nested_dissection(n_rows, n_columns)
    return Pattern.of_elements(
        (nodes[:, :, None] + components).reshape(len(nodes), -1),
        2 * n_rows * n_columns,
        mask,
        order=(order[:, None] + components).ravel(),
    )
