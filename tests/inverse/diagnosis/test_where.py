"""Correlation of neighbouring residuals, counted pair by pair, and corrections of no name in their order."""

import numpy as np
import pytest

from inverse.diagnosis.evidence import evidence
from inverse.diagnosis.free_forms import Place
from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.screening import Alternative, Screen
from inverse.diagnosis.where import Axis, absorbed_by_places, whiteness

COUNT = 120
KEYS, FITTED = np.repeat([0, 1], COUNT // 2), np.ones((COUNT, 1))
POSITION = np.random.default_rng(1).permutation(COUNT).astype(float)
"""Data of a series are not in its order, and the second series does not begin where the first one ends."""


def correlated(rho, seed=2):
    """Of neighbours in each series by so much."""
    drawn = np.random.default_rng(seed).standard_normal(COUNT)
    for key in (0, 1):
        rows = np.flatnonzero(KEYS == key)
        rows = rows[np.argsort(POSITION[rows])]
        for before, row in zip(rows, rows[1:], strict=False):
            drawn[row] = rho * drawn[before] + np.sqrt(1.0 - rho**2) * drawn[row]
    return drawn


def neighbours():
    """Every pair, each once."""
    for key in (0, 1):
        rows = [row for row in range(COUNT) if KEYS[row] == key]
        for row in rows:
            later = [other for other in rows if POSITION[other] > POSITION[row]]
            if later:
                yield row, min(later, key=lambda other: POSITION[other])


def told(residuals, replicates=199, beliefs=0, keys=KEYS):
    fitted, axis = np.append(FITTED, np.zeros((beliefs, 1)), axis=0), Axis("time", keys, POSITION)
    return whiteness((axis,), residuals, fitted, np.random.default_rng(3), replicates=replicates)


@pytest.mark.parametrize(("rho", "conspicuous"), [(0.6, True), (-0.6, True), (0.0, False)])
def test_it_is_of_neighbours_in_a_series_and_conspicuous_to_either_side(rho, conspicuous):
    residuals = correlated(rho)
    (found,) = told(residuals)
    left = residuals - np.mean(residuals)
    expected = np.mean([left[one] * left[other] for one, other in neighbours()]) / np.mean(left**2)
    assert found.along == "time" and found.correlation == pytest.approx(expected, rel=1e-10)
    # 118 pairs: white noise is correlated by 0.09, so that 0.6 is six deviations.
    assert found.p_value == 1.0 / 200.0 if conspicuous else found.p_value > 0.05


def test_of_white_noise_p_values_are_as_they_should_be():
    found = [told(correlated(0.0, seed), replicates=99)[0].p_value for seed in range(100, 160)]
    # Of 60 a share of a half is known to 6 %, and a mean of evenly spread ones to 4 %.
    assert np.mean(found) == pytest.approx(0.5, abs=0.15) and 0.3 < np.mean(np.array(found) < 0.5) < 0.7


def test_beliefs_are_not_looked_at_and_a_coordinate_without_neighbours_says_nothing():
    residuals = correlated(0.6)
    (found,) = told(np.append(residuals, [50.0, -40.0]), beliefs=2)
    assert found.correlation == pytest.approx(told(residuals)[0].correlation, rel=1e-10)
    assert told(residuals, keys=np.arange(COUNT)) == ()


def test_corrections_come_by_how_improbable_they_are_with_what_each_of_them_takes():
    """A wave that is there before a ripple that is not; what is a cause is no correction of no name."""
    x = np.linspace(0.0, 1.0, COUNT)
    columns = {"ripple": np.cos(31.0 * x), "cause": x**2, "wave": np.sin(9.0 * x)}
    alternatives = [Alternative(name, column[:, None]) for name, column in columns.items()]
    screen = Screen(FITTED, alternatives, noise_family((series("time", [0] * COUNT, x),), x)[:1])
    data = columns["wave"] + np.random.default_rng(4).standard_normal(COUNT)
    tested = evidence(screen, data, np.random.default_rng(5), np.array([True, False, True]), 1.0, 100)
    found = absorbed_by_places(tested, [Place("ripple", "there"), Place("wave", "here")])
    assert [one.words for one in found] == ["here", "there"]
    left = data - np.mean(data)
    for one, name in zip(found, ("wave", "ripple"), strict=True):
        column = columns[name] - np.mean(columns[name])
        taken = column * (column @ left) / (column @ column)
        assert one.share == pytest.approx(1.0 - np.sum((left - taken) ** 2) / np.sum(left**2), rel=1e-9)
        np.testing.assert_allclose(one.correction, taken, atol=1e-9)
        assert one.p_family == tested.p_family[list(columns).index(name)]
