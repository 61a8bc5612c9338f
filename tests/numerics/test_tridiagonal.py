"""Batched tridiagonal solves against dense matrices."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.numerics.tridiagonal import factorise, solve


def dominant(n: int, shape: tuple[int, ...], dominance: float = 1.3, seed: int = 0):
    """Diagonal, coupling and right side of random systems, couplings of either sign over four decades."""
    rng = np.random.default_rng(seed)
    coupling = rng.choice([-1.0, 1.0], (n - 1, *shape)) * 10.0 ** rng.uniform(-2.0, 2.0, (n - 1, *shape))
    beside = np.zeros((n + 1, *shape))
    beside[1:n] = np.abs(coupling)
    diagonal = dominance * (beside[1:] + beside[:-1]) + 0.01
    return diagonal, coupling, rng.normal(size=(n, *shape))


def dense_solution(diagonal, coupling, right):
    solution = np.empty(right.shape)
    for index in np.ndindex(diagonal.shape[1:]):
        at = (slice(None), *index)
        matrix = np.diag(diagonal[at]) + np.diag(coupling[at], 1) + np.diag(coupling[at], -1)
        solution[at] = np.linalg.solve(matrix, right[at])
    return solution


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
@pytest.mark.parametrize("n", [1, 2, 17])
def test_solves_as_dense_matrices_do(n, shape):
    diagonal, coupling, right = dominant(n, shape)
    solution = solve(factorise(jnp.asarray(diagonal), jnp.asarray(coupling)), jnp.asarray(right))
    np.testing.assert_allclose(solution, dense_solution(diagonal, coupling, right), rtol=1e-11, atol=1e-13)


def test_one_factor_solves_again_and_again_and_under_vmap():
    diagonal, coupling, right = dominant(9, (4,))
    factor = factorise(jnp.asarray(diagonal), jnp.asarray(coupling))
    sides = jnp.asarray(np.stack([right, 2.0 * right[::-1], right**2]))
    many = jax.jit(jax.vmap(lambda side: solve(factor, side)))(sides)
    for side, solution in zip(sides, many, strict=True):
        np.testing.assert_allclose(solution, dense_solution(diagonal, coupling, np.asarray(side)), rtol=1e-11)


def test_barely_dominant_systems_lose_no_more_than_their_condition():
    """A Laplacian with insulated ends plus a little: condition 1e7, backward stable."""
    n, little = 50, 1e-6
    diagonal = np.full((n, 1), 2.0 + little)
    diagonal[[0, -1]] = 1.0 + little
    coupling, right = -np.ones((n - 1, 1)), np.random.default_rng(1).normal(size=(n, 1))
    solution = np.asarray(solve(factorise(jnp.asarray(diagonal), jnp.asarray(coupling)), jnp.asarray(right)))
    ends = np.concatenate([[[0.0]], coupling, [[0.0]]])
    padded = np.concatenate([[[0.0]], solution, [[0.0]]])
    residual = diagonal * solution + ends[1:] * padded[2:] + ends[:-1] * padded[:-2] - right
    assert np.abs(residual).max() < 1e-14 * 4.0 * np.abs(solution).max()
    np.testing.assert_allclose(little * solution.sum(), right.sum(), rtol=1e-8)


def test_single_precision():
    diagonal, coupling, right = dominant(17, (3,))
    with jax.enable_x64(False):
        single = [jnp.asarray(each, jnp.float32) for each in (diagonal, coupling, right)]
        solution = solve(factorise(*single[:2]), single[2])
    assert solution.dtype == jnp.float32
    exact = dense_solution(diagonal, coupling, right)
    np.testing.assert_allclose(solution, exact, atol=1e-5 * np.abs(exact).max())


def test_no_derivative_through_the_factors():
    """Who solves supplies it; the right side's is that of the inverse matrix, which is symmetric."""
    diagonal, coupling, right = (jnp.asarray(each) for each in dominant(6, ()))
    slopes = jax.grad(lambda d, c: jnp.sum(solve(factorise(d, c), right)), argnums=(0, 1))(diagonal, coupling)
    assert all(np.all(slope == 0.0) for slope in slopes)
    factor, weight = factorise(diagonal, coupling), jnp.arange(1.0, 7.0)
    slope = jax.grad(lambda side: jnp.vdot(weight, solve(factor, side)))(right)
    np.testing.assert_allclose(slope, solve(factor, weight), rtol=1e-12)
