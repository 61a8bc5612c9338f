"""Inverses of small matrices against LAPACK, also where float32 would underflow."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.numerics.small_matrices import inverse_of_symmetric


@pytest.mark.parametrize(("dtype", "tolerance"), [(jnp.float32, 1e-5), (jnp.float64, 1e-13)])
def test_inverse_of_tiny_matrices(dtype, tolerance):
    factors = np.random.default_rng(0).normal(size=(3, 5, 3, 3))
    matrices = 1e-16 * (factors @ factors.swapaxes(-1, -2) + np.eye(3))
    ours = inverse_of_symmetric(jnp.asarray(np.moveaxis(matrices, (2, 3), (0, 1)), dtype))
    assert ours.dtype == dtype
    expected = np.moveaxis(np.linalg.inv(matrices), (2, 3), (0, 1))
    np.testing.assert_allclose(ours, expected, rtol=0.0, atol=tolerance * np.max(np.abs(expected)))


def test_complex_matrices():
    factors = np.random.default_rng(1).normal(size=(4, 3, 3))
    matrices = factors @ factors.swapaxes(-1, -2) + (1.0 + 2.0j) * np.eye(3)
    ours = inverse_of_symmetric(jnp.asarray(np.moveaxis(matrices, (1, 2), (0, 1))))
    np.testing.assert_allclose(np.moveaxis(ours, (0, 1), (1, 2)) @ matrices, np.tile(np.eye(3), (4, 1, 1)), atol=1e-13)
