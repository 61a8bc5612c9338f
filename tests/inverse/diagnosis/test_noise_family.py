import numpy as np
import pytest

from inverse.diagnosis.noise import Noise, noise_family, series
from inverse.diagnosis.screening import Screen

POSITIONS = np.array([3.0, 1.0, 2.0, 4.0, 1.5, 0.5])
KEYS = ["a", "a", "a", "a", "b", "b"]
COORDINATE = np.array([3.0, 1.0, 2.0, 4.0, 1.5, 0.5])


def covariance(noise: Noise) -> np.ndarray:
    """From the definition: deviations, and powers of the correlation within each series."""
    count = len(POSITIONS)
    deviation = np.exp(noise.log_deviation)
    rank = {}
    for key in set(KEYS):
        members = [i for i in range(count) if KEYS[i] == key]
        for place, index in enumerate(sorted(members, key=lambda i: POSITIONS[i])):
            rank[index] = place
    return np.array(
        [
            [
                deviation[i]
                * deviation[j]
                * (noise.correlation ** abs(rank[i] - rank[j]) if KEYS[i] == KEYS[j] else 0.0)
                for j in range(count)
            ]
            for i in range(count)
        ]
    )


@pytest.fixture(scope="module")
def family():
    return noise_family([series("frequency", KEYS, POSITIONS)], COORDINATE)


def test_whitening_makes_the_covariance_the_identity(family):
    assert any(n.correlation for n in family) and any(n.step != 1.0 for n in family)
    for noise in family:
        root = noise.whiten(np.eye(6))
        np.testing.assert_allclose(root @ covariance(noise) @ root.T, np.eye(6), atol=1e-12)
        np.testing.assert_allclose(noise.colour(root), np.eye(6), atol=1e-12)
        assert noise.log_determinant == pytest.approx(np.linalg.slogdet(covariance(noise))[1], abs=1e-12)


def test_first_member_is_white_and_costs_nothing(family):
    assert family[0].is_white and family[0].log_prior == 0.0
    assert all(n.log_prior < 0.0 and not n.is_white for n in family[1:])
    assert "times larger above" in " ".join(n.describe() for n in family)


def test_a_step_is_told_from_the_side_that_is_louder(family):
    """As large as it is, at a place between the data on both sides of it."""
    order = series("frequency", KEYS, POSITIONS)
    told = [Noise(0.0, order, np.zeros(6), -2.5, step, 57.31, "Hz").describe() for step in (3.0, 1.0 / 3.0)]
    assert told == ["3 times larger above 57.3 Hz", "3 times larger below 57.3 Hz"]
    both = Noise(0.6, order, np.zeros(6), -4.0, 1.0 / 1.7, 57.31, "Hz").describe()
    assert both == "1.7 times larger below 57.3 Hz, correlated by 0.6 between neighbours along frequency"
    steps = [one for one in family if one.step != 1.0]
    assert steps
    for one in steps:
        above, deviation = COORDINATE > one.place, np.exp(one.log_deviation)
        np.testing.assert_allclose(deviation[above] / np.mean(deviation[~above]), one.step)


def test_neighbours_are_within_a_series_and_in_order():
    np.testing.assert_array_equal(series("frequency", KEYS, POSITIONS).previous, [2, -1, 1, 0, 5, -1])


def constants_told_by_readings(near, count, rng):
    """White readings at 19 temperatures in three series, nine constants that they tell ten times as well as beliefs."""
    temperature, group = np.tile(np.linspace(38.0, 76.0, 19), 3), np.repeat(np.arange(3), 19)
    waves = np.stack([np.cos(np.pi * k * (temperature - 38.0) / 38.0) for k in range(1, 10)], axis=-1)
    factors = np.append((group[:, None] == np.arange(3)).astype(float), np.zeros((9, 3)), axis=0)
    fitted = np.append(np.append(10.0 * waves, np.eye(9), axis=0), factors, axis=1)
    family = noise_family((series("time", group.tolist(), temperature),), temperature, unit="degC")
    drawn = rng.standard_normal((57 + 9, count))
    drawn[57:] *= near
    return fitted, [one.extended(9) for one in family], drawn, temperature


@pytest.mark.parametrize("near", [0.3, 1.0])
def test_constants_nearer_to_their_middle_than_is_believed_are_no_louder_readings(near):
    fitted, family, drawn, _ = constants_told_by_readings(near, 200, np.random.default_rng(1))
    _, member, _ = Screen(fitted, (), family).noise_evidence(drawn)
    # Of white noise a step is the likeliest in 15 of 100, +- 3 here; with beliefs of deviation 1 in 96 where 0.3.
    assert np.mean([family[one].step > 1.0 for one in member]) < 0.25


def test_beliefs_weigh_against_all_readings_and_louder_ones_are_met():
    fitted, family, drawn, temperature = constants_told_by_readings(1.0, 200, np.random.default_rng(2))
    loud = np.where(temperature > 57.0, 3.0, 1.0)
    drawn[:57] *= loud[:, None]
    drawn[57:] *= np.sqrt(np.mean(loud**2))
    _, member, _ = Screen(fitted, (), family).noise_evidence(drawn)
    # In 93 of 100; with beliefs of deviation 1 in 50.
    assert np.mean([family[one].step == 3.0 for one in member]) > 0.85
    step = next(one for one in family if one.step == 3.0 and one.place > 57.0)
    readings = np.exp(step.log_deviation[:57])
    assert step.loudness == pytest.approx(np.sqrt(np.mean(readings**2)))
    np.testing.assert_allclose(np.exp(step.log_deviation[57:]), step.loudness)
