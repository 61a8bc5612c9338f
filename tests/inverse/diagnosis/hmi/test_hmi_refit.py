"""Fits of the simulation with causes in it: what went in comes out, and data in percent are what they are."""

import dataclasses

import numpy as np
import pytest

from arfjax import InputError
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.courses import hmi_rows
from inverse.diagnosis.hmi.prepare import correction_at
from inverse.diagnosis.hmi.refit import alternatives_at, fit_hmi
from inverse.diagnosis.noise import noise_family
from tests.inverse.diagnosis.hmi.cases import TEMPERATURES, curves

DRIFT, POSITION = "output-drift", "thermocouple-position"


def measured_with(problem, name, strength, *, seed=0, noise=0.0, spread=0.3):
    """The problem with data of its own simulation, other constants and a cause in it."""
    program, rng = problem.program, np.random.default_rng(seed)
    unknowns = program.null()
    unknowns[program.constants] += spread * 0.3 * rng.standard_normal(len(program.start))
    if name:
        unknowns[program.place(name)] = strength
    logarithm = program.predict(unknowns) + noise * rng.standard_normal(len(problem.rows))
    # Another factor of each sonication, as a curve that is divided by one of its readings has.
    logarithm = logarithm + problem.factors @ np.array([0.3, -0.7])
    return dataclasses.replace(problem, rows=dataclasses.replace(problem.rows, log_displacement=logarithm)), unknowns


def white(problem):
    return noise_family(problem.orderings(), problem.coordinate())[0]


@pytest.mark.parametrize(("name", "strength"), [(DRIFT, 1.5), (POSITION, 0.6), ("perfusion", -0.4)])
def test_strength_that_went_in_comes_out(problem, name, strength):
    hidden, _ = measured_with(problem, name, strength)
    cause = next(cause for cause in problem.program.causes if cause.name == name)
    # So small a noise that the priors weigh nothing.
    fit = fit_hmi(hidden, (Extension(cause, 0.0),), white(hidden), size=1e-6)
    assert fit.converged and fit.excess <= 1.0
    assert np.sqrt(fit.misfit / len(hidden.rows)) < 1e-5
    np.testing.assert_allclose(fit.strengths, [strength * cause.plausible], rtol=2e-3)


def test_interval_holds_the_strength_and_the_fit_without_the_cause_is_worse(problem):
    hidden, _ = measured_with(problem, DRIFT, 3.0, noise=0.005, seed=1)
    cause = next(cause for cause in problem.program.causes if cause.name == DRIFT)
    null = fit_hmi(hidden, (), white(hidden), size=0.005)
    fit = fit_hmi(hidden, (Extension(cause, 0.0),), white(hidden), size=0.005, start=null.unknowns)
    assert fit.misfit < null.misfit
    assert fit.intervals[0, 0] <= 3.0 * cause.plausible <= fit.intervals[0, 1]


def test_rows_left_out_say_nothing(problem):
    hidden, _ = measured_with(problem, "", 0.0)
    used = np.arange(len(hidden.rows)) % 3 > 0
    logarithm = hidden.rows.log_displacement + np.where(used, 0.0, 5.0)
    spoilt = dataclasses.replace(hidden, rows=dataclasses.replace(hidden.rows, log_displacement=logarithm))
    fit = fit_hmi(spoilt, (), white(spoilt), size=1e-6, used=used)
    assert np.max(np.abs(fit.residuals[used])) < 1e-5 and np.min(fit.residuals[~used]) > 4.9


def test_slopes_that_were_followed_end_where_exact_ones_do(problem):
    hidden, _ = measured_with(problem, DRIFT, 2.0, noise=0.01, seed=2)
    fit = fit_hmi(hidden, (), white(hidden), size=0.01)
    basis = np.linalg.qr(hidden.factors)[0]
    projected = fit.directions[:, : len(hidden.program.start)]
    projected = projected - basis @ (basis.T @ projected)
    penalties = 0.01**2 * hidden.program.penalty_slopes(fit.unknowns)[:, hidden.program.constants].T
    gradient = penalties @ hidden.program.penalties(fit.unknowns) - projected.T @ fit.residuals
    scale = np.linalg.norm(projected, axis=0) * np.linalg.norm(fit.residuals) + 0.01**2
    assert np.max(np.abs(gradient) / scale) < 0.02


def test_alternatives_count_in_the_causes_own_unit(problem):
    cause = next(cause for cause in problem.program.causes if cause.name == DRIFT)
    found = {one.name: one for one in alternatives_at(problem, problem.program.null())}
    step = 1e-4
    unknowns = problem.program.null()
    unknowns[problem.program.place(DRIFT)] = step / cause.plausible
    change = (problem.program.predict(unknowns) - problem.program.predict(problem.program.null())) / step
    np.testing.assert_allclose(found[DRIFT].directions[:, 0], change, atol=1e-3 * np.max(np.abs(change)))


def test_correction_is_what_the_full_simulation_gives(problem, prepared):
    unknowns = problem.program.null()
    correction = correction_at(prepared, problem, unknowns)
    # The small fast simulation misses the mesh that it learnt from by less than two percent, and by something.
    assert 1e-5 < np.max(np.abs(correction)) < 0.02
    means = problem.factors.T @ correction
    np.testing.assert_allclose(means, 0.0, atol=1e-12)


def test_reading_that_a_curve_was_divided_by_is_one_of_its_rows():
    percent = np.full(len(TEMPERATURES), 97.0)
    rows = hmi_rows(curves(percent), 37.0)
    assert len(rows) == len(TEMPERATURES) + 2 and int(np.sum(rows.is_reference)) == 2
    assert rows.temperature[-1] == 37.0 and rows.log_displacement[-1] == np.log(100.0)
    percent[[0, 13]] = 100.0
    again = hmi_rows(curves(percent), 37.0)
    assert len(again) == len(TEMPERATURES) and list(np.flatnonzero(again.is_reference)) == [0, 13]


def test_a_displacement_that_is_not_positive_is_refused():
    percent = np.full(len(TEMPERATURES), 97.0)
    percent[4] = -1.0
    with pytest.raises(InputError, match="row 5.*positive"):
        hmi_rows(curves(percent), 37.0)
