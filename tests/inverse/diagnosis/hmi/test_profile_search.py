"""The search for an end of a profile, on profiles that are known in closed form."""

import numpy as np
import pytest

from inverse.diagnosis.hmi.bound_search import Trial, searched


def profile(risen, *, covered=float("inf")):
    """Trials of a profile whose bound is met where `risen` is 1; none farther than what is covered."""
    return lambda step: Trial(step, risen(step), np.zeros(1)) if step <= covered else None


@pytest.mark.parametrize("start", [0.3, 1.0, 3.0])
@pytest.mark.parametrize(
    "risen", [lambda step: step, lambda step: step**2, lambda step: step**0.5], ids=["line", "square", "root"]
)
def test_end_is_where_the_bound_is_met(risen, start):
    end = searched(profile(risen), start, 100.0)
    assert abs(end.risen - 1.0) < 0.05 and end.remark == ""


def test_end_is_where_the_strength_may_go_no_farther():
    end = searched(profile(lambda step: step), 0.3, 0.6)
    assert end.step == 0.6 and end.remark == ""
    # Where the farthest lies beyond the bound it is no end.
    end = searched(profile(lambda step: step / 0.4), 0.6, 0.6)
    assert abs(end.risen - 1.0) < 0.05 and end.remark == ""


def test_from_where_nothing_has_risen_the_next_is_three_times_as_far():
    steps = []
    end = searched(profile(lambda step: steps.append(step) or max(step - 0.5, 0.0)), 0.2, 100.0)
    np.testing.assert_allclose(steps[:2], [0.2, 0.6])
    assert abs(end.risen - 1.0) < 0.05


@pytest.mark.parametrize(("covered", "start"), [(1.5, 1.6), (0.98, 1.0), (1.2, 40.0)])
def test_a_trial_that_failed_is_no_end(covered, start):
    end = searched(profile(lambda step: step, covered=covered), start, 100.0)
    assert abs(end.risen - 1.0) < 0.05 and end.remark == ""


@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_where_no_fit_is_farther_the_end_is_there_and_that_is_said(unit):
    """As near to it, whatever the unit of the strength."""
    end = searched(profile(lambda step: step / unit, covered=0.7 * unit), unit, 100.0 * unit)
    assert 0.95 * 0.7 * unit <= end.step <= 0.7 * unit and "no farther" in end.remark


def test_an_end_that_is_not_found_is_said_to_be_none():
    assert "was not met" in searched(profile(lambda step: step), 1e-5, 100.0).remark
    # Between the trials next to the bound the profile leaps over it.
    leaping = searched(profile(lambda step: 0.5 if step < 1.0 else 3.0), 0.6, 100.0)
    assert leaping.step >= 1.0 and "was not met" in leaping.remark
    assert searched(lambda _: None, 1.0, 100.0) is None


def test_there_are_no_more_trials_than_may_be():
    steps = []
    end = searched(profile(lambda step: steps.append(step) or step), 0.01, 100.0, most=2)
    assert steps == [0.01, 0.03] and end.remark == "was not met in 2 trials."


def test_after_a_trial_far_beyond_the_bound_the_next_is_a_third_as_far():
    """The line through it and the estimate would lead to next to nothing where the profile bends upwards."""
    steps = []
    end = searched(profile(lambda step: steps.append(step) or step**4), 9.0, 100.0)
    np.testing.assert_allclose(steps[:2], [9.0, 3.0])
    assert abs(end.risen - 1.0) < 0.05


def test_what_is_to_be_said_of_a_trial_is_said_of_the_end():
    def remarked(risen, covered=float("inf")):
        return lambda step: Trial(step, risen(step), np.zeros(1), "is in doubt.") if step <= covered else None

    assert searched(remarked(lambda step: step), 0.9, 100.0).remark == "is in doubt."
    assert searched(remarked(lambda step: 0.5 if step < 1.0 else 3.0), 0.6, 100.0).remark == "is in doubt."
    assert searched(remarked(lambda step: step, covered=0.7), 1.0, 100.0).remark == "is in doubt."
