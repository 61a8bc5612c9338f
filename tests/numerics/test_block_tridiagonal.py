"""The block-tridiagonal solver against dense linear algebra, and its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.numerics.block_tridiagonal import BlockTridiagonal, factorise, solve
from tests.checks import assert_gradient


def random_matrix(n_blocks: int, size: int, seed: int = 0) -> BlockTridiagonal:
    rng = np.random.default_rng(seed)
    lower = rng.normal(size=(n_blocks, size, size))
    lower[0] = 0.0
    root = rng.normal(size=(n_blocks, size, size))
    # Diagonally dominant in the block sense, hence positive definite.
    diagonal = root @ root.transpose(0, 2, 1) + 6.0 * size * np.eye(size)
    return BlockTridiagonal(jnp.asarray(diagonal), jnp.asarray(lower))


def dense(matrix: BlockTridiagonal) -> np.ndarray:
    n_blocks, size, _ = matrix.diagonal.shape
    full = np.zeros((n_blocks, size, n_blocks, size))
    for i in range(n_blocks):
        full[i, :, i] = matrix.diagonal[i]
        if i > 0:
            full[i, :, i - 1] = matrix.lower[i]
            full[i - 1, :, i] = matrix.lower[i].T
    return full.reshape(n_blocks * size, n_blocks * size)


@pytest.mark.parametrize(("n_blocks", "size"), [(1, 3), (2, 1), (5, 4)])
def test_solution_and_product_match_dense_algebra(n_blocks, size):
    matrix = random_matrix(n_blocks, size)
    vector = jnp.asarray(np.random.default_rng(1).normal(size=(n_blocks, size)))
    solution = jax.jit(lambda m, v: solve(m, factorise(m), v))(matrix, vector)
    expected = np.linalg.solve(dense(matrix), np.asarray(vector).ravel())
    np.testing.assert_allclose(solution.ravel(), expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(matrix.multiply(solution), vector, rtol=1e-12, atol=1e-13)


def test_gradient_in_matrix_and_right_side():
    matrix = random_matrix(4, 3)
    vector = jnp.asarray(np.random.default_rng(2).normal(size=(4, 3)))

    def functional(arguments):
        diagonal, lower, right_side = arguments
        system = BlockTridiagonal(0.5 * (diagonal + diagonal.transpose(0, 2, 1)), lower)
        return jnp.sum(jnp.sin(solve(system, factorise(system), right_side)))

    assert_gradient(functional, (matrix.diagonal, matrix.lower, vector))


def test_a_batch_matches_single_solves():
    matrices = [random_matrix(3, 2, seed) for seed in range(3)]
    vector = jnp.ones((3, 2))
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *matrices)
    batch = jax.vmap(lambda m: solve(m, factorise(m), vector))(stacked)
    singles = jnp.stack([solve(m, factorise(m), vector) for m in matrices])
    np.testing.assert_allclose(batch, singles, rtol=1e-13)
