"""Minima driven from outside of JAX: exact on quadratics, honest about saddles, and never beyond a domain."""

import numpy as np
import pytest

from inverse.descent import descend, expand, polish, whitening

CURVATURE = np.array([[4e6, 1e3, 0.0], [1e3, 2.0, 0.1], [0.0, 0.1, 1e-2]])
MINIMUM = np.array([1e-3, -2.0, 30.0])


def quadratic(x):
    away = x - MINIMUM
    return 0.5 * float(away @ CURVATURE @ away) + 7.0, CURVATURE @ away


def rosenbrock(x):
    a, b = x
    return (1.0 - a) ** 2 + 100.0 * (b - a**2) ** 2, np.array(
        [-2.0 * (1.0 - a) - 400.0 * a * (b - a**2), 200.0 * (b - a**2)]
    )


def test_a_quadratic_is_expanded_exactly():
    found = expand(quadratic, np.zeros(3))
    np.testing.assert_allclose(found.curvature, CURVATURE, rtol=1e-8, atol=1e-10 * 4e6)
    np.testing.assert_allclose(found.slope, -CURVATURE @ MINIMUM, rtol=1e-12)
    axes = whitening(CURVATURE)
    # The flattest direction counts as curving by a tenth.
    np.testing.assert_allclose(np.sort(np.diag(axes.T @ CURVATURE @ axes))[1:], 1.0, rtol=1e-6)


def test_differences_are_of_the_fourth_order_in_units_of_the_scale():
    """A cubic and a quartic term: the former's second derivative is exact, the latter's to the fourth order."""

    def quartic(x):
        return float(x[0] ** 3 + x[0] ** 4), np.array([3.0 * x[0] ** 2 + 4.0 * x[0] ** 3])

    for scale in (None, np.array([1e-3])):
        found = expand(quartic, np.array([0.5]), scale)
        np.testing.assert_allclose(found.curvature, [[3.0 + 3.0]], rtol=1e-8)


def test_a_valley_is_followed_to_its_end():
    found = polish(rosenbrock, descend(rosenbrock, np.array([-1.2, 1.0])))
    assert found.converged and found.n_steps > 5
    np.testing.assert_allclose(found.point, 1.0, rtol=1e-8)


def test_a_flat_direction_is_minimised_too():
    found = polish(quadratic, descend(quadratic, np.zeros(3)))
    assert found.converged
    np.testing.assert_allclose(found.point, MINIMUM, rtol=1e-5)
    assert found.value == pytest.approx(7.0, abs=1e-9)


def test_a_search_turns_back_where_there_is_no_value():
    """The minimum of x - log x is at 1; from 4 the first step of a Newton method leads to minus 8."""

    def barrier(x):
        if x[0] <= 0.0:
            return np.nan, np.array([np.nan])
        return float(x[0] - np.log(x[0])), 1.0 - 1.0 / x

    found = polish(barrier, descend(barrier, np.array([4.0])))
    assert found.converged
    np.testing.assert_allclose(found.point, 1.0, rtol=1e-6)


def test_what_has_no_minimum_is_not_said_to_have_one():
    def slope(x):
        return float(x[0]), np.ones(1)

    def nowhere(x):
        return np.nan, np.full(1, np.nan)

    assert not polish(slope, descend(slope, np.zeros(1))).converged
    lost = descend(nowhere, np.zeros(1))
    assert not lost.converged and lost.value == np.inf
    assert not polish(nowhere, lost).converged
