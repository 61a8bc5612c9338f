"""Interpolation weights: exact for cubics, fourth order, and differentiable in points and nodes."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.numerics.interpolation import interpolation_weights
from tests.checks import assert_gradient, assert_order

NODES = np.asarray([0.0, 0.1, 0.4, 0.45, 1.0, 1.7, 2.0])


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
def test_polynomials_of_the_stencil_s_degree_are_exact(count):
    points = jnp.asarray([-0.2, 0.0, 0.05, 0.3, 0.45, 1.3, 2.0, 2.3])
    degree = min(count, 4) - 1
    values = np.polyval(np.arange(1.0, degree + 2.0), NODES[:count])
    got = interpolation_weights(points, NODES[:count]) @ values
    np.testing.assert_allclose(got, np.polyval(np.arange(1.0, degree + 2.0), points), rtol=1e-11)


def test_half_way_between_even_nodes_the_two_nearest_on_each_side_count():
    between = interpolation_weights(jnp.asarray([2.5, 3.5]), np.arange(7.0))
    nearest = np.array([-1.0, 9.0, 9.0, -1.0]) / 16.0
    np.testing.assert_allclose(between, [[0.0, *nearest, 0.0, 0.0], [0.0, 0.0, *nearest, 0.0]], atol=1e-15)


def test_order():
    points, errors, counts = jnp.linspace(0.0, 1.0, 401), [], (20, 40, 80, 160)
    for n in counts:
        nodes = np.linspace(0.0, 1.0, n + 1) ** 1.5
        errors.append(
            float(jnp.abs(interpolation_weights(points, nodes) @ np.exp(nodes * 2.0) - jnp.exp(2.0 * points)).max())
        )
    assert_order([1.0 / n for n in counts], errors, order=4.0)


def test_gradient():
    def total(both):
        points, nodes = both
        return jnp.sum(jnp.sin(interpolation_weights(points, nodes) @ jnp.exp(-nodes)))

    assert_gradient(total, (jnp.asarray([0.23, 0.51, 1.91]), jnp.asarray(NODES)), step=1e-4)
