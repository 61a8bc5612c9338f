"""Least squares without derivatives but the first."""

import numpy as np
import pytest

from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.examination import DETECTABLE
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.problem import Effect
from inverse.diagnosis.hmi.rough_fit import Followed, RoughFit, _RoughFitting, _worth_asking
from inverse.diagnosis.noise import Noise, Ordering
from tests.inverse.diagnosis.hmi.cases import bare

FREE = np.array([-np.inf, -np.inf, -np.inf]), np.array([np.inf, np.inf, np.inf])
TIMES = np.linspace(0.0, 1.0, 20)


def straight(seed=0):
    rng = np.random.default_rng(seed)
    slopes, first = rng.standard_normal((20, 3)), rng.standard_normal(20)
    return slopes, first


def test_of_what_is_straight_it_is_the_solution_within_bounds():
    slopes, first = straight()
    best = np.linalg.lstsq(slopes, -first, rcond=None)[0]
    bounded = np.append(best[0] + 1.0, np.linalg.lstsq(slopes[:, 1:], -first - slopes[:, 0] * (best[0] + 1.0))[0])
    for lower, wanted in ((FREE[0], best), (np.array([best[0] + 1.0, -np.inf, -np.inf]), bounded)):
        followed = Followed(lambda point: first + slopes @ point, first, slopes)
        followed.descend(lower, FREE[1])
        np.testing.assert_allclose(followed.best, wanted, atol=1e-9)
        np.testing.assert_allclose(followed.lowest, first + slopes @ wanted, atol=1e-9)


def bent(point):
    """An exponential of time less one of other constants: with the first derivative throughout, 4 % are left."""
    height, rate, base = 1.0 + point[0], 2.0 * (1.0 + point[1]), point[2]
    return height * np.exp(-rate * TIMES) + base - (1.4 * np.exp(-4.4 * TIMES) + 0.1)


def test_of_what_bends_eight_steps_leave_next_to_nothing():
    step = 1e-6 * np.eye(3)
    slopes = np.column_stack([(bent(one) - bent(-one)) / 2e-6 for one in step])
    followed = Followed(bent, bent(np.zeros(3)), slopes)
    followed.descend(*FREE)
    begun, linear = np.sum(bent(np.zeros(3)) ** 2), np.linalg.lstsq(slopes, -bent(np.zeros(3)))[0]
    # A direction is wanted within a few percent; the step along the first derivative makes it worse.
    assert followed.lowest @ followed.lowest < 1e-3 * begun < begun < np.sum(bent(linear) ** 2)
    np.testing.assert_allclose(followed.best, [0.4, 1.2, 0.1], atol=0.05)


def test_steps_to_where_there_is_nothing_are_taken_back():
    slopes, first = straight()

    def value(point):
        return first + slopes @ point if np.all(np.abs(point) < 0.3) else np.full(len(first), np.nan)

    followed = Followed(value, first, slopes)
    followed.descend(*FREE)
    assert followed.best is not None
    assert followed.lowest @ followed.lowest < first @ first


def test_steps_that_are_taken_back_stay_within_bounds():
    """A strength that is at least one, where there is nothing as far as the first step would take the constants."""
    slopes, first = straight()
    lower, asked = np.array([1.0, -np.inf, -np.inf]), []

    def value(point):
        asked.append(point)
        return first + slopes @ point if np.all(np.abs(point[1:]) < 0.1) else np.full(len(first), np.nan)

    followed = Followed(value, first, slopes)
    followed.descend(lower, FREE[1])
    assert len(asked) > 2 and all(point[0] >= 1.0 for point in asked)
    assert followed.best is not None


def test_after_a_step_the_derivative_is_one_with_which_it_comes_true():
    """However long the step, and nothing changes across it."""
    slopes = np.column_stack([np.exp(-TIMES), TIMES, np.ones(20)])
    followed = Followed(bent, bent(np.zeros(3)), slopes)
    points = [np.zeros(3), np.array([0.2, 0.1, 0.0]), np.array([0.25, 0.1, 0.3])]
    for before, after in zip(points, points[1:], strict=False):
        known, step = followed._known(before), after - before
        change = followed.value(after) - bent(before)
        np.testing.assert_allclose(followed._known(after) @ step, change, atol=1e-12)
        across = np.cross(step, [0.3, -0.5, 0.8])
        np.testing.assert_allclose(followed._known(after) @ across, known @ across, atol=1e-12)


@pytest.mark.filterwarnings("error")
def test_where_there_is_nothing_at_all_there_is_no_best_point():
    slopes, first = straight()
    followed = Followed(lambda point: np.full(len(first), np.nan), first, slopes)
    followed.descend(*FREE)
    assert followed.best is None


def test_the_full_simulation_is_asked_of_what_gains_and_of_what_lies_along_residuals_in_turn():
    """A gain of t = 2 at least, as a share where few readings are to spare; of a fit that failed nothing is asked."""
    rng = np.random.default_rng(4)
    ones, *ways, rest = np.linalg.qr(np.column_stack([np.ones(20), rng.standard_normal((20, 5))]))[0].T
    residuals = 4.0 * rest - 6.0 * ways[3] + 4.0 * ways[0]
    null = bare(HmiFit, directions=ones[:, None], residuals=residuals)
    # t is 2.1, 3.5, 1.9 and 0.4 with three readings to spare.
    misfits = {"gains": 8.0, "gains-more": 5.0, "hardly-gains": 9.1, "in-the-way": 19.0}
    fits = [
        RoughFit(Effect(name, way[:, None], 0), np.zeros(1), 1.0, misfit)
        for (name, misfit), way in zip(misfits.items(), ways, strict=True)
    ]
    failed = RoughFit(Effect("failed", residuals[:, None], 0), np.zeros(1), 0.0, np.inf)
    white = Noise(0.0, Ordering("time", np.full(20, -1)), np.zeros(20), 0.0, 1.0, np.nan)
    asked = _worth_asking(bare(HmiFit, misfit=20.0, freedom=3.0), [*fits, failed], null, (white,))
    assert [fit.alternative.name for fit in asked] == ["gains-more", "in-the-way", "gains"]


@pytest.mark.parametrize(("taken_at", "size", "expected"), [(0.0, 1.0, 1.0), (-4.0, 1.0, 2.0), (0.0, 9.0, 4.0)])
def test_a_strength_begins_where_it_would_be_detected_and_no_farther_than_effects_are_followed(
    taken_at, size, expected
):
    """In plausible strengths; an effect that was taken too far, and is too long there, grows with their square."""
    cause = next(cause for cause in HMI_CAUSES if cause.name == "output-drift")
    fitting, direction = object.__new__(_RoughFitting), np.array([[1.0], [-1.0], [0.0]]) / cause.plausible
    fitting._begun, fitting._spread = bare(HmiFit, directions=np.ones((3, 1))), size * np.sqrt(2.0) / DETECTABLE
    effect = Effect(cause.name, direction, -1, reach=taken_at * cause.plausible)
    assert fitting._reach(effect, cause) == pytest.approx(expected)
