"""Smooth corrections are the Gaussian processes that they are said to be."""

import numpy as np
import pytest

from inverse.diagnosis.free_forms import LENGTHS, process


@pytest.mark.parametrize("length", LENGTHS)
def test_covariance_is_that_of_a_gaussian_process_away_from_the_ends(length):
    x = np.linspace(0.0, 1.0, 201)
    # From 3 to 10: the unit of the coordinate does not count.
    basis = process(3.0 + 7.0 * x, length)
    covariance = basis @ basis.T
    inside = (x > 0.5 * length) & (x < 1.0 - 0.5 * length)
    middle = len(x) // 2
    found = covariance[middle, inside] / covariance[middle, middle]
    images = [np.exp(-0.5 * ((0.5 - (sign * x + shift)) / length) ** 2)
              for sign, shift in ((1.0, 0.0), (-1.0, 0.0), (-1.0, 2.0), (1.0, 2.0), (1.0, -2.0))]  # fmt: skip
    expected = np.sum(images, axis=0) + _level(length)
    np.testing.assert_allclose(found, (expected / expected[middle])[inside], atol=0.01)


def _level(length: float) -> float:
    """The constant cosine counts in full, where the images alone have half of it: a level is believed more."""
    return np.sqrt(2.0 * np.pi) * length


def test_columns_are_spread_less_the_finer_they_are():
    basis = process(np.linspace(0.0, 1.0, 50), 0.2)
    lengths = np.max(np.abs(basis), axis=0)
    assert np.all(np.diff(lengths) < 0.0) and lengths[0] == 1.0 and lengths[-1] < 0.1
