"""Shape functions and quadrature: exact for the polynomials that they claim."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.numerics.elements import linear_pressure, product, quadratic, quadratic_slope
from arfjax.numerics.quadrature import gauss_legendre


def test_quadratic_functions_reproduce_a_parabola_and_its_slope():
    x = np.linspace(-1.0, 1.0, 7)
    nodes = jnp.array([-1.0, 0.0, 1.0])
    at_nodes = 2.0 - nodes + 3.0 * nodes**2
    np.testing.assert_allclose(quadratic(x) @ at_nodes, 2.0 - x + 3.0 * x**2, atol=1e-14)
    np.testing.assert_allclose(quadratic_slope(x) @ at_nodes, -1.0 + 6.0 * x, atol=1e-14)


def test_products_run_over_r_first():
    table = product(quadratic(np.array([-1.0, 1.0])), quadratic(np.array([0.0])))
    expected = np.zeros((2, 9))
    expected[0, 3] = expected[1, 5] = 1.0  # middle row of nodes: left and right end
    np.testing.assert_allclose(table, expected, atol=1e-15)
    pressure = linear_pressure(np.array([-1.0, 1.0]), np.array([0.5]))
    np.testing.assert_allclose(pressure, [[1.0, -1.0, 0.5], [1.0, 1.0, 0.5]])


@pytest.mark.parametrize("n_points", [1, 2, 3, 5])
def test_gauss_rule_is_exact_up_to_its_degree(n_points):
    points, weights = gauss_legendre(n_points)
    for degree in range(2 * n_points):
        exact = (1.0 - (-1.0) ** (degree + 1)) / (degree + 1)
        np.testing.assert_allclose(weights @ points**degree, exact, atol=1e-14)
    assert abs(weights @ points ** (2 * n_points) - 2.0 / (2 * n_points + 1)) > 1e-4


def test_a_rule_without_points_is_refused():
    with pytest.raises(ValueError, match="n_points"):
        gauss_legendre(0)
