"""What is said of the noise, on lines through repeated readings."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.noise_gate import Coordinates, Repeats, noise_gate
from inverse.diagnosis.screening import Screen

PLACES, REPEATED = 12, 4
AT = np.repeat(np.linspace(0.0, 1.0, PLACES), REPEATED)
LINE = np.column_stack([np.ones(len(AT)), AT])
FAMILY = noise_family((series("frequency", [0] * len(AT), AT),), 1.0 + 99.0 * AT, unit="Hz")


def scatter_of(data):
    groups = data.reshape(PLACES, REPEATED)
    freedom = PLACES * (REPEATED - 1)
    return Repeats(float(np.sqrt(np.sum((groups - groups.mean(axis=1)[:, None]) ** 2) / freedom)), freedom)


def gate_of(data, repeats=None):
    left = data - LINE @ np.linalg.lstsq(LINE, data)[0]
    return noise_gate(Screen(LINE, (), FAMILY), left, np.random.default_rng(1), stated=False, repeats=repeats)


@pytest.mark.parametrize("bend", [0.0, 2.0])
def test_lack_of_fit_is_that_of_the_textbook(bend):
    """Between means of repeats and the line, over the scatter of repeats: both counted apart from each other."""
    data = 3.0 * AT + bend * np.cos(6.0 * AT) + np.random.default_rng(4).standard_normal(len(AT))
    means = data.reshape(PLACES, REPEATED).mean(axis=1)
    fit = (LINE @ np.linalg.lstsq(LINE, data)[0])[::REPEATED]
    between, within = REPEATED * np.sum((means - fit) ** 2) / (PLACES - 2), scatter_of(data).scatter ** 2
    found = gate_of(data, scatter_of(data))
    assert found.p_repeats == pytest.approx(stats.f.sf(between / within, PLACES - 2, PLACES * (REPEATED - 1)))
    assert found.p_repeats < 1e-4 if bend else found.p_repeats > 0.05
    # By itself: a bend is seen by the other tests as well.
    alone = dataclasses.replace(found, p_white=1.0, p_tails=1.0, p_size=np.nan)
    assert alone.as_thought == (not bend) and ("repeated readings" in alone.describe()) == bool(bend)


def test_without_repeats_nothing_is_said_of_them():
    found = gate_of(np.random.default_rng(5).standard_normal(len(AT)))
    assert np.isnan(found.repeats) and np.isnan(found.p_repeats)
    for scatter in (0.0, 1e-15):  # the same reading written again, up to rounding
        again = gate_of(np.random.default_rng(5).standard_normal(len(AT)), Repeats(scatter, 3))
        assert np.isnan(again.p_repeats) and again.as_thought


@pytest.mark.parametrize(("size", "fits"), [(1.0, True), (0.3, False), (3.0, False)])
def test_noise_that_is_smaller_than_stated_is_not_as_thought_either(size, fits):
    data = size * np.random.default_rng(8).standard_normal(len(AT))
    left = data - LINE @ np.linalg.lstsq(LINE, data)[0]
    gate = noise_gate(Screen(LINE, (), FAMILY), left, np.random.default_rng(1), stated=True)
    assert gate.as_thought == fits and ("times the stated" in gate.describe()) == (not fits)


def test_the_likeliest_kind_is_called_the_noise_only_where_white_noise_is_improbable():
    rng = np.random.default_rng(6)
    white = gate_of(rng.standard_normal(len(AT)))
    assert white.as_thought and white.describe() == "nothing says that the noise is not white and of one size"
    loud = gate_of(rng.standard_normal(len(AT)) * np.where(AT > 0.5, 4.0, 1.0))
    assert not loud.as_thought and loud.describe().startswith("the noise is") and "Hz" in loud.describe()


@pytest.mark.parametrize("wide", [0.2, 1.0, 2.0])
def test_size_of_the_noise_is_that_of_readings_however_far_constants_are_from_what_is_believed(wide):
    rng = np.random.default_rng(7)
    # Of the line's constants the data tell all but a millionth, so that beliefs take and give nothing.
    fitted, family = np.append(1e3 * LINE, np.eye(2), axis=0), tuple(member.extended(2) for member in FAMILY)
    data = rng.standard_normal(len(AT))
    left = data - LINE @ np.linalg.lstsq(LINE, data)[0]
    gate = noise_gate(Screen(fitted, (), family), np.append(left, wide * rng.standard_normal(2)), rng, stated=True)
    assert gate.size == pytest.approx(np.sqrt(np.sum(left**2) / (len(AT) - 2)), rel=1e-5)
    beyond = stats.chi2.sf(np.sum(left**2), len(AT) - 2)
    assert gate.p_size == pytest.approx(2.0 * min(beyond, 1.0 - beyond), rel=1e-4)
    assert gate.kind == FAMILY[0].describe()
    assert gate.excess_kurtosis == pytest.approx(stats.kurtosis(left), rel=1e-3)


@pytest.mark.parametrize("phase", [1.0, 0.05])
def test_coordinates_of_other_size_are_no_tails(phase):
    """Gaussian both: together they look heavy-tailed where one is twenty times the other."""
    which = np.tile([0, 1], len(AT) // 2)
    data = np.random.default_rng(9).standard_normal(len(AT)) * np.where(which == 1, phase, 1.0)
    lines = np.column_stack([LINE * (which == 0)[:, None], LINE * (which == 1)[:, None]])
    left, screen = data - lines @ np.linalg.lstsq(lines, data)[0], Screen(lines, (), FAMILY[:1])
    two = Coordinates(("the magnitude", "the phase [rad]"), which, False, np.ones(2), np.nan)
    gate = noise_gate(screen, left, np.random.default_rng(1), stated=False, coordinates=two)
    assert gate.as_thought == (phase == 1.0) and gate.p_tails > 0.01
    assert gate.sizes["the magnitude"] / gate.sizes["the phase [rad]"] == pytest.approx(1.0 / phase, rel=0.6)
    assert ("where they weigh alike" in gate.describe()) == (phase != 1.0)
    factors = np.array([phase**-0.5, phase**0.5])
    divided = dataclasses.replace(two, weighed=True, factors=factors, p_alike=0.001)
    weighed = noise_gate(screen, left / factors[which], np.random.default_rng(1), stated=False, coordinates=divided)
    assert weighed.weighed and weighed.p_sizes == 0.001 and "each weighing by its own" in weighed.describe()
    assert list(weighed.sizes.values()) == pytest.approx(list(gate.sizes.values())) and weighed.p_tails > 0.01
    alone = noise_gate(screen, left, np.random.default_rng(1), stated=False)
    assert alone.sizes == {} and np.isnan(alone.p_sizes) and (alone.p_tails < gate.p_tails) == (phase != 1.0)
