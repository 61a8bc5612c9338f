"""What a correction makes of a fast simulation: the full one to first order, where it was taken."""

import numpy as np

from inverse.diagnosis.hmi.correction import Correction

POINTS = np.linspace(0.5, 2.0, 7)
ABOUT = np.array([0.4, 1.5, 0.3])
MOVED = np.array([2, 0])
"""The second unknown stays where it is."""


def fast(unknowns):
    return unknowns[0] * POINTS + np.exp(unknowns[2] * POINTS) * unknowns[1]


def full(unknowns):
    return fast(unknowns) + np.sin(unknowns[2] * POINTS) + unknowns[0] ** 2 * unknowns[1]


def slope_of(function, at, place):
    step = 1e-5 * np.eye(3)[place]
    return (function(at + step) - function(at - step)) / 2e-5


def taken():
    columns = np.stack([slope_of(lambda at: full(at) - fast(at), ABOUT, place) for place in MOVED], axis=-1)
    return Correction(ABOUT, full(ABOUT) - fast(ABOUT), MOVED, columns)


def corrected(unknowns):
    return fast(unknowns) + taken()(unknowns)


def test_value_and_derivatives_are_those_of_the_full_one():
    np.testing.assert_allclose(corrected(ABOUT), full(ABOUT), rtol=1e-12)
    for place in MOVED:
        np.testing.assert_allclose(slope_of(corrected, ABOUT, place), slope_of(full, ABOUT, place), atol=1e-8)


def test_what_is_left_is_of_second_order():
    away = np.array([0.2, 0.0, -0.3])
    left = [np.max(np.abs(corrected(ABOUT + h * away) - full(ABOUT + h * away))) for h in (0.1, 0.05)]
    assert 3.5 < left[0] / left[1] < 4.5


def test_slopes_are_those_of_the_value_and_0_where_none_is_known():
    found = taken().slopes([0, 1, 2])
    for place in range(3):
        np.testing.assert_allclose(found[:, place], slope_of(taken(), ABOUT, place), atol=1e-9)
    assert not np.any(found[:, 1])


def test_it_says_when_one_of_the_simulations_could_not_be_made():
    assert taken().is_finite
    for value, columns in ((np.nan, 0.0), (0.0, np.inf)):
        broken = Correction(ABOUT, np.full(7, value), MOVED, np.full((7, 2), columns))
        assert not broken.is_finite
