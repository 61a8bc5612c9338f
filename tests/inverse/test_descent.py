"""Minima driven from outside of JAX: exact on quadratics, honest about saddles, and never beyond a domain."""

import numpy as np
import pytest

from inverse.descent import Descent, descend, expand, polish, whitening

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


@pytest.mark.parametrize("curvature", [np.diag([1.0, -1.0]), -np.eye(2)])
def test_saddles_and_maxima_are_not_minima(curvature):
    """Where the gradient is exactly zero no step is taken; the curvature tells."""

    def saddle(x):
        return 0.5 * float(x @ curvature @ x), curvature @ x

    begun = Descent(np.zeros(2), 0.0, 0.0, 0)
    assert not polish(saddle, begun).converged


def test_differences_do_not_reach_beyond_a_domain():
    """Beyond the edge the function has no value but a gradient, of nothing: a curvature made of it would be wrong."""

    def edged(x):
        inside = x[0] < 1.0
        return (0.5 * float(x[0] ** 2) if inside else np.nan), (x if inside else np.full(1, 0.011))

    # The wide steps leave the domain and are dropped; at the edge itself nothing is left.
    np.testing.assert_allclose(expand(edged, np.array([0.99])).curvature, 1.0, rtol=1e-6)
    assert np.isnan(expand(edged, np.array([1.0 - 1e-5])).curvature)


def test_a_costly_start_does_not_make_nowhere_attractive():
    def steep(x):
        if x[0] > 60.0:
            return np.nan, np.full(1, np.nan)
        return 1e12 * float((x[0] - 50.0) ** 2), 2e12 * (x - 50.0)

    found = descend(steep, np.zeros(1))
    np.testing.assert_allclose(found.point, 50.0, rtol=1e-6)


def test_a_search_that_was_stopped_says_so():
    """Two steps do not reach the end of the valley; a search that ends by itself was not stopped."""
    short = descend(rosenbrock, np.array([-1.2, 1.0]), max_steps=2)
    assert short.out_of_steps and short.n_steps == 2 and not short.converged
    still = polish(rosenbrock, short, max_steps=1)
    assert still.out_of_steps and still.n_steps == 3 and not still.converged
    whole = polish(rosenbrock, descend(rosenbrock, np.array([-1.2, 1.0])))
    assert whole.converged and not whole.out_of_steps
    # With no step left, a minimum is still told from what is none.
    assert polish(rosenbrock, Descent(np.ones(2), 0.0, 0.0, 9), max_steps=0).converged
    assert not polish(rosenbrock, Descent(np.array([0.5, 0.2]), 1.0, 1.0, 9), max_steps=0).converged
