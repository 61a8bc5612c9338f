"""Intervals by profile: their ends are where the likelihood has fallen, and they hold the twin of a strength."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi import profile
from inverse.diagnosis.hmi.bound_search import Trial
from inverse.diagnosis.hmi.correction import Correction
from inverse.diagnosis.hmi.examination import Refits
from inverse.diagnosis.hmi.fitting import Fitting, HmiFit, moved_by
from inverse.diagnosis.hmi.noise_size import noise_size
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.profile import profiled
from inverse.diagnosis.hmi.refit import fit_hmi, fit_in_full
from inverse.diagnosis.hmi.twin import _farthest, spanning, twin_strength
from tests.inverse.diagnosis.hmi.cases import bare, fitted_with, measured_with, white

DRIFT, POSITION, LAG = "output-drift", "thermocouple-position", "thermocouple-lag"


def test_profile_of_what_hardly_bends_is_its_curvature(problem):
    fit = fitted_with(problem, DRIFT, 2.0, 1e-4, seed=3)
    by_profile = profiled(fit, white(fit.problem), 1e-4)
    # The search for an end stops within 5 % of the bound.
    half = (fit.intervals[0, 1] - fit.intervals[0, 0]) / 2.0
    np.testing.assert_allclose(by_profile.intervals, fit.intervals, atol=0.06 * half)


def test_at_the_ends_of_a_profile_the_likelihood_has_fallen_to_the_bound(problem):
    noise = 0.01
    fit = fitted_with(problem, POSITION, 0.6, noise, seed=4)
    by_profile = profiled(fit, white(fit.problem), noise)
    bound = fit.variance * stats.t.ppf(0.975, fit.freedom) ** 2
    for end in by_profile.intervals[0]:
        given = {"start": fit.unknowns, "strengths": np.array([end]), "held": (0,)}
        held = fit_hmi(fit.problem, fit.extensions, white(fit.problem), size=noise, **given)
        assert held.strengths[0] == pytest.approx(end, rel=1e-12)
        # 5 % of the root are 10 % of its square. A strength that cannot be negative ends at 0, short of the bound.
        risen = (held.misfit - fit.misfit) / bound
        assert abs(risen - 1.0) < 0.11 if end > 0.0 else risen < 1.11
    assert by_profile.intervals[0, 1] > fit.strengths[0] > by_profile.intervals[0, 0]


def test_trials_of_a_profile_begin_next_to_where_they_end(problem, monkeypatch):
    """What is fitted follows the strength: where it stayed, trials began 91 squared standard deviations higher."""
    noise, begun = 0.002, []
    fit = fitted_with(problem, DRIFT, 2.0, noise, seed=4)
    fitting = Fitting(fit.problem, fit.extensions, white(fit.problem), noise)

    def recorded(*arguments, start, **others):
        found = fit_hmi(*arguments, start=start, **others)
        at = start.copy()
        at[fitting.strengths] = found.unknowns[fitting.strengths]
        begun.append((np.sum(fitting.stacked(at) ** 2) - found.misfit) / fit.variance)
        return found

    monkeypatch.setattr("inverse.diagnosis.hmi.profile.fit_hmi", recorded)
    profiled(fit, white(fit.problem), noise)
    # The bound is 4, and what bends a tenth of it at most.
    assert len(begun) >= 2 and max(begun) < 0.4


def test_of_two_strengths_each_has_its_own_ends_and_the_other_follows(problem, monkeypatch):
    """Trials begin where both are next to where they end; where hardly anything bends, ends are those of curvature."""
    noise, begun, held = 2e-4, [], set()
    hidden, _ = measured_with(problem, DRIFT, 2.0, noise=noise, seed=4)
    causes = [next(cause for cause in HMI_CAUSES if cause.name == name) for name in ("conductivity-change", DRIFT)]
    pair = tuple(Extension(cause, 0.0) for cause in causes)
    fit = fit_hmi(hidden, pair, white(hidden), size=noise, strengths=np.array([0.0, 2.0 * causes[1].plausible]))
    fitting = Fitting(hidden, pair, white(hidden), noise)

    def recorded(*arguments, **given):
        found = fit_hmi(*arguments, **given)
        at = given["start"].copy()
        at[fitting.strengths] = given["strengths"] / fitting.scales
        begun.append((np.sum(fitting.stacked(at) ** 2) - found.misfit) / fit.variance)
        held.add(given["held"])
        return found

    monkeypatch.setattr("inverse.diagnosis.hmi.profile.fit_hmi", recorded)
    found = profiled(fit, white(hidden), noise)
    # The bound is 4; with the other strength left at its estimate they begin 12 to 36 higher.
    assert held == {(0,), (1,)} and max(begun) < 2.0
    half = (fit.intervals[:, 1:] - fit.intervals[:, :1]) / 2.0
    np.testing.assert_allclose((found.intervals - fit.intervals) / half, 0.0, atol=0.15)


def test_profile_of_what_is_not_there_begins_at_nothing(problem):
    fit = fitted_with(problem, LAG, 0.0, 0.01, seed=5)
    by_profile = profiled(fit, white(fit.problem), 0.01)
    assert by_profile.intervals[0, 0] == 0.0 < by_profile.intervals[0, 1]
    assert profiled(dataclasses.replace(fit, converged=False), white(fit.problem), 0.01).intervals is fit.intervals


def test_size_of_noise_is_that_of_readings_wherever_constants_are(problem):
    """Constants in the middle of what is believed, which counted as data made the noise look too small."""
    noise, readings, fits = 0.01, len(problem.rows), []
    for seed in range(12):
        hidden, _ = measured_with(problem, "", 0.0, noise=noise, seed=seed, spread=0.0)
        fits.append(fit_hmi(hidden, (), white(hidden), size=noise))
    freedom = np.array([fit.freedom for fit in fits])
    factors, constants = problem.factors.shape[1], len(problem.program.start)
    assert np.all((freedom > readings - factors - constants) & (freedom < readings - factors))
    # A variance of so many degrees of freedom is known to 8 percent.
    error = np.sqrt(2.0 / np.sum(freedom))
    found = np.sum([fit.variance * fit.freedom for fit in fits]) / np.sum(freedom)
    assert abs(found / noise**2 - 1.0) < 3.0 * error
    as_data = np.sum([fit.misfit for fit in fits]) / (len(fits) * (readings - factors))
    assert as_data / noise**2 < 1.0 and noise_size(fits[0]) == pytest.approx(np.sqrt(fits[0].variance), rel=1e-6)


def test_an_end_that_these_data_do_not_tell_is_nowhere_and_that_is_said(problem):
    """What is not felt at all: no strength is too large, and none is tried."""
    cause = next(cause for cause in HMI_CAUSES if cause.name == DRIFT)

    class Boundless(type(cause)):
        least, largest = -np.inf, np.inf

    hidden, _ = measured_with(problem, "", 0.0, noise=0.01, seed=5)
    fit = fit_hmi(hidden, (Extension(Boundless(), 0.0),), white(hidden), size=0.01)
    found = profiled(dataclasses.replace(fit, intervals=np.array([[-np.inf, np.inf]])), white(hidden), 0.01)
    np.testing.assert_array_equal(found.intervals, [[-np.inf, np.inf]])
    sides = [f"the {side} end of the interval of {DRIFT}" for side in ("lower", "upper")]
    assert list(found.remarks) == [f"{side} is not told by these data." for side in sides]


def bent(program, fit, depth=0.4, length=1.4):
    """A program whose full simulation has the effect of a strength go to and fro about a fit: steeply, then back.

    Distances are in halves of the fit's interval; the effect at a distance x is that of the fast one at
    x + depth (1 - cos(2 pi x / length)).
    """
    place, half = program.place(fit.extensions[0].cause.name), (fit.intervals[0, 1] - fit.strengths[0])
    half /= fit.extensions[0].cause.plausible
    column, at, wave = half * program.slopes(fit.unknowns, [place])[:, 0], fit.unknowns[place], 2.0 * np.pi / length

    def simulate(unknowns):
        return program.predict(unknowns) + column * depth * (1.0 - np.cos(wave * (unknowns[place] - at) / half))

    def linearise(unknowns, which):
        slopes = program.slopes(unknowns, which)
        slope = depth * wave / half * np.sin(wave * (unknowns[place] - at) / half)
        return simulate(unknowns), slopes + np.outer(column * slope, np.asarray(which) == place)

    other = program.on(program.courses)
    other.simulate, other.linearise = simulate, linearise
    return other


def test_a_correction_taken_beyond_an_end_is_not_for_what_lies_before_it(problem):
    """Beyond the upper end the effect goes back: as corrected there, every strength before it seemed worse still."""
    noise = 0.005
    fit = fitted_with(problem, DRIFT, 2.0, noise, seed=3)
    full = dataclasses.replace(fit.problem, program=bent(problem.program, fit))
    fit = dataclasses.replace(fit, problem=full.corrected_at(fit.unknowns, moved_by(full, fit.extensions)))
    found = profiled(fit, white(full), noise)
    distances = (found.intervals[0] - fit.strengths[0]) / (fit.intervals[0, 1] - fit.strengths[0])
    at_ends = distances + 0.4 * (1.0 - np.cos(2.0 * np.pi * distances / 1.4))
    # 5 % is what the search leaves, 1 % what bends without it.
    np.testing.assert_allclose(at_ends, [-1.0, 1.0], atol=0.07)
    assert found.remarks == ()


def test_an_end_that_the_full_simulation_cannot_confirm_stays_and_that_is_said(problem):
    noise = 0.005
    fit = fitted_with(problem, DRIFT, 2.0, noise, seed=3)
    other, half = bent(problem.program, fit), fit.intervals[0, 1] - fit.strengths[0]
    full = dataclasses.replace(fit.problem, program=other)
    fit = dataclasses.replace(fit, problem=full.corrected_at(fit.unknowns, moved_by(full, fit.extensions)))
    other.linearise = lambda _, which: (np.full(other.n_rows, np.nan), np.zeros((other.n_rows, len(which))))
    found = profiled(fit, white(full), noise)
    assert len(found.remarks) == 2 and all("does not confirm" in remark for remark in found.remarks)
    np.testing.assert_allclose(found.intervals[0] - fit.strengths[0], [-half, half], atol=0.06 * half)
    # Nor has the fit itself been confirmed any better: its misfit is that of the same simulation as that of its ends.
    found = profiled(dataclasses.replace(fit, left=10.0), white(full), noise)
    assert found.remarks == ()


@pytest.mark.parametrize(("at_fit", "most"), [(float("nan"), 0.5), (0.1, 0.5), (2.0, 2.0)])
def test_an_end_is_settled_as_well_as_fits_have_to_be_or_as_its_own_is(problem, monkeypatch, at_fit, most):
    """In standard deviations of the noise, all readings together."""
    end, trial = bare(profile._End, fit=bare(HmiFit, left=at_fit), size=0.01), Trial(1.0, 1.0, np.zeros(1))
    for away, settled in ((0.99 * most, True), (1.01 * most, False)):
        left = 0.01 * away * np.array([0.6, -0.8])
        monkeypatch.setattr(HmiDiagnosisProblem, "left", lambda self, _, left=left: left)
        assert end._settled(problem, trial) == settled


@pytest.mark.slow
def test_ends_of_a_profile_are_those_of_the_full_simulation(problem):
    """By the fast one, coarse here and corrected where the fit is, the bound is missed by 40 % at the lower end."""
    noise, name = 0.005, "thermocouple-viscous-heating"
    hidden = dataclasses.replace(problem, rows=fitted_with(problem, name, 0.8, noise, seed=4).problem.rows)
    cause = next(cause for cause in HMI_CAUSES if cause.name == name)
    extension, start = Extension(cause, cause.shapes[0]), problem.program.null()
    fit = fit_in_full(hidden, (extension,), white(hidden), size=noise, start=start, strengths=np.array([2.0]))
    fit = profiled(fit, white(hidden), noise)
    bound = np.sqrt(fit.variance) * stats.t.ppf(0.975, fit.freedom)
    for end in fit.intervals[0]:
        held = fit
        for _ in range(3):
            near = hidden.corrected_at(held.unknowns, moved_by(hidden, held.extensions))
            given = {"size": noise, "start": held.unknowns, "strengths": np.array([end]), "held": (0,)}
            held = fit_hmi(near, (extension,), white(hidden), **given)
        assert np.linalg.norm(near.left(held.unknowns)) < 0.1 * noise
        # Simulations d apart have misfits 2 r d apart: for d of half a standard deviation and noise r of any direction
        # about 1, in squared ones. Twice that takes the root, the bound of 2, to 1.4 or 2.4.
        assert np.sqrt(max(held.misfit - fit.misfit, 0.0)) == pytest.approx(bound, rel=0.3)


@pytest.mark.parametrize("agrees", [True, False])
def test_a_better_fit_that_the_full_simulation_does_not_have_is_none(problem, monkeypatch, agrees):
    """By the fast one, corrected where the fit is, misfits are lowest three standard errors farther on."""
    fit, none, nowhere = fitted_with(problem, DRIFT, 2.0, 0.005, seed=3), np.zeros(len(problem.rows)), np.zeros(0, int)
    about, full = (Correction(fit.unknowns, none, nowhere, none[:, None] * nowhere) for _ in range(2))
    fit = dataclasses.replace(fit, problem=dataclasses.replace(fit.problem, correction=about))
    reach = stats.t.ppf(0.975, fit.freedom)
    error = (fit.intervals[0, 1] - fit.strengths[0]) / reach
    farther = dataclasses.replace(
        fit, problem=dataclasses.replace(fit.problem, correction=full),
        strengths=fit.strengths + 3.0 * error, misfit=fit.misfit - 9.0 * fit.variance,
    )  # fmt: skip

    def held_at(problem, extensions, noise, *, start, strengths, **_):
        lowest = farther if agrees or problem.correction is about else fit
        risen = fit.variance * ((strengths[0] - lowest.strengths[0]) / error) ** 2
        return dataclasses.replace(
            fit, problem=problem, unknowns=start, strengths=strengths, misfit=lowest.misfit + float(risen)
        )

    monkeypatch.setattr(profile, "fit_hmi", held_at)
    monkeypatch.setattr(profile, "fit_in_full", lambda *_, **__: farther if agrees else fit)
    monkeypatch.setattr(profile, "_responses", lambda *_: [np.zeros(len(fit.unknowns))])
    monkeypatch.setattr(
        HmiDiagnosisProblem, "corrected_at", lambda self, *_: dataclasses.replace(self, correction=full)
    )
    monkeypatch.setattr(HmiDiagnosisProblem, "left", lambda self, _: none + float(self.correction is not full))
    found, lowest = profiled(fit, white(fit.problem), 0.005), farther if agrees else fit
    assert [("better fit was met" in remark) for remark in found.remarks] == [True] * agrees
    assert found.strengths[0] == lowest.strengths[0]
    # The search for an end stops within 5 % of the bound.
    np.testing.assert_allclose((found.intervals[0] - lowest.strengths[0]) / (reach * error), [-1.0, 1.0], atol=0.05)


def test_profile_of_a_local_fit_leads_to_the_better_one(problem):
    fit = fitted_with(problem, DRIFT, 2.0, 0.005, seed=3)
    far = {"start": fit.unknowns, "strengths": 0.3 * fit.strengths, "held": (0,)}
    local = fit_hmi(fit.problem, fit.extensions, white(fit.problem), size=0.005, **far)
    assert local.converged and local.misfit > 1.5 * fit.misfit
    local = dataclasses.replace(local, intervals=fit.intervals - fit.strengths + local.strengths)
    found, best = (profiled(one, white(fit.problem), 0.005) for one in (local, fit))
    assert best.remarks == () and "better fit" in found.remarks[0]
    half = (best.intervals[0, 1] - best.intervals[0, 0]) / 2.0
    # Fits end at a relative 1e-4 of a misfit of 60 variances, 0.08 standard deviations; half an interval has two.
    np.testing.assert_allclose(found.strengths, best.strengths, atol=0.04 * half)
    # Ends are met to 5 % each.
    np.testing.assert_allclose(found.intervals, best.intervals, atol=(0.04 + 2.0 * 0.05) * half)


def test_where_displacement_turns_the_interval_holds_both_temperatures(problem):
    """Displacement of this tissue turns at 41 degC: the reading of 37 taken at 48 looks like one taken at 36."""
    program, noise, rng = problem.program, 0.01, np.random.default_rng(0)
    unknowns, cause = program.null(), next(c for c in HMI_CAUSES if c.name == "normalisation-temperature")
    unknowns[program.constants] += 0.5 * program.spreads * rng.standard_normal(len(program.start))
    unknowns[program.place(cause.name)] = 11.0 / cause.plausible
    logarithm = program.predict(unknowns) + noise * rng.standard_normal(len(problem.rows))
    hidden = dataclasses.replace(problem, rows=dataclasses.replace(problem.rows, log_displacement=logarithm))
    null = fit_hmi(hidden, (), white(hidden), size=noise)
    family, extension = hidden.noise_family(), Extension(cause, 0.0)
    refits = Refits(null, family, size=noise, corrected=False)
    near, both = (refits([extension], family[0], np.array([-1.0]), profile) for profile in (False, True))
    # One fit finds the nearer twin, and an interval of its own without the other.
    assert -3.0 < near.strengths[0] < 0.0 and profiled(near, family[0], noise).intervals[0, 1] < 2.0
    assert both.intervals[0, 0] < near.strengths[0] and both.intervals[0, 1] > 11.0
    assert both.intervals[0, 1] < 14.0 and "two strengths" in both.remarks[-1]


def test_what_does_not_turn_back_has_no_twin(problem):
    fit = fitted_with(problem, DRIFT, 2.0, 0.005, seed=3)
    fit = profiled(fit, white(fit.problem), 0.005)
    assert twin_strength(fit, white(fit.problem), 0.005) is None
    # Nor where there is no such tissue.
    nowhere, place = problem.program.on(problem.program.courses), problem.program.place(DRIFT)
    nowhere.predict = lambda at: problem.program.predict(at) + (np.nan if at[place] > 3.5 else 0.0)
    without = dataclasses.replace(fit, problem=dataclasses.replace(fit.problem, program=nowhere))
    assert twin_strength(without, white(fit.problem), 0.005) is None
    # Nor by a correction, which is right about the fit alone: by this one two plausible strengths more were better.
    effect = problem.program.slopes(fit.unknowns, [problem.program.place(DRIFT)])[:, 0]
    shifted = Correction(fit.unknowns, -2.0 * effect, np.zeros(0, dtype=int), np.zeros((len(effect), 0)))
    shifted = dataclasses.replace(fit.problem, correction=shifted)
    assert twin_strength(dataclasses.replace(fit, problem=shifted), white(fit.problem), 0.005) is None


@pytest.mark.parametrize(("noise", "off", "found"), [(0.002, 0.0, False), (0.002, 0.02, True), (0.004, 0.0, True)])
def test_a_twin_may_be_as_much_worse_as_the_fast_simulation_is_off(problem, noise, off, found):
    """By five standard deviations of the noise; constants as they are, it is 6.4 of 0.2 % worse, and half of 0.4 %."""
    program, rng = problem.program, np.random.default_rng(0)
    unknowns, cause = program.null(), next(c for c in HMI_CAUSES if c.name == "normalisation-temperature")
    unknowns[program.constants] += 0.5 * program.spreads * rng.standard_normal(len(program.start))
    unknowns[program.place(cause.name)] = 11.0 / cause.plausible
    logarithm = program.predict(unknowns) + noise * rng.standard_normal(len(problem.rows))
    # What the full simulation has more, from one reading to the next, and the data have, too.
    more = off * (-1.0) ** np.arange(len(problem.rows))
    correction = Correction(program.null(), more, np.zeros(0, dtype=int), np.zeros((len(more), 0)))
    rows = dataclasses.replace(problem.rows, log_displacement=logarithm + more)
    full = dataclasses.replace(problem, rows=rows, correction=correction)
    fit = fit_hmi(full, (Extension(cause, 0.0),), white(full), size=noise, strengths=np.array([-1.0]))
    assert fit.converged and -3.0 < fit.strengths[0] < 0.0
    twin = twin_strength(fit, white(full), noise)
    # Looked for in steps of 0.75.
    assert (twin is not None) == found and (twin is None or abs(twin - 11.0) < 0.75)
    if off:
        other = fit_hmi(full, fit.extensions, white(full), size=noise, strengths=np.array([twin]))
        back = twin_strength(other, white(full), noise)
        assert other.converged and back is not None and abs(back - fit.strengths[0]) < 0.75
        # Of a fit that failed nothing is known, and of two strengths each has its interval from the profile.
        for none in (
            dataclasses.replace(fit, converged=False),
            dataclasses.replace(fit, extensions=2 * fit.extensions),
        ):
            assert twin_strength(none, white(full), noise) is None

        # Where strengths end on the way to the twin, it may lie there.
        class Bounded(type(cause)):
            largest = 10.0

        ends = dataclasses.replace(fit, extensions=(Extension(Bounded(), 0.0),))
        assert twin_strength(ends, white(full), noise) == pytest.approx(10.0)


def test_a_twin_is_looked_for_as_far_again_as_the_fit_and_no_farther_than_there_are_strengths():
    cause = next(cause for cause in HMI_CAUSES if cause.name == DRIFT)

    class Bounded(type(cause)):
        least, largest = -5.0 * cause.plausible, np.inf

    for strength, upwards, downwards in ((1.0, 4.0, 4.0), (-6.0, 12.0, 5.0), (3.0, 6.0, 5.0)):
        fit = bare(HmiFit, extensions=(Extension(Bounded(), 0.0),), strengths=np.array([strength * cause.plausible]))
        assert (_farthest(fit, 1), _farthest(fit, -1)) == pytest.approx((upwards, downwards))


def test_of_two_fits_the_better_one_counts_and_both_only_within_the_bound(problem):
    fit = fitted_with(problem, DRIFT, 2.0, 0.005, seed=3)
    variance = fit.variance
    for above, spans in ((3.0, True), (6.0, False)):  # The bound is 2.0 standard deviations.
        other = dataclasses.replace(
            fit, misfit=fit.misfit + above * variance, strengths=-fit.strengths, intervals=-fit.intervals[:, ::-1]
        )
        for found in (spanning(fit, other), spanning(other, fit)):
            assert found.strengths[0] == fit.strengths[0]
            assert (found.intervals[0, 0] == other.intervals[0, 0]) == spans
            assert found.intervals[0, 1] == fit.intervals[0, 1]
        assert "fits better" in spanning(other, fit).remarks[0] and len(spanning(fit, other).remarks) == int(spans)
        # An end of the other fit comes with what is to be said of it.
        told = spanning(fit, dataclasses.replace(other, remarks=("its end was not met.",))).remarks
        assert ("its end was not met." in told) == spans
    # What is lower by less than fits end apart is no better, and what is to be said of both is said once.
    hardly = dataclasses.replace(fit, misfit=fit.misfit - 0.2 * variance, strengths=-fit.strengths)
    assert spanning(fit, hardly).strengths[0] == fit.strengths[0] and len(spanning(fit, hardly).remarks) == 1
    both = [dataclasses.replace(one, remarks=("its end was not met.",)) for one in (fit, hardly)]
    assert spanning(*both).remarks.count("its end was not met.") == 1
