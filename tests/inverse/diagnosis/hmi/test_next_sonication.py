"""The next sonication: that proposals are what they say, and that the rating follows from the physics of causes."""

import dataclasses
import json

import numpy as np
import pytest

from arfjax import InputError, PushSettings, SineIntensity, StepwiseProtocol, read_experiment
from arfjax.experiment.file import Protocol
from arfjax.protocols.stepwise import heating_by
from inverse.commands.main import run
from inverse.datasets.shipped import shipped
from inverse.design import design_hmi, hmi_design
from inverse.design.design import Check, Design, Rated
from inverse.design.hmi_proposals import THERMOCOUPLE, TRACKING, hmi_proposals
from inverse.design.report import as_json, report
from inverse.design.separation import separation
from inverse.diagnosis import HMI_CAUSES, Diagnosis
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.account import HmiAccount
from inverse.diagnosis.hmi.chain import reaching
from inverse.diagnosis.hmi.diagnosis import diagnose_curves
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.prepare import hmi_problem_of
from inverse.diagnosis.hmi.program import HmiProgram
from inverse.diagnosis.noise_gate import NoiseGate
from tests.inverse.diagnosis.hmi.cases import TEMPERATURES, bare, curves
from tests.inverse.diagnosis_keys import require_design_keys

LAG, JITTER, DRIFT = "thermocouple-lag", "tracking-jitter", "output-drift"


def test_proposals_are_what_they_say():
    usual = StepwiseProtocol(start_temperature=35.0, final_temperature=70.0, duration=60.0, push_duration=0.5e-3)
    found = {one.name: one for one in hmi_proposals(usual, reference=37.0, hottest=75.0, readings=13)}
    for one in found.values():
        assert len(one) == 13 and one.temperature[0] == 37.0 and np.all(np.diff(one.temperature) > 0.0)
        assert one.temperature[-1] == one.protocol.final_temperature
    assert found["again"].protocol == dataclasses.replace(usual, final_temperature=75.0)
    assert found["slower"].protocol.duration == 120.0 and found["faster"].seconds == 30.0
    assert found["longer-push"].protocol.push_duration == 1e-3 == 4.0 * found["shorter-push"].protocol.push_duration
    # The impulse of the usual push, on another course.
    for name in ("modulated-push", "later-reading"):
        course, given = found[name].protocol.modulation, found[name].protocol.push_duration
        np.testing.assert_allclose(given * float(course.coefficients(0)[0].real), usual.push_duration, rtol=1e-12)
        assert found[name].keys["push_ms"] == 1.0 and found[name].keys["push_modulation"] in ("intensity", "square")
    off = np.asarray(PushSettings(1e-5, 100, modulation=found["later-reading"].protocol.modulation).course)
    np.testing.assert_allclose(off[[0, 24, 75, 99]], 0.0, atol=1e-12)
    np.testing.assert_allclose(off[[25, 74]], 1.0, rtol=1e-12)
    assert "0.25 ms after" in found["later-reading"].words
    assert found["hotter"].temperature[-1] == 83.0 and found["not-coagulating"].temperature[-1] == 50.0
    assert found["around-coagulation"].temperature[1] == 48.0 and found["around-coagulation"].temperature[-1] == 60.0
    assert found["mr-thermometry"].immune == (THERMOCOUPLE,) and found["mr-displacement"].immune == (TRACKING,)


def test_nothing_is_proposed_that_the_protocol_does_not_allow():
    usual = StepwiseProtocol(start_temperature=35.0, final_temperature=48.0)
    names = {one.name for one in hmi_proposals(usual, reference=37.0, hottest=48.0, readings=6)}
    assert "not-coagulating" not in names and "around-coagulation" not in names
    names = {one.name for one in hmi_proposals(usual, reference=37.0, hottest=85.0, readings=6)}
    assert "hotter" not in names
    modulated = StepwiseProtocol(start_temperature=35.0, modulation=SineIntensity())
    names = {one.name for one in hmi_proposals(modulated, reference=37.0, hottest=70.0, readings=6)}
    assert "modulated-push" not in names and "longer-push" in names
    longest = StepwiseProtocol(start_temperature=35.0, push_duration=15e-3)
    names = {one.name for one in hmi_proposals(longest, reference=37.0, hottest=70.0, readings=6)}
    assert not names & {"modulated-push", "longer-push", "later-reading"} and "shorter-push" in names


@pytest.mark.parametrize(
    ("duration", "push_duration", "missing"),
    [
        (60.0, 0.5e-3, set()),
        (120.0, 15e-3, {"slower", "longer-push", "modulated-push", "later-reading"}),
        (0.15, 0.015e-3, {"faster", "shorter-push"}),
    ],
)
def test_an_experiment_file_may_have_every_sonication_that_is_proposed(duration, push_duration, missing):
    """A report says which keys to write; the longest sonication is of three minutes."""
    every = {"slower", "faster", "shorter-push", "longer-push", "modulated-push", "later-reading"}
    usual = StepwiseProtocol(start_temperature=35.0, duration=duration, push_duration=push_duration)
    found = hmi_proposals(usual, reference=37.0, hottest=75.0, readings=13)
    assert every - {one.name for one in found} == missing
    for one in found:
        said = Protocol(temperatures_c=[35.0, 75.0], normalised_at_c=37.0, **one.keys)
        assert said.sonication_s == one.seconds == one.protocol.duration


def test_places_of_immune_causes_exist():
    places = {cause.place for cause in HMI_CAUSES}
    assert {THERMOCOUPLE, TRACKING} <= places


def test_causes_in_question_alone_do_what_they_do_among_all(problem, prepared):
    """In a program of their own, shapes and constants included."""
    by_name = {cause.name: cause for cause in HMI_CAUSES}
    extensions = [Extension(by_name["pre-ablation-softening"], 50.0), Extension(by_name[LAG], 0.0)]
    strengths = np.array([-0.3, 0.5])
    unknowns = problem.program.null()
    unknowns[problem.program.constants] += 0.1 * problem.program.spreads
    fitted = hmi_design._Fitted.about(problem, prepared, 37.0, unknowns, extensions, strengths, 0.01)
    program, lean = fitted.lean
    np.testing.assert_allclose(program.predict(lean), problem.program.predict(fitted.unknowns), rtol=1e-12)
    softening = len(HMI_CAUSES) + problem.program.place("pre-ablation-softening")
    assert fitted.unknowns[softening] == 50.0 != unknowns[softening]
    effects, among_all = hmi_design._effects(program, lean, extensions, strengths), fitted.effects
    # Rounding of logarithms of a percent, some 1e-14, over steps of 1e-3.
    np.testing.assert_allclose(effects, among_all, rtol=1e-6, atol=1e-8 * np.abs(among_all).max())
    assert np.all(np.linalg.norm(among_all[:, :2], axis=0) > 1e-3)
    # An effect times its strength is what that strength changes.
    plain = problem.program.predict(fitted.unknowns)
    for column, extension, strength in zip(among_all.T, extensions, strengths, strict=False):
        at = fitted.unknowns.copy()
        at[problem.program.place(extension.cause.name)] = strength / extension.cause.plausible
        np.testing.assert_allclose(column * strength, problem.program.predict(at) - plain, atol=1e-10)
    # As strong as they are, in noise of 1 % and of what is believed of constants, by generalised least squares; sums of
    # a sonication's readings, which its factor takes, left out.
    slopes = problem.program.penalty_slopes(fitted.unknowns)[:, problem.program.constants]
    free = np.linalg.svd(problem.factors)[0][:, problem.factors.shape[1] :]
    constants, exact = among_all[:, 2:], program.slopes(lean, program.constants.tolist())
    # A central difference is off by the square of its step, a thousandth, times a third derivative.
    np.testing.assert_allclose(constants, exact, atol=1e-5 * np.max(np.linalg.norm(exact, axis=0)))
    covariance = 1e-4 * np.eye(len(constants)) + constants @ np.linalg.inv(slopes.T @ slopes) @ constants.T
    moved = free.T @ (among_all[:, :2] * strengths)
    lengths = np.sqrt(np.diagonal(moved.T @ np.linalg.solve(free.T @ covariance @ free, moved)))
    told = hmi_design._separation(fitted, None, None)
    np.testing.assert_allclose(told.d_prime, lengths, rtol=1e-6)
    assert told.names == ("pre-ablation-softening", LAG) and told.one_sided.tolist() == [False, True]


@pytest.fixture(scope="module")
def fitted(problem, prepared):
    """To tell a lag of the thermometer from a drift, by data with relative noise of 1 %."""
    by_name, program = {cause.name: cause for cause in HMI_CAUSES}, problem.program
    extensions, unknowns = [Extension(by_name[LAG], 0.0), Extension(by_name[DRIFT], 0.0)], program.null()
    unknowns[program.constants] += 0.1 * program.spreads
    return hmi_design._Fitted.about(problem, prepared, 37.0, unknowns, extensions, np.array([0.5, -0.1]), 0.01)


@pytest.fixture(scope="module")
def another_thermometer(described):
    found = hmi_proposals(described.stepwise(), reference=37.0, hottest=80.0, readings=13)
    return next(one for one in found if one.name == "mr-thermometry")


def test_a_further_sonication_is_one_more_series_with_a_factor_of_its_own(fitted, another_thermometer):
    """By generalised least squares of both together, as for what was measured alone; the thermometer has no lag."""
    courses, more = hmi_design._planned(fitted, another_thermometer)
    program, lean = fitted.lean
    further = hmi_design._effects(program.on(courses), lean, fitted.extensions, fitted.strengths)
    assert len(more) == 13 and not np.any(further[:, 0]) and np.any(fitted.effects[:, 0])
    assert more.is_reference.tolist() == [True] + 12 * [False]
    factors = np.zeros((len(fitted.effects) + 13, 3))
    factors[:-13, :2], factors[-13:, 2] = fitted.problem.factors, 1.0
    free = np.linalg.svd(factors)[0][:, 3:]
    effects, slopes = np.concatenate([fitted.effects, further]), fitted.problem.program.penalty_slopes(fitted.unknowns)
    slopes = slopes[:, fitted.problem.program.constants]
    covariance = 1e-4 * np.eye(len(effects)) + effects[:, 2:] @ np.linalg.inv(slopes.T @ slopes) @ effects[:, 2:].T
    moved = free.T @ (effects[:, :2] * fitted.strengths)
    products = moved.T @ np.linalg.solve(free.T @ covariance @ free, moved)
    told, lengths = hmi_design._rating(fitted, another_thermometer), np.sqrt(np.diagonal(products))
    np.testing.assert_allclose(told.d_prime, lengths, rtol=1e-6)
    np.testing.assert_allclose(told.cosine, products / np.outer(lengths, lengths), rtol=1e-6)


def test_sonications_of_any_number_of_readings_are_simulated_together_as_each_alone(fitted, described):
    """The shorter ones, filled up with their end, which the power of a sonication is scaled to; a lag looks back."""
    found = hmi_proposals(described.stepwise(), reference=37.0, hottest=70.0, readings=5)
    courses, _ = hmi_design._planned(fitted, next(one for one in found if one.name == "again"))
    program, lagging = fitted.lean[0], fitted.lean[1].copy()
    lagging[program.place(LAG)] = 1.0
    alone = [program.on([_first_of(one)]) for one in (*program.courses, *courses)]
    each = [one.predict(lagging) for one in alone]
    starts = np.cumsum([0, *(len(one) for one in each[:-1])])
    moved = [_first_of(one, start) for one, start in zip((*program.courses, *courses), starts, strict=True)]
    together = program.on(moved)
    np.testing.assert_allclose(together.predict(lagging), np.concatenate(each), atol=1e-12)
    assert together.excess(lagging) == pytest.approx(max(one.excess(lagging) for one in alone), rel=1e-12)


def test_what_tracking_adds_is_counted_in_displacements_of_the_coldest_state_of_each_sonication(fitted, described):
    """At which squares of one and of a jitter add, wherever another sonication begins."""
    found = hmi_proposals(described.stepwise(), reference=37.0, hottest=70.0, readings=5)
    warmer = dataclasses.replace(found[0], temperature=np.linspace(46.0, 70.0, 5))
    (further,), _ = hmi_design._planned(fitted, warmer)
    cause = next(cause for cause in HMI_CAUSES if cause.name == JITTER)
    (first, _), program = fitted.problem.program.courses, fitted.problem.program.with_causes([cause])
    program = program.on([_first_of(first), _first_of(further, len(first.rows))])
    jitter = program.null()
    jitter[program.place(JITTER)] = 0.2 / cause.plausible
    change = program.predict(jitter) - program.predict(program.null())
    np.testing.assert_allclose(change[[0, len(first.rows)]], 0.5 * np.log(1.2), rtol=1e-9)


def test_what_an_instrument_adds_does_not_change_with_the_push(fitted, described, prepared):
    """Compression, jitter and an offset are of the instrument: of a push that moves less, others parts of the motion.

    Displacements are those of the same fast simulation, asked by itself.
    """
    proposals = {one.name: one for one in hmi_proposals(described.stepwise(), reference=37.0, hottest=70.0, readings=4)}
    (usual,), _ = hmi_design._planned(fitted, proposals["again"])
    (short,), _ = hmi_design._planned(fitted, proposals["shorter-push"])
    program, unknowns = fitted.problem.program, fitted.unknowns
    model, curve = program.model(unknowns), prepared.fast.curve
    ratio = 1.0
    for course, power in ((short, 1.0), (usual, -1.0)):
        heating = reaching(
            heating_by(model, curve.heat(model, course.protocol), course.protocol, curve.settings), 70.0, 35.0
        )
        ratio *= float(curve.push(model, 37.0, curve.share(model, 37.0, heating), course.protocol)) ** power
    assert usual.motion == 1.0 and 0.1 < short.motion < 0.5
    np.testing.assert_allclose(short.motion, ratio, rtol=1e-9)
    for name, same in (
        ("tracking-compression", short.motion),
        (JITTER, short.motion**-2),
        ("echo-strain", 1.0 / short.motion),
    ):
        cause = next(cause for cause in HMI_CAUSES if cause.name == name)
        here = program.with_causes([cause])
        found = []
        for course, strength in ((short, 0.1), (dataclasses.replace(short, motion=1.0), 0.1 * same)):
            at = here.null()
            still = here.on([_first_of(course)]).predict(at)
            at[here.place(name)] = strength / cause.plausible
            found.append(here.on([_first_of(course)]).predict(at) - still)
        np.testing.assert_allclose(found[0], found[1], rtol=1e-9, atol=1e-12)
        assert np.ptp(found[0]) > 1e-4


def _first_of(course, start=0):
    """The same course, its rows numbered from there on."""
    return dataclasses.replace(course, rows=start + np.arange(len(course.rows)))


def test_a_sonication_that_the_fast_simulation_does_not_reach_is_not_rated(fitted, another_thermometer, monkeypatch):
    monkeypatch.setattr(HmiProgram, "excess", lambda self, unknowns: 1.01)
    assert hmi_design._rating(fitted, another_thermometer) is None


def test_a_check_diagnoses_what_was_measured_and_the_best_sonication_with_each_cause_in_both(
    fitted, another_thermometer, monkeypatch
):
    diagnosed, said, stated = [], [], np.full(len(fitted.problem.rows), 0.02)
    rows = dataclasses.replace(fitted.problem.rows, deviation=stated)
    # What a file says of its readings' noise says nothing of what is simulated.
    fitted = dataclasses.replace(fitted, problem=dataclasses.replace(fitted.problem, rows=rows))
    monkeypatch.setattr(hmi_design, "diagnose_curves", lambda simulated, **given: diagnosed.append((simulated, given)))
    monkeypatch.setattr(hmi_design, "checked", lambda hidden, _: Check(hidden, "confusable", (), ()))
    found = hmi_design._checks(fitted, another_thermometer, HMI_CAUSES, 3, said.append)
    assert [one.hidden for one in found] == [LAG, DRIFT] and len(said) == 2
    courses, more = hmi_design._planned(fitted, another_thermometer)
    program, noises = fitted.problem.program, []
    for (simulated, given), name, strength in zip(diagnosed, (LAG, DRIFT), (0.5, -1.0), strict=True):
        # Data of the fast simulation are no data of the full one, and are looked at with all causes.
        assert given == {"corrected": False, "causes": HMI_CAUSES, "seed": 3, "gain": False}
        unknowns = fitted.unknowns.copy()
        unknowns[program.place(name)] = strength
        without = np.append(program.predict(unknowns), program.on(courses).predict(unknowns))
        noises.append(simulated.rows.log_displacement - without)
        assert simulated.rows.sonication.tolist() == [*rows.sonication, *(13 * [2])]
        assert simulated.rows.labels == (*rows.labels, "next") and simulated.rows.deviation is None
        assert simulated.rows.is_reference.tolist() == [*rows.is_reference, *more.is_reference]
        for each in ("temperature", "time"):
            both = np.append(getattr(rows, each), getattr(more, each))
            np.testing.assert_array_equal(getattr(simulated.rows, each), both)
        np.testing.assert_allclose(simulated.predict(unknowns), without, atol=1e-12)
    # A size of 39 readings is known to a ninth; each simulation has noise of its own.
    assert all(abs(np.std(noise) / fitted.size - 1.0) < 0.4 for noise in noises)
    assert abs(np.corrcoef(noises)[0, 1]) < 0.6


def test_further_readings_have_the_relative_noise_of_those_that_there_are(problem, prepared, monkeypatch):
    """Of the file's deviations, where it states them, the middle one times how far residuals exceed them."""
    deviation = np.where(np.arange(len(problem.rows)) % 3 == 0, 0.05, 0.02)
    stated = dataclasses.replace(problem, rows=dataclasses.replace(problem.rows, deviation=deviation))
    by_name = {cause.name: cause for cause in HMI_CAUSES}
    two = [Extension(by_name[LAG], 0.0), Extension(by_name[DRIFT], 0.0)], np.array([0.5, -0.1])
    monkeypatch.setattr(hmi_design, "alive", lambda *_: two)
    for one, size in ((problem, 1.5), (stated, 0.03)):
        null = bare(HmiFit, unknowns=problem.program.null())
        account, noise = bare(HmiAccount, problem=one, null=null), bare(NoiseGate, size=1.5)
        found = hmi_design._fitted(bare(Diagnosis, account=account, noise=noise), prepared, 37.0, (), HMI_CAUSES)
        assert found.size == pytest.approx(size)


@pytest.fixture(scope="module")
def drifting(problem):
    unknowns = problem.program.null()
    unknowns[problem.program.place(DRIFT)] = 0.15
    percent = 100.0 * np.exp(problem.program.predict(unknowns))
    first = np.isin(np.arange(len(percent)), [0, len(TEMPERATURES) // 2])
    percent = 100.0 * percent / np.repeat(percent[first], len(TEMPERATURES) // 2)
    noise = 0.005 * np.random.default_rng(5).standard_normal(len(percent))
    return curves(percent * np.exp(np.where(first, 0.0, noise)))


@pytest.fixture(scope="module")
def found(drifting, described, settings, prepared):
    """By the fast simulation alone: the data come from it."""
    problem = hmi_problem_of(prepared, drifting, described, settings, HMI_CAUSES)
    return diagnose_curves(problem, corrected=False, gain=False, seed=1)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_more_data_never_separate_worse_and_another_thermometer_tells_its_faults_from_the_tissue(
    drifting, described, prepared, found
):
    told = design_hmi(drifting, described, found=found, prepared=prepared, causes=(LAG, DRIFT), check=False, seed=2)
    rated = {one.proposal.name: one.separation for one in told.rated}
    for one in rated.values():
        # The same readings and more: what is left of a cause after the constants are taken off cannot become shorter.
        assert np.all(one.d_prime > (1.0 - 1e-6) * told.now.d_prime)
    # A thermometer that does not lag says how the curve runs without it.
    lag = told.now.names.index(LAG)
    assert rated["mr-thermometry"].d_prime[lag] > rated["again"].d_prime[lag]
    assert len(told.rated) + len(told.notes) == 12
    content = as_json(told)
    require_design_keys(content)
    written = report(told, "drifting.csv")
    assert content["proposals"][0]["words"] in written and "`push_ms = " in written
    json.dumps(content, allow_nan=False)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_what_the_best_sonication_promises_is_kept(drifting, described, prepared, found):
    told = design_hmi(drifting, described, found=found, prepared=prepared, causes=(LAG, DRIFT), seed=2)
    assert [one.hidden for one in told.checks] == [LAG, DRIFT]
    for one, other in zip(told.checks, (DRIFT, LAG), strict=True):
        assert one.verdict != "adequate" and one.named != (other,)
    # A true cause is the answer in nine of ten such data sets, so that one of the two is in 99 of 100.
    assert any(one.hidden in (*one.named, *one.confusable) for one in told.checks)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [(["--hmi", "curves.csv"], "experiment file"), ([], "--dma FILE"), (["--dma", "a", "--hmi", "b"], "--dma FILE")],
)
def test_command_asks_for_what_it_needs(arguments, told, capsys, tmp_path):
    assert run(["design", *arguments, "--out", str(tmp_path / "out")]) == 2
    assert told in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_command_designs_in_the_experiment_that_it_is_given(monkeypatch, tmp_path, capsys):
    asked, out, file = [], tmp_path / "out", tmp_path / "curves.csv"
    rows = [f"{1 + i // 10},{37 + 3 * (i % 10)},{100 - i % 10},A" for i in range(20)]
    file.write_text("\n".join(["sonication,temperature_c,displacement_percent,operator", *rows]))

    def designed(measured, described, **given):
        asked.append((measured, described, given))
        usual, *_, other = hmi_proposals(described.stepwise(), reference=37.0, hottest=64.0, readings=10)
        apart, alike = (separation((LAG, DRIFT), turn, np.ones(2), np.zeros((2, 0)), 1.0, (1, 0))
                        for turn in (np.eye(2), np.array([[1.0, 0.8], [0.0, 0.6]])))  # fmt: skip
        rated = (Rated(other, apart), Rated(usual, alike))
        return Design("confusable", {LAG: 0.5, DRIFT: -0.1}, alike, rated, (), (0.01,), given["seed"], ("a note.",))

    monkeypatch.setattr("inverse.commands.design.design_hmi", designed)
    experiment = tmp_path / "low.toml"
    text = shipped("suomi2016_experiment").read_text()
    experiment.write_text(text.replace("frequency_mhz = 1.1", "frequency_mhz = 0.2"))
    asking = ["--causes", f"{LAG}, {DRIFT}", "--no-check", "--seed", "7"]
    assert run(["design", str(experiment), "--hmi", str(file), *asking, "--out", str(out)]) == 0
    ((measured, described, given),) = asked
    assert len(measured.displacement) == 20 and described == read_experiment(experiment)
    assert given.pop("on_step") and given == {
        "name": str(experiment), "causes": [LAG, DRIFT], "check": False, "seed": 7
    }  # fmt: skip
    content, summary = (json.loads((out / name).read_text()) for name in ("design.json", "summary.json"))
    require_design_keys(content)
    unused, narrow, note = content["notes"]
    assert (unused, note) == ("Columns not used: operator.", "a note.") and "as long as at 0.2 MHz" in narrow
    assert set(summary["inputs"]) == {"hmi", "experiment"} and summary["seed"] == 7
    assert summary["settings"] == {"causes": [LAG, DRIFT], "check": False}
    best = content["proposals"][0]
    assert summary["results"] == {"best": best["name"], "probability_right": best["probability_right"]}
    assert "curves.csv" in (out / "report.md").read_text() and (out / "design.pdf").exists()
    table = [line for line in capsys.readouterr().out.splitlines() if "%" in line and "MHz" not in line]
    assert "nothing more" in table[0] and "degC" in table[1] and len(table) == 3


def test_the_best_sonication_comes_first_and_what_cannot_be_rated_is_said(described, problem, prepared, monkeypatch):
    by_name = {cause.name: cause for cause in HMI_CAUSES}
    extensions, strengths = [Extension(by_name[name], 0.0) for name in (LAG, DRIFT)], np.array([0.5, -0.1])
    nothing = np.zeros((len(problem.rows), 0))
    lean = problem.program, problem.program.null()
    fitted = hmi_design._Fitted(
        problem, prepared, 37.0, problem.program.null(), extensions, strengths, 0.0123, lean, nothing
    )
    turned = {"again": 30.0, "slower": 60.0, "faster": 45.0, "hotter": None}

    def apart(angle):
        two = np.array([[1.0, np.cos(np.radians(angle))], [0.0, np.sin(np.radians(angle))]])
        return separation((LAG, DRIFT), two, np.ones(2), np.zeros((2, 0)), 1.0, (1, 0))

    def rating(_, proposal):
        angle = turned.get(proposal.name, 20.0)
        return None if angle is None else apart(angle)

    monkeypatch.setattr(hmi_design, "_fitted", lambda *_: fitted)
    monkeypatch.setattr(hmi_design, "_separation", lambda *_: apart(10.0))
    monkeypatch.setattr(hmi_design, "_rating", rating)
    diagnosed, curve = object.__new__(Diagnosis), curves(np.full(len(TEMPERATURES), 100.0))
    for name, value in (("causes", ()), ("verdict", "confusable")):
        object.__setattr__(diagnosed, name, value)
    asked = {"found": diagnosed, "prepared": prepared, "causes": (LAG, DRIFT), "check": False, "seed": 3}
    told = design_hmi(curve, described, **asked)
    assert [one.proposal.name for one in told.rated[:3]] == ["slower", "faster", "again"]
    assert told.causes == {LAG: 0.5, DRIFT: -0.1} and told.sizes == (0.0123,) and told.verdict == "confusable"
    hotter = [note for note in told.notes if note.startswith("Not rated")]
    assert len(hotter) == len(told.notes) == 1 and hotter[0].endswith("a sonication to 88 degC.")
    assert all(len(one.proposal) == 13 for one in told.rated)
    # The best one is simulated, and a diagnosis is made with the library where there is none.
    simulated, made = [], []
    monkeypatch.setattr(hmi_design, "_checks", lambda _, proposal, *__: simulated.append(proposal.name) or ())
    monkeypatch.setattr(hmi_design, "diagnose_hmi", lambda *_, **given: made.append(given) or diagnosed)
    told = design_hmi(
        curve, described, **{**asked, "check": True, "causes": (LAG,), "found": None, "library": HMI_CAUSES[:9]}
    )
    assert simulated == ["slower"] and told.notes[0].startswith(f"Of {LAG} alone nothing is to be told apart")
    assert made[0]["causes"] == HMI_CAUSES[:9] and made[0]["prepared"] is prepared
    assert made[0]["seed"] == 3 and not made[0]["gain"]
    monkeypatch.setattr(hmi_design, "_rating", lambda *_: None)
    assert design_hmi(curve, described, **asked).notes == (hmi_design.NOT_RATED,)


def test_the_diagnosis_behind_a_design_refuses_what_the_curves_cannot_show(described, prepared, monkeypatch):
    given = []

    def diagnosed(*_, **options):
        given.append(options)
        raise InterruptedError

    monkeypatch.setattr(hmi_design, "diagnose_hmi", diagnosed)
    with pytest.raises(InterruptedError):
        design_hmi(curves(np.full(len(TEMPERATURES), 100.0)), described, prepared=prepared, causes=(LAG, LAG, DRIFT))
    assert given[0]["asked"] == [LAG, DRIFT] and given[0]["gain"] is False


def test_names_that_are_none_are_refused_before_what_takes_minutes(described, monkeypatch):
    monkeypatch.setattr(hmi_design, "prepare_hmi", lambda *_, **__: pytest.fail("a fast simulation was prepared"))
    with pytest.raises(InputError, match="there is no cause 'gremlins'"):
        design_hmi(curves(np.full(len(TEMPERATURES), 100.0)), described, causes=("gremlins", LAG))
