"""Gathering and scattering against loops, elements against the assembled matrix."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.numerics.assembly import apply_elements, gather, scatter
from arfjax.numerics.sparse_direct import Pattern

N_Z, N_R = 3, 2
RNG = np.random.default_rng(0)


def nodal(n_components: int = 2) -> jnp.ndarray:
    return jnp.asarray(RNG.normal(size=(2 * N_Z + 1, 2 * N_R + 1, n_components)))


def element_matrices(size: int) -> jnp.ndarray:
    root = RNG.normal(size=(N_Z, N_R, size, size))
    return jnp.asarray(root + root.transpose(0, 1, 3, 2))


def test_gather_takes_the_nodes_of_each_element():
    values = nodal()
    gathered = gather(values)
    for z in range(N_Z):
        for r in range(N_R):
            expected = values[2 * z : 2 * z + 3, 2 * r : 2 * r + 3].reshape(9, 2)
            np.testing.assert_array_equal(gathered[z, r], expected)


def test_scatter_is_the_transpose_of_gather():
    values, elements = nodal(), jnp.asarray(RNG.normal(size=(N_Z, N_R, 9, 2)))
    np.testing.assert_allclose(jnp.sum(gather(values) * elements), jnp.sum(values * scatter(elements)), rtol=1e-13)


@pytest.mark.parametrize("n_components", [1, 2])
def test_elements_act_like_the_assembled_matrix(n_components):
    matrices, values = element_matrices(9 * n_components), nodal(n_components)
    numbers = gather(jnp.arange(values.size, dtype=float).reshape(values.shape)).astype(int)
    pattern = Pattern.of_elements(np.asarray(numbers).reshape(N_Z * N_R, -1), values.size)
    product = pattern.multiply(pattern.assemble(matrices.reshape(N_Z * N_R, *matrices.shape[2:])), values.ravel())
    np.testing.assert_allclose(apply_elements(matrices, values).ravel(), product, rtol=1e-12, atol=1e-12)


def test_one_matrix_can_act_on_each_component():
    matrices, values = element_matrices(9), nodal()
    both = apply_elements(matrices, values)
    for component in range(2):
        alone = apply_elements(matrices, values[..., component, None])
        np.testing.assert_allclose(both[..., component, None], alone, rtol=1e-12, atol=1e-12)
