"""What screening of curves of displacement looks along, and where refits begin."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import InputError
from inverse.design import design_hmi
from inverse.diagnosed import Diagnosed
from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.constants import as_table
from inverse.diagnosis.content import as_json
from inverse.diagnosis.diagnosis import failed
from inverse.diagnosis.hmi import diagnosis as hmi_diagnosis
from inverse.diagnosis.hmi import examination
from inverse.diagnosis.hmi.account import HmiAccount
from inverse.diagnosis.hmi.correction import Correction
from inverse.diagnosis.hmi.diagnosis import diagnose_curves
from inverse.diagnosis.hmi.examination import Refits
from inverse.diagnosis.hmi.fitting import Fitting, moved_by
from inverse.diagnosis.hmi.noise_size import noise_size
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.refit import again_from, fit_hmi
from inverse.diagnosis.hmi.rough_fit import best_of_each, in_full, rough_fits
from inverse.diagnosis.projection import independent, unit_columns
from inverse.diagnosis.screening import Screen
from inverse.figures.hmi_diagnosis import hmi_diagnosis_figure
from inverse.figures.residuals import residuals_figure
from tests.inverse.diagnosis.hmi.cases import TEMPERATURES, at_strength, curves, looked_for_in, measured_with, white

DRIFT, POSITION, LAG = "output-drift", "thermocouple-position", "thermocouple-lag"


def named(name):
    return next(cause for cause in HMI_CAUSES if cause.name == name)


def test_alternatives_are_the_effects_of_detectable_strengths(problem):
    """In the cause's own unit, one-sided, both ways for what can have either sign, in every shape."""
    program, size = problem.program, 0.01
    plain, basis = program.predict(program.null()), np.linalg.qr(problem.factors)[0]
    found = problem.alternatives(program.null(), problem.factors, size)
    assert len(found) == sum(len(cause.shapes) * (1 if cause.sign > 0 else 2) for cause in HMI_CAUSES)
    for name, shape, signs in ((DRIFT, None, (1, -1)), (POSITION, None, (1,)), ("cavitation", 66.0, (1, -1))):
        cause = named(name)
        mine = [one for one in found if (one.name, one.shape) == (name, shape)]
        assert tuple(one.sign for one in mine) == signs
        unknowns, _ = at_strength(problem, cause, 0.0, shape)
        slope = program.slopes(unknowns, [program.place(name)])[:, 0]
        seen = min(4.5 * size / np.linalg.norm(slope - basis @ (basis.T @ slope)), 4.0)
        for one, sign in zip(mine, signs, strict=True):
            # By a change that is small, where the derivative is that of none.
            reach = min(seen, cause.farthest(sign) / cause.plausible)
            assert one.reach == pytest.approx(sign * reach * cause.plausible, rel=1e-3)
            change = at_strength(problem, cause, one.reach / cause.plausible, shape)[1] - plain
            np.testing.assert_allclose(one.directions[:, 0] * one.reach, change, atol=1e-10)


def test_few_readings_are_judged_against_noise_of_all_kinds(problem, monkeypatch):
    asked = []

    def spied(*arguments, **options):
        del arguments
        asked.append(options["few"])
        raise InterruptedError

    monkeypatch.setattr(examination, "decide", spied)
    monkeypatch.setattr(examination, "rough_fits_of", lambda *_, **options: [])
    hidden, _ = measured_with(problem, "", 0.0, noise=0.01, seed=6)
    null = fit_hmi(hidden, (), white(hidden), size=0.01)
    with pytest.raises(InterruptedError):
        examination.examine_hmi(HMI_CAUSES, null, np.random.default_rng(1), size=0.01)
    assert asked == [True]
    # What somebody asked for and these curves do not show is said before the way to it, which takes longest.
    with pytest.raises(
        InputError, match=r"cannot see 'boiling': it has no effect on these data; they see .*output-drift"
    ):
        examination.examine_hmi(HMI_CAUSES, null, np.random.default_rng(1), size=0.01, asked=(DRIFT, "boiling"))
    assert asked == [True]


def test_what_the_fit_leaves_of_an_effect_turns_little_from_shape_to_shape(problem):
    """Else an effect between two shapes looks like neither, and is not seen; the rule is that of `Cause.shapes`."""
    hidden, _ = measured_with(problem, "", 0.0, noise=0.01, seed=6)
    null = fit_hmi(hidden, (), white(hidden), size=0.01)
    basis, effects = independent(null.directions), hidden.alternatives(null.unknowns, null.directions, 0.01)
    for cause in (cause for cause in HMI_CAUSES if len(cause.shapes) > 1):
        for sign in {one.sign for one in effects if one.name == cause.name}:
            directions = [one.directions for one in effects if (one.name, one.sign) == (cause.name, sign)]
            columns = np.concatenate(directions, axis=1)
            left = unit_columns(columns - basis @ (basis.T @ columns))
            cosines = np.sum(left[:, 1:] * left[:, :-1], axis=0)
            assert np.all(cosines > 0.7), (cause.name, sign, cosines)


@pytest.mark.parametrize(("name", "strength"), [(LAG, 0.25), (LAG, 2.0), ("damage-law", 0.3)])
def test_screening_looks_along_the_way_to_the_fit_with_the_cause(problem, name, strength):
    """About the fit without a lag its effect says next to nothing; beliefs hold constants back in tests as in fits."""
    hidden, null, effects, rough = looked_for_in(problem, name, strength, 0.005)
    best = best_of_each(rough)[name]
    looked_along = [effects[0], best.alternative]
    found = Screen(null.directions, looked_along, hidden.noise_family()[:1]).statistics(null.residuals[:, None])
    cause = named(name)
    start = {"start": best.unknowns, "strengths": np.array([best.strength])}
    fit = fit_hmi(hidden, (Extension(cause, best.shape),), white(hidden), size=0.005, **start)
    effect, way = found.statistic[:, 0]
    freedom = len(fit.residuals) - fit.directions.shape[1]
    gained, roughly = (np.sqrt((null.misfit - one.misfit) * freedom / one.misfit) for one in (fit, best))
    # A straight way comes at least as near to the data as where it leads: it is nearest to them somewhere on it.
    assert effect < gained and way > roughly
    # A tenth less of the gain is a twentieth of t: no more than a fifth of t's standard error where t is 4.5. (A lag of
    # two seconds, t = 47, is too much for eight steps without new derivatives: they end at 53 % of the gain.)
    assert null.misfit - best.misfit > 0.9 * (null.misfit - fit.misfit)
    # The way from one fit to the other, but for the factors of the sonications.
    basis = np.linalg.qr(hidden.factors)[0]
    change = hidden.predict(best.unknowns) - hidden.predict(null.unknowns)
    way = best.alternative.directions[: len(hidden.rows), 0] * best.strength
    np.testing.assert_allclose(way - basis @ (basis.T @ way), change - basis @ (basis.T @ change), atol=1e-10)
    assert best.strength * best.alternative.sign > 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_refit_begins_at_the_rough_fit_of_the_shape_and_sign_that_were_tested(problem, monkeypatch, sign):
    """Not at the best of all shapes: by the fast simulation that may be one that imitates its errors."""
    _, null, _, rough = looked_for_in(problem, "cavitation", 0.3, 0.005)
    mine = next(fit for fit in rough if (fit.shape, fit.alternative.sign) == (66.0, sign))
    assert best_of_each(rough)["cavitation"] is not mine
    begun = {}
    fit = fit_hmi

    def followed(*given, **named_ones):
        begun.update(named_ones)
        return fit(*given, **named_ones)

    monkeypatch.setattr(examination, "fit_hmi", followed)
    noise = white(null.problem)
    refits = Refits(null, (noise,), size=0.005, corrected=False, starts=rough)
    refits([Extension(named("cavitation"), 66.0)], noise, np.array([sign * 0.02]), False)
    np.testing.assert_array_equal(begun["start"], mine.unknowns)
    np.testing.assert_array_equal(begun["strengths"], [mine.strength])


def test_causes_are_fitted_in_white_noise_too_where_another_kind_is_likeliest(problem, monkeypatch):
    """Without the cause noise has to explain it: in that noise the fit with it may come out where it is small."""
    hidden, null, effects, _ = looked_for_in(problem, DRIFT, 1.0, 0.005)
    family, size = hidden.noise_family(), 0.005
    noise = next(one for one in family if one.correlation == 0.6 and one.step == 1.0)
    near = again_from(null, noise, size)
    effects = [one for one in effects if one.sign > 0]
    (first, second) = examination.rough_fits_of(near, noise, effects, family, size, corrected=False)
    assert first.strength != second.strength
    for kind, better, worse in ((noise, first, second), (family[0], second, first)):
        misfit = [np.sum(Fitting(hidden, (), kind, size).stacked(one.unknowns) ** 2) for one in (better, worse)]
        assert better.misfit == pytest.approx(misfit[0], rel=1e-9) and misfit[0] < misfit[1]
    # Both ways begin at the fit that is tested: a way added to it leads to where the rough fit is.
    basis = np.linalg.qr(hidden.factors)[0]
    change = hidden.predict(second.unknowns) - hidden.predict(near.unknowns)
    way = second.alternative.directions[: len(hidden.rows), 0] * second.strength
    np.testing.assert_allclose(way - basis @ (basis.T @ way), change - basis @ (basis.T @ change), atol=1e-10)
    assert len(examination.rough_fits_of(null, family[0], effects, family, size, corrected=False)) == 1
    # A refit begins at the one that is better in its noise.
    begun, fit = [], fit_hmi
    monkeypatch.setattr(
        examination, "fit_hmi", lambda *given, **more: begun.append(more["start"]) or fit(*given, **more)
    )
    for kind, better in ((noise, first), (family[0], second)):
        refits = Refits(near, family, size=size, corrected=False, starts=(first, second))
        refits([Extension(named(DRIFT), first.shape)], kind, np.array([0.05]), False)
        np.testing.assert_array_equal(begun[-1], better.unknowns)
    # Better by the fast simulation: a correction to the full one is right about the fit without causes alone.
    constants = hidden.program.constants
    columns = hidden.rows.temperature[:, None] * np.ones(len(constants))
    off = Correction(second.unknowns, np.zeros(len(hidden.rows)), constants, columns)
    near = dataclasses.replace(near, problem=dataclasses.replace(hidden, correction=off))
    Refits(near, family, size=size, corrected=False, starts=(first, second))(
        [Extension(named(DRIFT), first.shape)], noise, np.array([0.05]), False
    )
    np.testing.assert_array_equal(begun[-1], first.unknowns)


def test_beliefs_on_the_way_to_a_fit_count_as_much_in_noise_that_is_louder_somewhere(problem):
    hidden, null, effects, _ = looked_for_in(problem, DRIFT, 1.0, 0.005)
    noise = next(one for one in hidden.noise_family() if one.correlation == 0.0 and one.step == 3.0)
    near, effects = again_from(null, noise, 0.005), [one for one in effects if one.sign > 0]
    (fit,) = rough_fits(near, noise, effects, size=0.005, spread=noise_size(near))
    believed = hidden.program.penalties(fit.unknowns) - hidden.program.penalties(near.unknowns)
    way = fit.alternative.directions[len(hidden.rows) :, 0] * fit.strength
    assert np.max(np.abs(believed)) > 0.01
    np.testing.assert_allclose(way, 0.005 * believed, atol=1e-12)


def test_refit_of_a_bad_first_guess_begins_where_the_rough_fit_is(problem):
    hidden, null, _, rough = looked_for_in(problem, "cavitation", 0.3, 0.005)
    cause, noise, best = named("cavitation"), white(hidden), best_of_each(rough)["cavitation"]
    lost = Refits(null, (noise,), size=0.005, corrected=False)([Extension(cause, 75.0)], noise, np.array([-0.1]), False)
    found = Refits(null, (noise,), size=0.005, corrected=False, starts=rough)(
        [Extension(cause, best.shape)], noise, np.array([1e-3]), False
    )
    assert lost.converged and lost.strengths[0] < 0.0
    assert found.converged and lost.misfit - found.misfit > 9.0 * found.variance
    assert found.intervals[0, 0] < 0.3 * cause.plausible < found.intervals[0, 1]


def test_way_of_a_cause_that_gains_is_asked_of_the_full_simulation(problem):
    hidden, begun, _, rough = looked_for_in(problem, DRIFT, 1.0, 0.005)
    # The fit of the full simulation is another one: the way begins there.
    null = dataclasses.replace(begun, unknowns=begun.unknowns + 0.01)
    best, family = best_of_each(rough)[DRIFT], hidden.noise_family()
    ways = in_full([(begun, rough)], null, family, 0.005)
    after = next(fit for fit in ways if fit.unknowns is best.unknowns)
    way = after.alternative.directions[:, 0] * best.strength
    change = hidden.program.simulate(best.unknowns) - hidden.program.simulate(null.unknowns)
    np.testing.assert_allclose(way[: len(hidden.rows)], change, atol=1e-12)
    believed = hidden.program.penalties(best.unknowns) - hidden.program.penalties(null.unknowns)
    np.testing.assert_allclose(way[len(hidden.rows) :], 0.005 * believed, atol=1e-12)
    # Where neither of the two sees anything it is not worth the time.
    hardly = best.misfit * (1.0 + 1.9**2 / begun.freedom)
    blind = dataclasses.replace(begun, misfit=hardly, residuals=0.0 * begun.residuals)
    assert all(a is b for a, b in zip(rough, in_full([(blind, rough)], blind, family, 0.005), strict=True))
    # One that the fast simulation has no use for, but along whose way lies what the full one leaves, may be in the way.
    seen = in_full([(dataclasses.replace(begun, misfit=hardly), rough)], null, family, 0.005)
    assert [a is not b for a, b in zip(rough, seen, strict=True)] == [fit is best for fit in rough]


@pytest.mark.slow
def test_rough_fits_are_those_of_the_fast_simulation_as_it_is(problem, monkeypatch):
    """A correction about the fit without causes is right there and nowhere else."""
    hidden, null, effects, _ = looked_for_in(problem, DRIFT, 1.0, 0.005)
    noise, asked = white(hidden), []
    corrected = hidden.corrected_at(null.unknowns, moved_by(hidden, ()))
    near = fit_hmi(corrected, (), noise, size=0.005, start=null.unknowns)
    monkeypatch.setattr(examination, "rough_fits", lambda begun, *_, **given: asked.append((begun, given)) or [])
    assert examination.rough_fits_of(near, noise, effects, (noise,), 0.005, corrected=True) == []
    begun, given = asked[0]
    # Fits end when a step gains a ten-thousandth; from two starts they are a few of these apart.
    assert begun.problem.correction is None and begun.misfit == pytest.approx(null.misfit, rel=0.01)
    # What stands out does so from what the full simulation leaves.
    assert given["spread"] == noise_size(near) != noise_size(begun)


@pytest.mark.slow
def test_refit_in_full_begins_corrected_where_the_rough_fit_is(problem, monkeypatch):
    _, null, _, rough = looked_for_in(problem, DRIFT, 1.0, 0.005)
    corrected, asked = HmiDiagnosisProblem.corrected_at, []

    def followed(self, unknowns, moved):
        asked.append(unknowns)
        return corrected(self, unknowns, moved)

    monkeypatch.setattr(HmiDiagnosisProblem, "corrected_at", followed)
    noise = white(null.problem)
    refits = Refits(null, (noise,), size=0.005, corrected=True, starts=rough)
    fit = refits([Extension(named(DRIFT), 0.0)], noise, np.array([0.05]), False)
    np.testing.assert_array_equal(asked[0], best_of_each(rough)[DRIFT].unknowns)
    assert len(asked) > 1 and fit.strengths[0] == pytest.approx(named(DRIFT).plausible, rel=0.3)


def test_pair_begins_where_one_of_the_two_came_out(problem, monkeypatch):
    _, null, _, rough = looked_for_in(problem, DRIFT, 1.0, 0.005)
    noise, begun, fit = white(null.problem), [], fit_hmi
    refits = Refits(null, (noise,), size=0.005, corrected=False, starts=rough)
    alone = refits([Extension(named(DRIFT), 0.0)], noise, np.array([0.05]), False)

    def followed(*given, **named_ones):
        begun.append(named_ones)
        return fit(*given, **named_ones)

    monkeypatch.setattr(examination, "fit_hmi", followed)
    pair = [Extension(named(DRIFT), 0.0), Extension(named(LAG), 0.0)]
    refits(pair, noise, np.array([9.0, 0.1]), False)
    np.testing.assert_array_equal(begun[0]["start"], alone.unknowns)
    np.testing.assert_array_equal(begun[0]["strengths"], [alone.strengths[0], 0.1])


def test_effect_of_a_tissue_that_cannot_be_is_that_of_a_smaller_strength(problem):
    """With noise so large that no strength would be seen, every effect is followed as far as there is one."""
    found = problem.alternatives(problem.program.null(), problem.factors, 10.0)
    assert all(np.all(np.isfinite(one.directions)) for one in found)


def test_a_fit_that_failed_blames_no_physics_and_designs_nothing(problem, prepared, described, monkeypatch, tmp_path):
    hidden, _ = measured_with(problem, DRIFT, 1.0, noise=0.01)
    fitted = hmi_diagnosis.fit_hmi
    monkeypatch.setattr(
        hmi_diagnosis, "fit_hmi",
        lambda *given, **named: dataclasses.replace(fitted(*given, **named), converged=False, status="it went astray"),
    )  # fmt: skip
    found = diagnose_curves(hidden, corrected=False)
    assert found.verdict == "fit-failure" and any("it went astray" in remark for remark in found.audit)
    Diagnosed(as_json(found), "these curves", found, None).write(tmp_path)
    assert {one.name for one in tmp_path.iterdir()} >= {"diagnosis.json", "report.md", "diagnosis.png", "residuals.pdf"}
    assert "nothing is said about physics" in (tmp_path / "report.md").read_text()
    with pytest.raises(InputError, match="fit of these data failed"):
        design_hmi(curves(np.full(len(TEMPERATURES), 100.0)), described, found=found, prepared=prepared)


def test_ends_of_intervals_are_searched_for_where_causes_fit_best_and_others_are_said(problem, monkeypatch):
    hidden, _ = measured_with(problem, "attenuation-kinetics", 1.5, noise=0.01)
    causes = tuple(named(n) for n in (DRIFT, "attenuation-kinetics", "lesion-stiffness-law", "conductivity-change"))
    profiled, followed = examination.profiled, []

    def recorded(fit, *given):
        followed.append(fit.extensions[0].cause.name)
        return profiled(fit, *given)

    monkeypatch.setattr(examination, "profiled", recorded)
    monkeypatch.setattr(hmi_diagnosis, "_FOLLOWED", 1)
    found = diagnose_curves(hidden, corrected=False, causes=causes, gain=False)
    best, *others = (name for name in found.decision.candidates if name in found.decision.possible)
    assert others and set(followed) == {best}
    said = [one for one in found.audit if "curvature at their fits" in one]
    assert len(said) == 1 and all(name in said[0] for name in others) and best not in said[0]
    refit = next(one.refit for one in found.causes if one.cause.name == others[0])
    half = refit.intervals[0] - refit.strengths[0]
    assert half[0] == pytest.approx(-half[1]) or refit.intervals[0, 0] == 0.0


def test_free_constants_of_curves_are_told_without_and_with_a_cause(problem):
    hidden, null, *_ = looked_for_in(problem, DRIFT, 1.0, 0.005)
    moved = dataclasses.replace(null, unknowns=null.unknowns + 0.01)
    constants = HmiAccount(hidden, null).constants(moved)
    values = hidden.program.parameters.values
    places = hidden.program.constants
    assert [(one.name, one.unit) for one in constants] == [one[:2] for one in hidden.program.parameters.columns]
    np.testing.assert_allclose([one.without for one in constants], values(jnp.asarray(null.unknowns[places])))
    np.testing.assert_allclose([one.with_causes for one in constants], values(jnp.asarray(moved.unknowns[places])))
    assert all(one.with_causes != one.without for one in constants)
    head, _, *rows = as_table(constants)
    assert head == "| constant | without | with it |" and len(rows) == len(constants)
    assert all(one.name in row and one.unit in row for one, row in zip(constants, rows, strict=True))
    values = [f"| {one.without:.4g} | {one.with_causes:.4g} |" for one in constants]
    assert all(row.endswith(value) for row, value in zip(rows, values, strict=True))


def test_what_is_left_of_curves_is_drawn_against_temperature_time_dose_and_sonication(problem):
    hidden, null, *_ = looked_for_in(problem, DRIFT, 1.0, 0.005)
    found = failed(HmiAccount(hidden, null), hidden, null.residuals, (), level=0.05, seed=0)
    first, *_ = axes = residuals_figure(found).axes
    labels = [axis.get_xlabel() for axis in axes]
    assert [words.split()[0] for words in labels] == ["temperature", "time", "thermal", "sonication"]
    points = np.sort(np.concatenate([line.get_ydata() for line in first.lines if len(line.get_xdata()) > 2]))
    np.testing.assert_allclose(points, np.sort(100.0 * null.of_readings))
    # The dose of a row is that of heating to its temperature: it rises all the time.
    rows = hidden.rows
    assert rows.dose is not None
    for sonication in range(2):
        mine = np.flatnonzero(rows.sonication == sonication)
        assert np.all(np.diff(rows.dose[mine][np.argsort(rows.temperature[mine])]) >= 0.0)
    assert np.max(rows.dose[rows.temperature < 43.0]) < 1.0 and np.max(rows.dose) > 240.0


def test_curves_without_and_with_a_cause_are_drawn_to_one_scale(problem):
    hidden, null, *_ = looked_for_in(problem, DRIFT, 1.0, 0.005)
    found = failed(HmiAccount(hidden, null), hidden, null.residuals, (), level=0.05, seed=0)
    extended = fit_hmi(hidden, (Extension(named(DRIFT), 0.0),), white(hidden), size=0.005)
    first, second, *_ = hmi_diagnosis_figure(dataclasses.replace(found, extended=extended)).axes
    assert second.get_title() == "with output-drift" and first.get_ylim() == second.get_ylim()
    drawn = np.concatenate([line.get_ydata() for axis in (first, second) for line in axis.lines])
    assert first.get_ylim()[0] < drawn.min() < drawn.max() < first.get_ylim()[1]
    # Lines are simulated, from 100 % on, and points are measured: as much above them as is left.
    for axis, left in ((first, null.of_readings), (second, extended.of_readings)):
        for number in (0, 1):
            line, points = axis.lines[2 * number : 2 * number + 2]
            assert line.get_ydata()[0] == pytest.approx(100.0) and len(line.get_xdata()) == 13
            percent = 100.0 * np.log(points.get_ydata() / line.get_ydata())
            np.testing.assert_allclose(percent, 100.0 * left[hidden.rows.sonication == number], atol=1e-9)


@pytest.mark.parametrize("one_sided", [False, True])
def test_a_sonication_on_one_side_of_the_simulation_is_explained(problem, one_sided):
    hidden, null, *_ = looked_for_in(problem, DRIFT, 1.0, 0.005)
    residuals = np.abs(null.residuals) + 1e-6 if one_sided else null.residuals
    figure = hmi_diagnosis_figure(failed(HmiAccount(hidden, null), hidden, residuals, (), level=0.05, seed=0))
    words = [text.get_text() for axis in figure.axes for text in axis.texts]
    assert any("on one side" in one for one in words) == one_sided


def test_report_of_correlated_noise_is_of_the_fit_in_that_noise(problem):
    """Refits with causes are weighed with it: beside them, the fit in white noise is another kind of fit."""
    hidden, _ = measured_with(problem, "", 0.0)
    noise, rng = np.zeros(len(hidden.rows)), np.random.default_rng(5)
    for i in range(1, len(noise)):
        noise[i] = (0.9 * noise[i - 1] if i != len(noise) // 2 else 0.0) + 0.02 * rng.standard_normal()
    rows = dataclasses.replace(hidden.rows, log_displacement=hidden.rows.log_displacement + noise)
    found = diagnose_curves(dataclasses.replace(hidden, rows=rows), corrected=False, causes=(named(DRIFT),), gain=False)
    white_fit = fit_hmi(found.problem, (), white(found.problem), size=noise_size(found.account.null))
    np.testing.assert_array_equal(found.account.null.residuals, found.residuals)
    assert np.max(np.abs(white_fit.of_readings - found.account.null.of_readings)) > 0.002
    simulated = rows.log_displacement - found.residuals[: len(noise)]
    last = 100.0 * np.exp(simulated[12] - simulated[0])
    assert any(line.startswith("| 1 | simulated") and f"| {last:.0f} at 64" in line for line in found.account.facts({}))
