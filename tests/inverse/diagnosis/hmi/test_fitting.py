"""One fit: what of the data it looks at, and that a fit which the full simulation cannot judge is said to be none."""

import dataclasses

import numpy as np
import pytest

from inverse.diagnosis.hmi.correction import Correction
from inverse.diagnosis.hmi.fitting import Fitting
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.program import HmiProgram
from inverse.diagnosis.hmi.refit import again_from, fit_hmi, fit_in_full
from tests.inverse.diagnosis.hmi.cases import measured_with, white


def test_neighbours_of_a_reading_that_is_left_out_say_nothing_of_it(problem):
    """Nor does it of them: beyond it a series begins anew, whatever the correlation."""
    noise = next(one for one in problem.noise_family() if one.correlation == 0.6 and one.step == 1.0)
    used = ~np.isin(np.arange(len(problem.rows)), [4, 20])
    fitting = Fitting(problem, (), noise, 0.01, used)
    readings = np.random.default_rng(2).standard_normal((len(problem.rows), 3))
    other = np.where(used[:, None], readings, readings + 5.0)
    np.testing.assert_array_equal(fitting.free_of_factors(other), fitting.free_of_factors(readings))
    assert not np.any(fitting.free_of_factors(readings)[~used])
    # Each of the four parts is whitened as a series of its own.
    parts = np.split(np.arange(len(used)), [4, 5, 13, 20, 21])
    for part in (part for part in parts if np.all(used[part])):
        innovation = (readings[part][1:] - 0.6 * readings[part][:-1]) / 0.8
        np.testing.assert_allclose(fitting._white(readings)[part], np.append(readings[part][:1], innovation, axis=0))


@pytest.mark.parametrize("number", [0, 1])
def test_a_sonication_that_is_left_out_takes_nothing_from_the_others(problem, number):
    """They lose their own factor, and as many degrees of freedom as that and constants take of them."""
    used = problem.rows.sonication == number
    readings = np.random.default_rng(2).standard_normal((len(used), 3))
    found = Fitting(problem, (), white(problem), 0.01, used).free_of_factors(readings)
    np.testing.assert_allclose(found[used], readings[used] - np.mean(readings[used], axis=0), atol=1e-12)
    assert not np.any(found[~used])
    fit = fit_hmi(measured_with(problem, "", 0.0, noise=0.01)[0], (), white(problem), size=0.01, used=used)
    assert np.sum(used) - 1 - len(problem.program.constants) < fit.freedom < np.sum(used) - 1


@pytest.mark.parametrize("step", [1.0, 3.0])
def test_directions_of_beliefs_are_those_of_what_a_fit_makes_least(problem, step):
    """In coordinates in which the noise is white, where beliefs count against all readings together."""
    noise = next(one for one in problem.noise_family() if one.correlation == 0.0 and one.step == step)
    hidden, _ = measured_with(problem, "", 0.0, noise=0.01, seed=1)
    fit, count = fit_hmi(hidden, (), noise, size=0.01), len(problem.rows)
    fitting = Fitting(hidden, (), noise, 0.01)
    plain = np.zeros((count, len(fitting.moved)))
    slopes = fitting.stacked_slopes(plain, fit.unknowns)[count:]
    whitened = noise.whiten(fit.directions)[count:, : len(fitting.moved)]
    assert np.any(slopes)
    np.testing.assert_allclose(whitened, slopes, rtol=1e-12)
    np.testing.assert_allclose(noise.whiten(fit.residuals[:, None])[count:, 0], -fitting.stacked(fit.unknowns)[count:])


def test_a_fit_that_the_full_simulation_is_no_number_at_is_none(problem, monkeypatch):
    """Where it is corrected there is such a tissue, and where the fit then comes out there is none, time and again."""
    nothing, nowhere = np.zeros(len(problem.rows)), np.full(len(problem.rows), np.nan)
    monkeypatch.setattr(
        HmiDiagnosisProblem, "corrected_at",
        lambda self, at, moved: dataclasses.replace(
            self, correction=Correction(at, nothing, moved, np.outer(nothing, moved))
        ),
    )  # fmt: skip
    monkeypatch.setattr(HmiDiagnosisProblem, "left", lambda self, unknowns: nowhere)
    measured, _ = measured_with(problem, "output-drift", 1.0)
    fit = fit_in_full(measured, (), white(measured), size=1e-2, start=problem.program.null())
    assert not fit.converged and "no such tissue" in fit.status


@pytest.mark.parametrize(("size", "counts"), [(0.01, False), (0.1, True)])
def test_the_full_simulation_may_be_half_a_standard_deviation_of_the_noise_away(problem, monkeypatch, size, counts):
    """All readings together, where the fit leaves what the fast simulation covers."""
    nothing, none = np.zeros(len(problem.rows)), np.zeros(0, dtype=int)
    away = np.where(np.arange(len(problem.rows)) == 3, 0.03, 0.0)
    monkeypatch.setattr(HmiProgram, "excess", lambda self, unknowns: 1.5)
    monkeypatch.setattr(HmiDiagnosisProblem, "left", lambda self, unknowns: away)
    correction = Correction(problem.program.null(), nothing, none, np.outer(nothing, none))
    measured = dataclasses.replace(measured_with(problem, "", 0.0, noise=0.01)[0], correction=correction)
    fit = fit_hmi(measured, (), white(measured), size=size)
    assert fit.left == pytest.approx(0.03 / size) and fit.converged == counts
    assert counts or "the full simulation is 3.0 standard deviations of the noise away" in fit.status


def test_what_was_left_at_a_fit_is_known_of_the_same_fit_in_other_noise(problem):
    measured, _ = measured_with(problem, "", 0.0, noise=0.01)
    fit = dataclasses.replace(fit_hmi(measured, (), white(measured), size=0.01), left=0.7)
    assert again_from(fit, measured.noise_family()[-1], 0.01).left == 0.7
