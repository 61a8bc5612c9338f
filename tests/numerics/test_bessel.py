"""Bessel functions against SciPy, for real and slightly complex arguments, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import special

from arfjax.numerics.bessel import SPLIT, bessel_j0, bessel_j1
from tests.checks import assert_gradient

REAL = np.concatenate([[0.0, 1e-9, SPLIT - 1e-12, SPLIT, SPLIT + 1e-12], np.linspace(0.0, 700.0, 20001)])


@pytest.mark.parametrize(("function", "order"), [(bessel_j0, 0), (bessel_j1, 1)])
@pytest.mark.parametrize("x", [REAL, REAL * (1.0 - 1e-3j)], ids=["real", "complex"])
def test_values_match_scipy(function, order, x):
    expected = special.jv(order, x)
    scale = np.exp(np.abs(np.imag(x)))
    np.testing.assert_allclose(function(jnp.asarray(x)) / scale, expected / scale, rtol=0.0, atol=2e-14)


@pytest.mark.parametrize("x", [0.0, 1.0, 7.999, 8.001, 300.0])
def test_gradient(x):
    x = jnp.asarray(x)
    np.testing.assert_allclose(jax.grad(bessel_j0)(x), -special.j1(float(x)), atol=1e-14)
    np.testing.assert_allclose(jax.grad(bessel_j1)(x), special.jvp(1, float(x)), atol=1e-13)
    assert_gradient(lambda y: bessel_j0(y + 0.3), x + 0.2)


def test_single_precision():
    x = jnp.linspace(0.0, 300.0, 1001, dtype=jnp.float32)
    value = bessel_j0(x)
    assert value.dtype == jnp.float32
    np.testing.assert_allclose(value, special.j0(np.asarray(x, dtype=float)), atol=3e-6)
