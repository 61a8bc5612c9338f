"""Strengths of effects in noise of one kind, against generalised least squares written out."""

import numpy as np
import pytest

from arfjax import InputError
from inverse.diagnosis.level import require_level
from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.regression import Regression

COUNT = 40


def case(correlation):
    position = np.arange(COUNT, dtype=float)
    family = noise_family((series("time", [0] * COUNT, position),), position)
    noise = next(one for one in family if one.correlation == correlation and one.step == 1.0)
    fitted = np.stack([np.ones(COUNT), position], axis=-1)
    direction = np.exp(-(((position - 25.0) / 6.0) ** 2))
    return noise, fitted, direction


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_strength_and_error_are_those_of_generalised_least_squares(correlation):
    noise, fitted, direction = case(correlation)
    residuals = noise.colour(np.random.default_rng(3).standard_normal((COUNT, 1)))[:, 0] + 0.7 * direction
    covariance = correlation ** np.abs(np.subtract.outer(np.arange(COUNT), np.arange(COUNT)))
    columns = np.concatenate([direction[:, None], fitted], axis=1)
    weight = np.linalg.inv(covariance)
    inverse = np.linalg.inv(columns.T @ weight @ columns)
    expected = inverse @ columns.T @ weight @ residuals
    left = residuals - columns @ expected
    error = np.sqrt(inverse[0, 0] * (left @ weight @ left) / (COUNT - 3))
    found, (lower, upper) = Regression(residuals, fitted, noise).strength(direction)
    assert found == pytest.approx(expected[0], rel=1e-10)
    # Student's t of 37 degrees of freedom, at 97.5 %, from tables.
    assert [lower, upper] == pytest.approx([found - 2.0262 * error, found + 2.0262 * error], rel=1e-4)


def test_a_smooth_effect_has_to_be_larger_in_noise_that_is_smooth():
    (white, fitted, direction), (smooth, _, _) = case(0.0), case(0.8)
    drawn = np.random.default_rng(4).standard_normal((COUNT, 200))
    strengths = {
        name: [Regression(column, fitted, noise).strength(direction)[0] for column in noise.colour(drawn).T]
        for name, noise in (("white", white), ("smooth", smooth))
    }
    wider = np.std(strengths["smooth"]) / np.std(strengths["white"])
    predicted = Regression(drawn[:, 0], fitted, white).length(direction) / Regression(
        drawn[:, 0], fitted, smooth
    ).length(direction)
    # Of 200 draws a standard deviation is known to 5 %.
    assert wider == pytest.approx(predicted, rel=0.2) and predicted > 1.5


@pytest.mark.parametrize("wide", [0.2, 2.0])
def test_what_is_believed_of_constants_is_no_noise(wide):
    noise, fitted, direction = case(0.8)
    rng = np.random.default_rng(5)
    residuals = noise.colour(rng.standard_normal((COUNT, 1)))[:, 0]
    alone = Regression(residuals, fitted, noise)
    # Readings tell all but a millionth of the constants, so that beliefs take and give nothing.
    believed = np.append(residuals, wide * rng.standard_normal(2))
    together = Regression(believed, np.append(1e3 * fitted, np.eye(2), axis=0), noise.extended(2))
    assert together.size == pytest.approx(alone.size, rel=1e-4)
    found, interval = together.strength(np.append(direction, [0.0, 0.0]))
    expected, ends = alone.strength(direction)
    assert [found, *interval] == pytest.approx([expected, *ends], abs=1e-3 * (ends[1] - ends[0]))


def test_too_few_replicates_for_a_level_are_refused():
    require_level(0.05, 199)
    # Causes are ruled out at 1 %, whatever the level is.
    with pytest.raises(InputError, match="`replicates` must be 199 or more to show a level of 0.01, got 39"):
        require_level(0.05, 39)
    with pytest.raises(InputError, match="`replicates` must be 399 or more to show a level of 0.005"):
        require_level(0.005, 398)


def test_lower_levels_have_more_replicates():
    assert [require_level(level) for level in (0.5, 0.05, 0.01, 0.005)] == [400, 400, 2000, 4000]
    assert [require_level(level, few=True) for level in (0.05, 0.005)] == [1600, 16000]
    assert require_level(0.05, 199, few=True) == 199


@pytest.mark.parametrize("level", [0.004, 0.6, 1.0])
def test_a_level_that_means_nothing_is_refused(level):
    with pytest.raises(InputError, match="`level` must be from 0.005 to 0.5"):
        require_level(level)
