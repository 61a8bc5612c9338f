"""Every cause is nothing at strength 0 and has the slope of what it does; what went into a fit comes out.

In one module, because the fast simulation that all need takes longest.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import trapezoid

from arfjax import discretise, simulate_heating
from inverse.datasets.copies import said_of_copies
from inverse.design.hmi_proposals import THERMOCOUPLE
from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi import refit
from inverse.diagnosis.hmi.cause import OFF_AXIS_REACH, HmiCause
from inverse.diagnosis.hmi.correction import Correction
from inverse.diagnosis.hmi.diagnosis import fit_remarks
from inverse.diagnosis.hmi.examination import Refits
from inverse.diagnosis.hmi.fitting import _errors
from inverse.diagnosis.hmi.prepare import free_constants, hmi_problem_of
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.program import HmiProgram
from inverse.diagnosis.hmi.refit import again_from, fit_hmi, fit_in_full
from inverse.hmi_model import predict
from inverse.inference.experiment import ParameterSection
from inverse.inference.problem import State
from tests.inverse.diagnosis.hmi.cases import (
    TEMPERATURES,
    at_strength,
    curves,
    measured_with,
    strength_and_shape,
    white,
)

SILENT = {"scattering-fraction", "boiling"}
"""A factor of all displacements, and one that needs 99 degC."""
FITS = (fit_hmi, fit_in_full)
DRIFT, POSITION, LAG = "output-drift", "thermocouple-position", "thermocouple-lag"


def test_without_causes_it_is_the_fast_model(problem, prepared):
    program = problem.program
    unknowns = program.null()
    unknowns[program.constants] += 0.05
    model = jax.tree.map(jnp.asarray, program.model(unknowns))
    percent = np.asarray(prepared.fast.predict(model, n_rows=len(TEMPERATURES), in_percent=True))
    logarithm = program.predict(unknowns)[: len(TEMPERATURES)]
    difference = np.log(percent) - logarithm
    for rows in problem.factors[: len(TEMPERATURES)].T > 0.0:
        np.testing.assert_allclose(difference[rows] - difference[rows][0], 0.0, atol=1e-10)
    assert program.excess(unknowns) <= 1.0


@pytest.mark.parametrize("cause", HMI_CAUSES, ids=lambda cause: cause.name)
def test_nothing_at_strength_0_and_something_at_a_plausible_one(problem, cause):
    plain = problem.program.predict(problem.program.null())
    for shape in cause.shapes:
        np.testing.assert_array_equal(at_strength(problem, cause, 0.0, shape)[1], plain)
    change = at_strength(problem, cause, 1.0)[1] - plain
    change -= problem.factors @ (problem.factors.T @ change / problem.factors.sum(axis=0))
    assert np.all(np.isfinite(change))
    # Plausible means: at most a few times the displacement, and more than a ten-thousandth of it somewhere.
    if cause.name in SILENT:
        assert np.max(np.abs(change)) < 1e-6
    else:
        assert 1e-4 < np.max(np.abs(change)) < 2.0


class LatePush(HmiCause):
    """Tracking that begins late: a cause that is in no library."""

    name, place, unit, sign, plausible = "late-push", "instruments: tracking", "1", 1, 0.1
    sentence, helps, source = "The trigger drifts.", "The whole course of a push.", "assumed"

    def measured(self, displacement, conditions, strength, shape):
        return displacement * (1.0 - strength * conditions.share**2)


@pytest.mark.slow
def test_a_cause_of_one_s_own_does_to_the_curves_what_it_says(prepared, described, settings):
    blank = curves(np.full(len(TEMPERATURES), 100.0))
    own = hmi_problem_of(prepared, blank, described, settings, (LatePush(),))
    change = at_strength(own, own.program.causes[0], 2.0)[1] - at_strength(own, own.program.causes[0], 0.0)[1]
    passed = np.asarray(own.rows.time) / 60.0
    for number in range(2):
        mine = own.rows.sonication == number
        lost = np.log(1.0 - 0.2 * passed[mine] ** 2)
        np.testing.assert_allclose(change[mine] - change[mine][0], lost - lost[0], atol=1e-6)


def test_a_reading_that_is_written_twice_is_one(problem, prepared, described, settings):
    blank = curves(np.full(len(TEMPERATURES), 100.0))
    twice = blank.select(np.append(np.arange(len(blank.sonication)), [2, 2]))
    found = hmi_problem_of(prepared, twice, described, settings, HMI_CAUSES, program=problem.program)
    assert len(found.rows) == len(problem.rows)
    assert found.notes == (*said_of_copies(2), *problem.notes)


@pytest.mark.parametrize("cause", HMI_CAUSES, ids=lambda cause: cause.name)
def test_slope_is_the_central_difference(problem, cause):
    program, step = problem.program, 1e-4
    at, _ = at_strength(problem, cause, 0.05)
    slope = program.slopes(at, [program.place(cause.name)])[:, 0]
    up, down = (at_strength(problem, cause, 0.05 + sign * step)[1] for sign in (1.0, -1.0))
    central = (up - down) / (2.0 * step)
    largest = max(np.max(np.abs(slope)), 1e-6)
    np.testing.assert_allclose(slope, central, atol=1e-5 * largest)


@pytest.mark.parametrize(("name", "strength"), [(DRIFT, 1.5), (POSITION, 0.6), ("perfusion", -0.4)])
def test_strength_that_went_in_comes_out(problem, name, strength):
    """Begun near it: a lesion that begins between two readings makes minima of its own, 0.4 % of a reading high."""
    hidden, truth = measured_with(problem, name, strength)
    cause = next(cause for cause in problem.program.causes if cause.name == name)
    start = truth + 0.1 * (problem.program.null() - truth)
    guess = np.array([0.9 * strength * cause.plausible])
    # So small a noise that the priors weigh nothing.
    fit = fit_hmi(hidden, (Extension(cause, 0.0),), white(hidden), size=1e-6, start=start, strengths=guess)
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
    assert np.max(np.abs(fit.of_readings[used])) < 1e-5 and np.min(fit.of_readings[~used]) > 4.9


def test_where_a_fit_ends_nothing_leads_downhill(problem):
    hidden, _ = measured_with(problem, DRIFT, 2.0, noise=0.01, seed=2)
    fit = fit_hmi(hidden, (), white(hidden), size=0.01)
    # Beliefs are data: where readings and beliefs pull alike, every direction is at right angles to what is left.
    gradient = fit.directions.T @ fit.residuals
    scale = np.linalg.norm(fit.directions, axis=0) * np.linalg.norm(fit.residuals)
    assert np.max(np.abs(gradient) / scale) < 0.02


def test_first_guess_of_a_tissue_that_cannot_be_is_taken_back(problem):
    hidden, _ = measured_with(problem, "attenuation-kinetics", -0.5)
    cause = next(cause for cause in problem.program.causes if cause.name == "attenuation-kinetics")
    guess = np.array([-5.0])  # attenuation would be negative
    assert not np.all(np.isfinite(at_strength(problem, cause, guess[0] / cause.plausible)[1]))
    fit = fit_hmi(hidden, (Extension(cause, 0.0),), white(hidden), size=1e-6, strengths=guess)
    assert fit.converged
    np.testing.assert_allclose(fit.strengths, [-0.5 * cause.plausible], rtol=2e-3)


def test_start_where_there_is_no_such_tissue_is_moved_towards_what_is_believed(problem):
    hidden, program = measured_with(problem, "", 0.0, noise=0.005)[0], problem.program
    start = program.null()
    # Of random starts half a standard deviation away, one in forty is such.
    start[program.constants] += np.array([-0.1, 0.4, 0.2, -0.1, -0.5, -0.6, 0.6, 0.6, -1.3]) * program.spreads
    assert not np.any(np.isfinite(problem.predict(start)))
    fits = [fit_hmi(hidden, (), white(hidden), size=0.005, start=one) for one in (start, program.null())]
    assert fits[0].misfit == pytest.approx(fits[1].misfit, rel=1e-3)


def test_beside_the_axis_it_is_as_warm_as_the_simulation_has_it(problem, prepared, described):
    """Cell by cell. On the usual grid three terms are within 3e-3; here times between coarse steps come on top."""
    settings, course = prepared.fast.curve.settings, problem.program.courses[0]
    start = course.protocol.start_temperature
    heating = simulate_heating(prepared.model, course.protocol, settings)
    r, time = np.asarray(settings.heat_grid.r), np.asarray(heating.time)
    near = r < OFF_AXIS_REACH
    z = int(np.argmin(np.abs(np.asarray(settings.heat_grid.z) - settings.focus)))
    rise = np.asarray(heating.temperature)[:, near, z] - start
    conditions = course.conditions
    for state in np.flatnonzero(np.asarray(conditions.time) > 10.0):
        now = np.array([np.interp(conditions.time[state], time, one) for one in rise.T])
        fall = np.asarray(conditions.off_axis_fall[state]) @ (r[near] ** (2.0 * np.arange(1, 4))[:, None])
        np.testing.assert_allclose(np.exp(fall[0] - fall), now / now[0], atol=5e-3)


def test_past_of_a_state_adds_up_to_its_rise(problem, prepared):
    """Rates so long ago, summed over the last third so far; between steps of the heat, two percent."""
    conditions, course = problem.program.courses[0].conditions, problem.program.courses[0]
    heating = simulate_heating(prepared.model, course.protocol, prepared.fast.curve.settings)
    time, age, rate = (np.asarray(each) for each in (conditions.time, conditions.age, conditions.past_rise_rate))
    recent = age[-1] < 0.33 * age[-1, -1]
    ends = [np.interp(t, heating.time, heating.focal_temperature) for t in (time, time - age[:, recent][:, -1])]
    late = time > 5.0
    summed = trapezoid(rate[:, recent], age[:, recent], axis=1)
    np.testing.assert_allclose(summed[late], (ends[0] - ends[1])[late], rtol=0.02)
    np.testing.assert_allclose(rate[:, 0], conditions.rise_rate, rtol=1e-12)
    np.testing.assert_allclose(age[:, -1], time, rtol=1e-12)


def test_another_instrument_does_not_have_the_faults_of_the_first(problem):
    program = problem.program
    immune = [dataclasses.replace(course, immune=(THERMOCOUPLE,)) for course in program.courses]
    both = [program.courses[0], immune[1]]
    none, lagging, drifting = program.null(), program.null(), program.null()
    lagging[program.place(LAG)], drifting[program.place(DRIFT)] = 1.0, 0.1
    other = program.on(both)
    first = np.asarray(program.courses[0].rows)
    second = np.asarray(program.courses[1].rows)
    np.testing.assert_allclose(other.predict(none), program.predict(none), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(other.predict(drifting), program.predict(drifting), rtol=0.0, atol=1e-12)
    moved = other.predict(lagging) - other.predict(none)
    np.testing.assert_allclose(moved[first], (program.predict(lagging) - program.predict(none))[first], atol=1e-12)
    np.testing.assert_allclose(moved[second], 0.0, atol=1e-12)
    assert np.max(np.abs((program.predict(lagging) - program.predict(none))[second])) > 1e-3


@pytest.mark.slow
def test_corrected_simulation_has_value_and_derivatives_of_the_full_one(problem, prepared):
    program, step = problem.program, 1e-4
    unknowns = strength_and_shape(problem, "cavitation", 0.3, 64.0)
    cavitation = program.place("cavitation")
    moved = np.array([cavitation, cavitation + len(program.causes), *program.constants])
    corrected = problem.corrected_at(unknowns, moved)
    np.testing.assert_allclose(corrected.predict(unknowns), program.simulate(unknowns), atol=1e-12)
    slopes = corrected.slopes(unknowns, moved.tolist())
    for place, slope in list(zip(moved, slopes.T, strict=True))[:4]:
        up, down = (program.simulate(unknowns + sign * step * np.eye(len(unknowns))[place]) for sign in (1.0, -1.0))
        np.testing.assert_allclose(slope, (up - down) / (2.0 * step), atol=1e-5 * np.max(np.abs(slope)))
        away = 0.01 * np.eye(len(unknowns))[place]
        left = corrected.predict(unknowns + away) - program.simulate(unknowns + away)
        wrong = problem.predict(unknowns + away) - program.simulate(unknowns + away)
        assert np.max(np.abs(left)) < 0.1 * np.max(np.abs(wrong))


def test_full_simulation_is_that_of_the_protocol(problem, prepared):
    unknowns = strength_and_shape(problem, DRIFT, 0.0, 0.0)
    model = jax.tree.map(jnp.asarray, problem.program.model(unknowns))
    percent = predict(model, prepared.sweeps, prepared.fine, n_rows=len(TEMPERATURES), in_percent=True)
    off = np.log(np.asarray(percent)) - problem.program.simulate(unknowns)
    for rows in problem.factors.T > 0.0:
        np.testing.assert_allclose(off[rows] - np.mean(off[rows]), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", [POSITION, LAG, "thermocouple-viscous-heating"])
def test_fit_in_full_is_one_of_the_full_simulation(problem, name):
    """A cause hidden by the full simulation comes out as it went in, to half a standard deviation of the noise.

    By the fast simulation, corrected at the priors' middle only, it does not: these tests' one is coarse.
    """
    program, hidden, noise = problem.program, problem.program.null(), 0.01
    hidden[program.place(name)] = 0.4
    rows = dataclasses.replace(problem.rows, log_displacement=program.simulate(hidden))
    measured = dataclasses.replace(problem, rows=rows).corrected_at(program.null(), program.constants)
    cause = next(cause for cause in HMI_CAUSES if cause.name == name)
    given = {"size": noise, "start": program.null(), "strengths": np.array([0.2 * cause.plausible])}
    fast, full = (fit(measured, (Extension(cause, cause.shapes[0]),), white(measured), **given) for fit in FITS)
    assert fast.converged and full.converged and full.left < 0.5
    assert np.sqrt(full.misfit) < 0.5 * noise < np.sqrt(fast.misfit)
    assert abs(full.strengths[0] / cause.plausible - 0.4) < 0.02 < abs(fast.strengths[0] / cause.plausible - 0.4)


def test_fit_where_there_is_no_such_tissue_in_full_says_so(problem, monkeypatch):
    def without(self, unknowns, moved):
        nowhere = np.full(len(self.rows), np.nan)
        return dataclasses.replace(self, correction=Correction(unknowns, nowhere, moved, np.outer(nowhere, moved)))

    monkeypatch.setattr(HmiDiagnosisProblem, "corrected_at", without)
    measured, _ = measured_with(problem, DRIFT, 1.0)
    fit = fit_in_full(measured, (), white(measured), size=1e-2, start=problem.program.null())
    assert not fit.converged and "no such tissue" in fit.status and np.all(np.isfinite(fit.residuals))
    family = measured.noise_family()[:2]
    refits = Refits(fit, family, size=1e-2, corrected=True)
    cause = next(cause for cause in HMI_CAUSES if cause.name == DRIFT)
    for one in family:
        again = refits((Extension(cause, 0.0),), one, np.array([0.5 * cause.plausible]), False)
        assert not again.converged and "no such tissue" in again.status


@pytest.mark.parametrize(("settled", "confirmed"), [(0.5, True), (-1.0, False)])
def test_fit_outside_of_the_fast_simulation_counts_if_the_full_one_agrees(problem, monkeypatch, settled, confirmed):
    measured, _ = measured_with(problem, DRIFT, 1.0)
    monkeypatch.setattr(HmiProgram, "excess", lambda self, unknowns: 1.5)
    monkeypatch.setattr(refit, "SETTLED", settled)
    given = {"size": 1e-2, "start": problem.program.null()}
    fast, full = (fit(measured, (), white(measured), **given) for fit in FITS)
    assert not fast.converged and full.converged == confirmed
    assert all("leaves the range" in fit.status for fit in (fast, full) if not fit.converged)
    # Once more from there, in this noise or another, it is asked again; and nothing makes a fit that failed a good one.
    assert again_from(full, white(measured), 1e-2).converged == confirmed
    monkeypatch.setattr(refit, "SETTLED", 0.5)
    assert again_from(full, white(measured), 1e-2).converged == confirmed


def test_fit_on_which_the_simulations_do_not_agree_says_so(problem):
    measured, _ = measured_with(problem, "", 0.0)
    fit = fit_hmi(measured, (), white(measured), size=0.01)
    for left, said in ((float("nan"), False), (0.1, False), (3.0, True)):
        remarks = fit_remarks(dataclasses.replace(fit, left=left))
        assert any("still 3.0 standard deviations" in remark for remark in remarks) == said


def test_rim_has_no_less_than_no_lesion_and_no_more_than_all_of_it(problem):
    cause = next(cause for cause in HMI_CAUSES if cause.name == "lesion-rim")
    for sign in (1.0, -1.0):
        measured, _ = measured_with(problem, cause.name, sign * cause.farthest(int(sign)) / cause.plausible)
        guess = np.array([3.0 * sign * cause.largest])
        fit = fit_hmi(measured, (Extension(cause, 0.0),), white(measured), size=1e-6, strengths=guess)
        assert np.isfinite(fit.misfit) and cause.least <= fit.strengths[0] <= cause.largest


def test_there_is_no_less_flow_than_none(problem):
    """What a fit would like to be below its end stays there, with an interval that ends there, too."""
    cause = next(cause for cause in HMI_CAUSES if cause.name == "perfusion")
    measured, _ = measured_with(problem, cause.name, cause.least / cause.plausible, noise=0.01, seed=1)
    fit = fit_hmi(measured, (Extension(cause, 0.0),), white(measured), size=0.01, strengths=np.array([-5.0]))
    assert cause.least <= fit.strengths[0] and fit.intervals[0, 0] == cause.least < fit.intervals[0, 1]
    found = problem.alternatives(problem.program.null(), problem.factors, 1.0)
    assert {one.reach for one in found if one.name == "perfusion"} == {4.0, -1.0}


@pytest.mark.parametrize("which", ["white", "correlated", "louder"])
def test_what_a_fit_makes_least_is_what_tests_look_at(problem, which):
    """Residuals in coordinates in which the noise is white, beliefs among them, whatever the noise is."""
    hidden, _ = measured_with(problem, DRIFT, 2.0, noise=0.01, seed=2)
    kinds = {
        "white": lambda one: one.is_white,
        "correlated": lambda one: one.correlation == 0.4 and one.step == 1.0,
        "louder": lambda one: one.correlation == 0.0 and one.step == 3.0,
    }
    noise = next(one for one in hidden.noise_family() if kinds[which](one))
    fit = fit_hmi(hidden, (), noise, size=0.01)
    assert np.sum(noise.whiten(fit.residuals[:, None]) ** 2) == pytest.approx(fit.misfit, rel=1e-9)
    gradient = noise.whiten(fit.directions).T @ noise.whiten(fit.residuals[:, None])[:, 0]
    scale = np.linalg.norm(noise.whiten(fit.directions), axis=0) * np.sqrt(fit.misfit)
    assert np.max(np.abs(gradient) / scale) < 0.02


def test_a_strength_at_its_largest_follows_nothing(problem):
    hidden, _ = measured_with(problem, DRIFT, 3.0, noise=0.005, seed=1)
    cause = next(cause for cause in problem.program.causes if cause.name == DRIFT)

    class Little(type(cause)):
        largest = 0.5 * cause.plausible

    free, held = (fit_hmi(hidden, (Extension(one, 0.0),), white(hidden), size=0.005) for one in (cause, Little()))
    assert held.converged and held.strengths[0] == pytest.approx(Little.largest, rel=1e-3)
    assert held.intervals[0, 1] <= Little.largest < free.intervals[0, 1]
    assert held.directions.shape[1] == free.directions.shape[1] - 1


def test_what_is_not_felt_has_no_end_of_an_error():
    jacobian = np.column_stack([np.linspace(0.0, 1.0, 8), np.zeros(8), np.ones(8)])
    errors, taken = _errors(jacobian)
    both = np.linalg.inv(jacobian[:, [0, 2]].T @ jacobian[:, [0, 2]])
    np.testing.assert_allclose(errors, [np.sqrt(both[0, 0]), np.inf, np.sqrt(both[1, 1])])
    assert np.sum(taken) == pytest.approx(2.0)


def test_what_cannot_be_told_from_another_has_no_end_of_an_error():
    """Of two that do the same only their sum is known; a third is known as ever."""
    line = np.linspace(0.0, 1.0, 8)
    errors, taken = _errors(np.column_stack([line, np.ones(8), 3.0 * line]))
    alone = np.linalg.inv(np.column_stack([line, np.ones(8)]).T @ np.column_stack([line, np.ones(8)]))
    np.testing.assert_allclose(errors, [np.inf, np.sqrt(alone[1, 1]), np.inf])
    assert np.sum(taken) == pytest.approx(2.0)


def test_nothing_is_believed_of_a_constant_with_a_flat_prior(prepared, described, settings):
    place = "model.lesion.viscoelasticity.branch_modulus.value"
    kinds = {
        "flat": {"kind": "log-uniform", "lower": 1e2, "upper": 1e5, "source": "test"},
        "believed": {"kind": "log-normal", "log_sd": 0.5, "source": "test"},
    }
    for kind, prior in kinds.items():
        one = ParameterSection(name="lesion_stiffness", place=place, unit="Pa", prior=prior)
        own = settings.model_copy(update={"parameters": (one,)})
        parameters = free_constants(described, own)
        program = HmiProgram(
            prepared.fast.curve, (), parameters, State(prepared.model, {}), HMI_CAUSES[:1], prepared.fine
        )
        assert program.n_beliefs == len(program.names_of_beliefs) == (kind == "believed")
        assert program.penalty_slopes(program.null()).shape == (program.n_beliefs, program.n_unknowns)
        assert len(program.penalties(program.null())) == program.n_beliefs
        # Another start is somewhere in the range, not at its end.
        assert 0.1 < program.spreads[0] < 3.0


@pytest.mark.slow
def test_a_finer_mesh_differs_by_what_another_simulation_on_it_does(prepared, problem):
    states = problem.program.courses
    finer = discretise(prepared.model, refinement=0.7)
    finer = dataclasses.replace(prepared.fine, mesh=finer.mesh)
    of = (prepared.fast.curve, states, prepared.parameters, State(prepared.model, {}), HMI_CAUSES[:1])
    program, other = HmiProgram(*of, prepared.fine, finer), HmiProgram(*of, finer)
    at = program.null()
    difference = program.mesh_difference(at)
    np.testing.assert_allclose(difference, other.simulate(at) - program.simulate(at), atol=1e-12)
    assert np.max(np.abs(difference)) > 1e-4
    np.testing.assert_array_equal(other.mesh_difference(at), np.zeros(other.n_rows))


def test_a_reading_that_the_mesh_is_wrong_at_weighs_less(problem, monkeypatch):
    count, sonication = len(problem.rows), problem.rows.sonication
    difference = np.where(sonication == 0, 0.3, 0.0)
    hot = np.flatnonzero(sonication == 1)[-1]
    difference[hot] = 0.03
    monkeypatch.setattr(problem.program, "mesh_difference", lambda _: difference, raising=False)
    trusted = problem.trusted(problem.program.null(), 0.01)
    expected = np.ones(count)
    # A difference in all readings of a sonication is none; neighbours in temperature share one.
    expected[hot - 1 : hot + 1] = 1.0 / np.sqrt(1.0 + 9.0 * np.array([1.0, 2.0]) / 3.0)
    np.testing.assert_allclose(trusted.weights, expected)
    stated = dataclasses.replace(problem, rows=dataclasses.replace(problem.rows, deviation=np.full(count, 0.02)))
    np.testing.assert_allclose(stated.trusted(problem.program.null(), 0.5).weights, 50.0 * expected)
    unknown = np.where(np.arange(count) == 3, np.nan, 0.0)
    monkeypatch.setattr(problem.program, "mesh_difference", lambda _: unknown, raising=False)
    np.testing.assert_array_equal(problem.trusted(problem.program.null(), 0.01).weights, np.ones(count))
