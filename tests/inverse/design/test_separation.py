"""How well causes are told apart: what turning, scaling and certainty do to it."""

import numpy as np
import pytest
from scipy import stats

from inverse.design.separation import separation

RNG = np.random.default_rng(8)
FITTED, DIRECTIONS = RNG.standard_normal((30, 2)), RNG.standard_normal((30, 3))


def told(directions, strengths, signs, size=1.0):
    names = "abc"[: len(strengths)]
    return separation(tuple(names), directions, np.array(strengths), FITTED, size, signs)


@pytest.mark.parametrize("signs", [(0, 0, 0), (0, 1, 0), (0, 1, 1)])
def test_a_negative_strength_is_the_positive_one_of_what_goes_the_other_way(signs):
    way = np.array([-1.0, 1.0, 1.0 if signs[2] else -1.0])
    ours, theirs = told(DIRECTIONS, way * [0.3, 0.2, 0.4], signs), told(way * DIRECTIONS, [0.3, 0.2, 0.4], signs)
    for name in ("d_prime", "cosine", "right", "worst", "angle", "closest"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    assert np.all(ours.d_prime > 0.0)


def test_a_cause_that_cannot_be_positive_is_told_as_one_that_cannot_be_negative_the_other_way():
    ours = told(DIRECTIONS[:, :2], [-0.3, 0.2], (-1, 1))
    theirs = told(DIRECTIONS[:, :2] * [-1.0, 1.0], [0.3, 0.2], (1, 1))
    np.testing.assert_array_equal(ours.right, theirs.right)
    np.testing.assert_array_equal(ours.cosine, theirs.cosine)


def test_a_weak_cause_is_mistaken_for_a_strong_one_more_often_than_the_strong_one_for_it():
    """By the distance of the true one: of two at right angles, that of d' 1 is right in 76 of 100 cases."""
    two = separation(("weak", "strong"), np.eye(4)[:, :2], np.array([1.0, 5.0]), np.zeros((4, 0)), 1.0, (1, 1))
    np.testing.assert_allclose(two.right[0, 1], stats.norm.cdf(np.sqrt(0.5)))
    np.testing.assert_allclose(two.right[1, 0], stats.norm.cdf(5.0 * np.sqrt(0.5)))
    assert two.worst == two.right[0, 1] and two.closest == (0, 1)


def test_what_is_hardest_to_tell_apart_are_two_causes_even_where_all_are_told_apart_for_certain():
    certain = told(1e6 * DIRECTIONS, [1.0, 1.0, 1.0], (1, 1, 1))
    assert certain.worst == 1.0 and certain.closest[0] != certain.closest[1]
    # Of three, the two that are alike.
    alike = DIRECTIONS.copy()
    alike[:, 2] = alike[:, 1] + 0.1 * alike[:, 0]
    assert set(told(alike, [0.3, 0.3, 0.3], (1, 1, 1)).closest) == {1, 2}


def test_noise_of_twice_the_size_halves_the_distances_and_turns_nothing():
    once, twice = told(DIRECTIONS, [0.3, 0.2, 0.4], (0, 1, 0)), told(DIRECTIONS, [0.3, 0.2, 0.4], (0, 1, 0), size=2.0)
    np.testing.assert_allclose(twice.d_prime, 0.5 * once.d_prime, rtol=1e-12)
    np.testing.assert_array_equal(twice.cosine, once.cosine)


def test_of_one_cause_alone_nothing_is_to_be_told_apart():
    one = told(DIRECTIONS[:, :1], [0.3], (1,))
    assert np.isnan(one.worst) and np.isnan(one.angle)
