"""`inverse.diagnose`: the command in one call."""

import dataclasses
import inspect
import json
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import inverse
from arfjax import InputError, read_experiment
from inverse.commands.main import run
from inverse.datasets.dma import dma_data, read_dma
from inverse.datasets.hmi import read_hmi
from inverse.datasets.shipped import shipped
from inverse.datasets.table import unused
from inverse.diagnosis import DMA_CAUSES, HMI_CAUSES, DmaCause, diagnose_hmi
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.choice import find_causes
from inverse.diagnosis.content import as_json
from inverse.diagnosis.dma import diagnosis as dma_diagnosis
from inverse.diagnosis.dma.problem import dma_problem
from inverse.diagnosis.gain import Gain
from inverse.diagnosis.odds import Odds
from inverse.diagnosis.report import pairs_in_question, report
from inverse.diagnosis.rule import MOST_BESIDE, MOST_INSTEAD
from inverse.figures.diagnosis import LABELS
from inverse.figures.residuals import residuals_figure
from inverse.resolution import RESOLUTION, as_measured
from tests.blind import dma_generator as blind
from tests.inverse.diagnosis_keys import INSIDE, require_keys

EXAMPLES = Path(__file__).parents[3] / "examples"


class Backlash(DmaCause):
    """Play in the drive: a cause that is in no library."""

    name, place, unit, sign, plausible = "backlash", "instrument: drive", "1", 1, 0.1
    sentence, helps, source = "The drive has play.", "Two amplitudes.", "assumed"

    def measured(self, modulus, state, strength, shape):
        return modulus / (1.0 + strength * jnp.abs(modulus) / state.conditions.stiffest)


class Speechless(DmaCause):
    """A cause that does not say everything of itself."""

    name, place, unit, sign, plausible, sentence = "speechless", "sample: voice", "1", 1, 0.1, "Nothing is said."


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hidden")
    blind.write(
        folder / "data.csv", folder / "key.json", seed=blind.TEST_SEEDS + 5001, name="sweep-drift", d_prime=12.0
    )
    return folder / "data.csv"


def test_returns_what_it_writes(file, tmp_path):
    found = inverse.diagnose(file, out=tmp_path / "out", gain=False, seed=3)
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text()) == json.loads(json.dumps(found.content))
    assert found.content["verdict"] == found.verdict != "adequate"
    assert found.content["named"] == list(found.named) and found.content["seed"] == 3
    assert "data.csv" in (tmp_path / "out" / "report.md").read_text()
    require_keys(found.content)
    # Of each part something is there to be looked at, but for the gain, which takes refits: it is written as it is.
    empty = {part for part in INSIDE if not found.content[part]}
    assert empty <= {"gain", "links", "separation"}
    assert {one.name for one in dataclasses.fields(Gain)} == set(INSIDE["gain"])
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".json", ".md", ".png", ".pdf"}


def test_takes_data_that_are_read_already_and_writes_nothing_by_itself(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    read = inverse.diagnose(read_dma(file), causes=["sweep-drift", "slip"], gain=False)
    assert {one["name"] for one in read.content["causes"]} == {"sweep-drift", "slip"}
    assert list(tmp_path.iterdir()) == []
    again = inverse.diagnose(str(file), causes=["slip", "sweep-drift", "slip"], gain=False)
    assert again.verdict == read.verdict


def test_a_cause_of_ones_own_joins_the_library(file):
    found = inverse.diagnose(file, causes=("sweep-drift", Backlash()), gain=False)
    names = {one["name"] for one in found.content["causes"]} | {one["name"] for one in found.content["not_testable"]}
    assert names == {"sweep-drift", "backlash"}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"causes": ["gremlins"]}, "there is no cause 'gremlins'"),
        ({"causes": ["sweep-drfit"]}, r"\(is 'sweep-drift' meant\?\)"),
        ({"causes": ["boiling"]}, "'boiling' is a cause of curves of displacement, not of these data"),
        ({"causes": [Speechless()]}, "Speechless does not say its helps, source"),
        ({"causes": [Backlash(), "slip", Backlash()]}, "two are called 'backlash'"),
        ({"causes": HMI_CAUSES[:1]}, "'thermocouple-viscous-heating' is no DmaCause"),
        ({"model": "maxwell"}, "fractional, zener"),
        ({"seed": -1}, "`seed` must be 0 to 4294967295, got -1"),
    ],
)
def test_wrong_names(file, wrong, said):
    with pytest.raises(InputError, match=said):
        inverse.diagnose(file, **wrong)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (Backlash, r"Backlash is a class; give a cause of it: Backlash\(\)"),
        (None, "None is no cause: give names, or causes as CONTRIBUTING.md shows"),
    ],
)
def test_what_is_no_cause(wrong, said):
    # As users have it, whose annotations nobody checks.
    with pytest.raises(InputError, match=said):
        inspect.unwrap(find_causes)(["slip", wrong], DMA_CAUSES)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"shapes": (2.0, 1.0), "shape_means": "gap"}, r"`shapes` that ascend, at least one, got \(2.0, 1.0\)"),
        ({"shapes": ()}, r"`shapes` that ascend, at least one"),
        ({"shapes": (1.0, 2.0)}, "a `shape_means`, since it has several"),
        ({"plausible": 0.0}, "a finite `plausible` above 0, got 0"),
        ({"plausible": math.nan}, "a finite `plausible` above 0, got nan"),
        ({"sign": -1}, r"a `sign` of 0 \(either sign\) or 1"),
        ({"largest": 0.05}, "a `largest` of its `plausible`, 0.1, or more"),
        ({"sign": 0, "least": 0.0}, "a `least` below 0, since its `sign` is 0, got 0"),
    ],
)
def test_a_cause_of_ones_own_that_no_search_could_use(wrong, said):
    with pytest.raises(InputError, match=f"causes: 'backlash' needs {said}"):
        find_causes([type("Odd", (Backlash,), wrong)()], DMA_CAUSES)


class Neighbours(Backlash):
    """Averages a row with the one before, as filters of some instruments do."""

    def measured(self, modulus, state, strength, shape):
        return (1.0 - strength) * modulus + strength * jnp.roll(modulus, 1)


def test_a_cause_of_ones_own_that_mixes_rows_has_to_say_so():
    with pytest.raises(InputError, match="'backlash' makes a row's modulus of other rows': say `mixes_rows = True`"):
        find_causes([Neighbours()], DMA_CAUSES)
    said = type("Said", (Neighbours,), {"mixes_rows": True})()
    assert find_causes([said], DMA_CAUSES) == (said,)


def test_one_cause_in_place_of_a_list(file):
    with pytest.raises(InputError, match=r"`causes` must be a list, got Backlash: write \[...\] around it"):
        inspect.unwrap(inverse.diagnose)(file, causes=Backlash())


def simulated(inertia):
    frequency, sizes = np.geomspace(0.5, 50.0, 12), np.array([1.0, 0.8, 0.6])
    constants = np.outer(sizes, [3000.0, 9000.0, 0.01, 0.0]) + [0.0, 0.0, 0.0, 0.6]
    omega = 2.0 * np.pi * frequency
    modulus = (blind.solid(constants, omega) - inertia * omega**2).ravel()
    temperature = np.repeat([25.0, 40.0, 55.0], len(frequency))
    return dma_data(np.tile(frequency, 3), temperature, np.stack([modulus.real, modulus.imag], axis=-1))


@pytest.mark.parametrize(("inertia", "named"), [(0.0, ()), (5e-3, ("instrument-inertia",))])
def test_of_data_that_are_simulated_without_noise_the_rounding_is_not_examined(inertia, named):
    """Tests are relative to what is left: of 16 digits that had been their last ones, and `unexplained`."""
    found = inverse.diagnose(simulated(inertia), causes=["instrument-inertia", "slip"], gain=False)
    assert (found.verdict, found.named) == ("named" if named else "adequate", named)
    assert "they look simulated" in found.remarks[-1] and found.remarks[-1] in found.content["notes"]
    # 72 numbers, 12 constants and a strength at most: four standard errors of a standard deviation.
    assert found.content["noise"]["size"] == pytest.approx(RESOLUTION, rel=4.0 / np.sqrt(2.0 * 59.0))


def test_noise_of_the_resolution_is_in_magnitude_and_phase_alike():
    data = simulated(0.0)
    magnitude_alone = dma_data(data.frequency_hz, data.temperature_c, data.modulus_magnitude)
    coarse, again, alone = as_measured(data, 3), as_measured(data, 3), as_measured(magnitude_alone, 3)
    change = np.log(
        (coarse.storage_modulus + 1j * coarse.loss_modulus) / (data.storage_modulus + 1j * data.loss_modulus)
    )
    for part in (change.real, change.imag):
        assert np.std(part) == pytest.approx(RESOLUTION, rel=4.0 / np.sqrt(72.0))
    np.testing.assert_array_equal(coarse.storage_modulus, again.storage_modulus)
    np.testing.assert_allclose(alone.modulus_magnitude, coarse.modulus_magnitude, rtol=1e-12)
    assert not alone.has_phase


def test_single_precision_is_refused_before_anything_is_done(file):
    jax.config.update("jax_enable_x64", False)
    described = read_experiment(shipped("suomi2016_experiment"))
    try:
        for ask in (
            lambda: inverse.diagnose(file),
            lambda: inverse.diagnose(hmi="nowhere.csv", experiment="nowhere.toml"),
            lambda: diagnose_hmi(read_hmi(shipped("suomi2016_hmi")), described),
        ):
            with pytest.raises(ValueError, match="diagnoses need double precision"):
                ask()
    finally:
        jax.config.update("jax_enable_x64", True)


def test_a_fit_that_failed_blames_no_physics(file, tmp_path, monkeypatch):
    prepared = dma_diagnosis.dma_problem

    def failing(*given, **named):
        problem = prepared(*given, **named)
        lost = dataclasses.replace(problem.fits[2], converged=False, status="no minimum was found")
        return dataclasses.replace(problem, fits=(*problem.fits[:2], lost, *problem.fits[3:]))

    monkeypatch.setattr(dma_diagnosis, "dma_problem", failing)
    found = inverse.diagnose(file, out=tmp_path / "out")
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert found.verdict == content["verdict"] == "fit-failure"
    assert content["causes"] == content["named"] == [] and content["omnibus"]["p_value"] is None
    assert any("no minimum was found" in remark for remark in content["audit"])
    assert "nothing is said about physics" in (tmp_path / "out" / "report.md").read_text()


def test_two_causes_are_called_two_and_sets_of_pairs_are_listed(file):
    found = inverse.diagnose(file, causes=["sweep-drift", "slip", "drying"], gain=False).details
    assert found.decision is not None

    def concluded(verdict, *explanations):
        decision = dataclasses.replace(found.decision, verdict=verdict, explanations=explanations)
        return dataclasses.replace(found, verdict=verdict, decision=decision)

    def reported(verdict, *explanations):
        return report(concluded(verdict, *explanations), "these data", [])

    assert "lacks one cause" in reported("named", ("slip",))
    assert "lacks two causes" in reported("named", ("sweep-drift", "slip"))
    several = reported("confusable", ("sweep-drift", "slip"), ("drying", "slip"))
    assert "two together are: sweep-drift with slip; drying with slip" in several
    assert "\n\nWhat is left, without a name: " in reported("unexplained", ("slip",))
    assert pairs_in_question(concluded("named", ("sweep-drift", "slip"))) == []
    assert pairs_in_question(concluded("confusable", ("drying",), ("slip",))) == []


def test_a_refit_with_two_causes_is_one_in_question(file):
    found = inverse.diagnose(file, causes=["sweep-drift", "slip", "drying"], gain=False).details
    first, second, third = found.causes
    names = [one.cause.name for one in found.causes]

    def with_both(one):
        return dataclasses.replace(one, status="named", refit=both, converged=True)

    def refitted(*reports):
        return dataclasses.replace(found.extended, extensions=tuple(Extension(one.cause, 0.0) for one in reports))

    both, alone = refitted(second, first), refitted(third)
    third = dataclasses.replace(third, status="possible", refit=alone, converged=True)
    found = dataclasses.replace(found, causes=(with_both(first), with_both(second), third))
    assert found.in_question == {f"{names[1]} and {names[0]}": both, names[2]: alone}


def test_the_terminal_says_which_pairs_and_which_columns_were_not_used(file, tmp_path, monkeypatch, capsys):
    found = inverse.diagnose(file, causes=["sweep-drift", "slip", "drying"], gain=False)
    assert found.details.decision is not None
    pairs = (("sweep-drift", "slip"), ("drying", "slip"))
    decision = dataclasses.replace(found.details.decision, verdict="confusable", explanations=pairs)
    details = dataclasses.replace(found.details, verdict="confusable", decision=decision)
    several = dataclasses.replace(found, details=details, remarks=unused(("tyme_s",)))
    monkeypatch.setattr("inverse.commands.diagnose.diagnose", lambda *_, **__: several)
    assert run(["diagnose", "--dma", str(file), "--out", str(tmp_path / "out")]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "two together, which cannot be told apart: sweep-drift with slip; drying with slip" in shown
    assert "Columns not used: tyme_s." in shown


def test_the_command_writes_each_of_two_files_into_its_folder(file, tmp_path, monkeypatch, capsys):
    """What is asked of each, and where it stands; the curves' own diagnosis takes minutes, another stands for it."""
    found, asked = inverse.diagnose(file, causes=["sweep-drift", "slip"], gain=False), []

    def answer(**named):
        asked.append(named)
        return found

    monkeypatch.setattr("inverse.commands.diagnose.diagnose", answer)
    experiment, curves, out = (
        str(EXAMPLES / "suomi2016_published.toml"),
        str(shipped("suomi2016_hmi")),
        tmp_path / "out",
    )
    causes = ["--causes", "slip,boiling", "--seed", "3", "--level", "0.1"]
    assert run(["diagnose", experiment, "--dma", str(file), "--hmi", curves, "--out", str(out), *causes]) == 0
    of_dma, of_hmi = asked
    # What is of one measurement is not asked of the other, which would refuse it.
    assert of_dma["dma"] == file and not {"hmi", "experiment"} & of_dma.keys()
    assert (str(of_hmi["hmi"]), str(of_hmi["experiment"])) == (curves, experiment)
    assert not {"dma", "model", "trust_units"} & of_hmi.keys()
    assert [[one.name for one in named["causes"]] for named in (of_dma, of_hmi)] == [["slip"], ["boiling"]]
    assert all((named["seed"], named["level"]) == (3, 0.1) for named in (of_dma, of_hmi))
    assert {path.name for path in out.iterdir()} == {"dma", "hmi", "summary.json"}
    results, shown = json.loads((out / "summary.json").read_text())["results"], "".join(capsys.readouterr().out.split())
    for kind in ("dma", "hmi"):
        assert json.loads((out / kind / "diagnosis.json").read_text()) == json.loads(json.dumps(found.content))
        assert results[kind]["verdict"] == found.verdict and len(results[kind]["diagnosis_sha256"]) == 64
        assert str(out / kind) in shown


def test_that_no_cause_was_likely_enough_to_be_tried_is_said(file):
    found = inverse.diagnose(file, causes=["slip"], gain=False).details
    assert found.decision is not None
    decision = dataclasses.replace(
        found.decision, verdict="unexplained", explanations=(), candidates={}, odds=Odds(9.0, -math.inf, 0.0)
    )
    text = report(dataclasses.replace(found, verdict="unexplained", decision=decision), "these data", [])
    assert "None of the causes that were looked for is likely enough" in text and "9 nat" not in text
    unseen = dataclasses.replace(found, verdict="unexplained", decision=decision, causes=())
    assert "These data can see none of the causes that were looked for" in report(unseen, "these data", [])


def test_what_p_values_are_multiplied_by_is_said_where_they_are(file):
    found = inverse.diagnose(file, causes=["slip"], level=0.01, gain=False).details
    assert found.decision is not None and found.decision.omnibus.least_p == 1.0 / 2001.0
    omnibus = dataclasses.replace(found.decision.omnibus, allowance=1.3)
    averaged = dataclasses.replace(found, decision=dataclasses.replace(found.decision, omnibus=omnibus))
    assert "and multiplied by 1.3" in report(averaged, "these data", [])
    assert "multiplied by" not in report(found, "these data", [])


def test_columns_that_are_not_used_are_named(file, tmp_path):
    misspelled = tmp_path / "misspelled.csv"
    misspelled.write_text(file.read_text().replace("time_s", "tyme_s"))
    found = inverse.diagnose(misspelled, out=tmp_path / "out", causes=["slip"], gain=False)
    said = "Columns not used: tyme_s."
    assert said in (tmp_path / "out" / "report.md").read_text() and said in found.content["notes"]
    assert inverse.diagnose(file, causes=["slip"], gain=False).remarks == ()


@pytest.mark.parametrize(("over", "instead"), [(-0.1, True), (0.1, True), (0.1, False)])
def test_it_is_said_that_a_cause_is_not_named_for_a_correction_that_is_more_probable(file, over, instead):
    found = inverse.diagnose(file, causes=["slip"], gain=False).details
    assert found.decision is not None
    odds = Odds(MOST_INSTEAD + (over if instead else -1.0), -0.3 if instead else MOST_BESIDE + over, 9.0)
    decision = dataclasses.replace(
        found.decision, verdict="unexplained", explanations=(), candidates={"slip": 0.3}, odds=odds, best_fit="slip",
    )  # fmt: skip
    slip = dataclasses.replace(found.causes[0], status="possible", left=0.3, converged=True)
    conspicuous, lost = dataclasses.replace(slip, left=0.02), dataclasses.replace(slip, converged=False)
    found = dataclasses.replace(found, verdict="unexplained", decision=decision, causes=(slip,))
    in_place = "A correction of no name is too probable in the place of all causes"
    beside = "slip fits best, and a correction of no name is too probable beside it"
    number, allowed = (odds.instead, MOST_INSTEAD) if instead else (odds.beside, MOST_BESIDE)
    numbers = f"by its odds of {number:+.2g} nat, strengths and noise averaged over, where {allowed:+.2g} are allowed."
    named = "slip would leave nothing conspicuous, and is not named for this reason."
    text = report(found, "these data", [])
    assert (in_place in text) == (over > 0.0 and instead) and (beside in text) == (over > 0.0 and not instead)
    assert (numbers in text) == (named in text) == (over > 0.0)
    assert as_json(found)["omnibus"]["odds_of_no_name"] == {
        "instead": odds.instead, "beside": odds.beside, "evidence": 9.0
    }  # fmt: skip
    for other in (conspicuous, lost):
        text = report(dataclasses.replace(found, causes=(other,)), "these data", [])
        assert named not in text and (numbers in text) == (over > 0.0)
    named_now = report(dataclasses.replace(found, verdict="confusable"), "these data", [])
    nothing = report(dataclasses.replace(found, causes=()), "these data", [])
    assert all("nat, strengths" not in text for text in (named_now, nothing))


def test_it_is_said_which_model_leaves_what_and_whose_strengths_are_of_two(file):
    found = inverse.diagnose(file, causes=["sweep-drift", "slip"], gain=False).details
    assert found.named == ("sweep-drift",) and found.extended is not None
    text = report(found, "these data", [])
    assert "Of what the model with sweep-drift in it leaves" in text and "Residuals of the model without causes" in text
    assert "are of the model with both" not in text
    both = tuple(Extension(one.cause, 0.0) for one in found.causes)
    refit = dataclasses.replace(found.extended, extensions=both, strengths=np.zeros(2), intervals=np.zeros((2, 2)))
    found = dataclasses.replace(found, extended=refit)
    listed = " and ".join(one.cause.name for one in found.causes)
    assert f"Strengths of {listed} are of the model with both." in report(found, "these data", [])
    assert "Of what the model without causes leaves" in report(dataclasses.replace(found, extended=None), "these", [])


def test_constants_of_every_sweep_stand_in_json_and_report_as_the_extension_makes_them(file):
    told = inverse.diagnose(file, causes=["sweep-drift", "slip"], gain=False)
    found, constants = told.details, told.content["constants"]
    assert [one["name"] for one in constants] == ["M_0", "M_inf", "tau", "alpha"] * len(found.problem.sweeps)
    assert {one["name"]: one["unit"] for one in constants} == {"M_0": "Pa", "M_inf": "Pa", "tau": "s", "alpha": "1"}
    for values, key in ((found.account.null, "without"), (found.extended.constants, "with_causes")):
        np.testing.assert_array_equal([one[key] for one in constants], np.ravel(values))
    text = report(found, "these data", [])
    first = constants[0]
    assert "Constants without and with sweep-drift:\n\n| sweep | M_0 [Pa] | M_inf [Pa] | tau [s] | alpha |\n" in text
    assert f"| {first['of']} | {first['without']:.4g} → {first['with_causes']:.4g} |" in text
    assert not any(one["without_at_end"] or one["with_causes_at_end"] for one in constants) and "`?` marks" not in text
    # A relaxation time at the end of its range; a modulus of the branch that vanished is no end of the unrelaxed one.
    shortest, _ = found.problem.parameters[1][2].transform.bounds
    ended = found.extended.constants.copy()
    ended[1, 1:3] = ended[1, 0], shortest
    at_end = dataclasses.replace(found, extended=dataclasses.replace(found.extended, constants=ended))
    marked = [(one["of"], one["name"]) for one in as_json(at_end)["constants"] if one["with_causes_at_end"]]
    assert marked == [(found.problem.sweeps[1].label, "tau")]
    assert f"→ {shortest:.4g} ? |" in report(at_end, "these data", []) and "`?` marks" in report(at_end, "these", [])
    without = dataclasses.replace(found, extended=None)
    assert as_json(without)["constants"] == [] and "Constants without" not in report(without, "these data", [])


@pytest.mark.parametrize(("p_value", "near"), [(0.003, False), (0.035, True), (0.065, True), (0.2, False)])
def test_that_another_seed_may_find_otherwise_is_said_near_the_level(file, p_value, near):
    """Of 400 replicates the standard error of a p of 0.05 is 0.011."""
    found = inverse.diagnose(file, causes=["slip"], gain=False).details
    assert found.decision is not None
    omnibus = dataclasses.replace(found.decision.omnibus, p_value=p_value)
    text = report(
        dataclasses.replace(found, decision=dataclasses.replace(found.decision, omnibus=omnibus)), "these", []
    )
    assert "calibrated on 400 replicates of these residuals" in text
    assert ("other seeds may find it on the other side of the level" in text) == near


@pytest.mark.parametrize(("statistic", "near"), [(3.2, True), (-3.2, True), (9.0, False)])
def test_a_strength_that_is_just_seen_is_said_to_be_probably_too_high(file, statistic, near):
    found = inverse.diagnose(file, causes=["sweep-drift", "slip"], gain=False).details
    causes = [dataclasses.replace(one, statistic=statistic, shape=0.25) for one in found.causes]
    text = report(dataclasses.replace(found, causes=tuple(causes)), "these data", [])
    assert ": here 0.25" in text
    assert ("it is probably overestimated" in text) == near


def test_what_is_left_is_drawn_against_every_coordinate_with_the_correction_of_no_name(file):
    found = inverse.diagnose(file, causes=["slip"], gain=False).details
    found = dataclasses.replace(found, verdict="unexplained", extended=None)
    figure = residuals_figure(found)
    assert [axis.get_xlabel() for axis in figure.axes[3:6]] == [
        "frequency [Hz]",
        "temperature [degC]",
        "time [s]",
    ]
    assert [figure.axes[row].get_ylabel() for row in (0, 3)] == list(LABELS)
    assert all("measured − model" in each for each in LABELS)
    problem, correction = found.problem, found.places[0]
    drawn = {line.get_linestyle(): line for line in figure.axes[0].lines if len(line.get_xdata()) > 2}
    last = np.flatnonzero(np.asarray(problem.conditions.sweep) == len(problem.sweeps) - 1)
    relative = 100.0 * (correction.correction / problem.weights.ravel()).reshape(problem.weights.shape)[last, 0]
    np.testing.assert_allclose(np.sort(drawn["-"].get_ydata()), np.sort(relative))
    residuals = 100.0 * (found.residuals / problem.weights.ravel()).reshape(problem.weights.shape)[last, 0]
    np.testing.assert_allclose(np.sort(drawn["None"].get_ydata()), np.sort(residuals))
    assert figure.get_suptitle() == f"line: {correction.words}"


def test_rows_are_called_rows_where_the_file_gives_no_time(file):
    found = inverse.diagnose(file, causes=["slip"], gain=False).details
    timeless = dma_problem(dataclasses.replace(read_dma(file), time_s=None), found.problem.model, n_starts=2)
    figure = residuals_figure(dataclasses.replace(found, problem=timeless))
    assert figure.axes[5].get_xlabel() == "time [rows]"


def test_the_likeliest_places_are_ranked_by_what_they_absorb(file):
    """Of two forms of the same words the likelier is shown: its twin, beyond those shown, does not take it away."""
    found = inverse.diagnose(file, causes=["slip"], gain=False).details
    places = [
        dataclasses.replace(found.places[0], words=words, share=share)
        for words, share in [("here", 0.6), ("b", 0.8), ("c", 0.7), ("d", 0.9), ("e", 0.5), ("f", 0.95), ("here", 0.3)]
    ]
    content = as_json(dataclasses.replace(found, places=tuple(places)))
    assert [(one["words"], one["share"]) for one in content["where"]] == [
        ("d", 0.9),
        ("b", 0.8),
        ("c", 0.7),
        ("here", 0.6),
        ("e", 0.5),
    ]
    written = report(dataclasses.replace(found, places=tuple(places)), "these data", [])
    assert "Noise looks least like the one here." in written
    assert "| here | 60 % |" in written and "| e | 50 % |" in written and "| f |" not in written


def test_nothing_to_look_for_is_refused(file):
    with pytest.raises(InputError, match="causes: there are none"):
        dma_diagnosis.diagnose_dma(read_dma(file), causes=())


def test_the_library_is_the_default(file):
    found = inverse.diagnose(file, gain=False).details
    known = [one.cause.name for one in found.causes] + [one.name for one in found.not_testable]
    assert sorted(known) == sorted(cause.name for cause in DMA_CAUSES) and len(known) >= 14


def test_a_report_prints_no_nan_and_no_bound_as_a_value(file):
    found = inverse.diagnose(file, causes=["slip", "drying"], gain=False).details
    gate = dataclasses.replace(found.noise, repeats=0.0, repeats_freedom=7, p_repeats=np.nan, p_sizes=0.001)
    assert not gate.weighed
    text = report(dataclasses.replace(found, noise=gate), "these", [])
    assert "they are the same readings written again" in text and "nan" not in text.split("## All causes")[0]
    spare = report(dataclasses.replace(found, noise=dataclasses.replace(gate, repeats=found.noise.size)), "these", [])
    assert "nothing is left that they could be compared with" in spare and "written again" not in spare
    assert "each counts below 0.01" in text and "would weigh each by its own size" in text
    ((name, tested), *_) = found.decision.tests.items()
    cause = next(one for one in found.causes if one.cause.name == name)
    for left, shown in ((tested.least_p, f"| ≤ {tested.least_p:.2g} |"), (0.5, "| 0.5 |")):
        row = dataclasses.replace(found, causes=(dataclasses.replace(cause, left=left),))
        assert shown in next(line for line in report(row, "these", []).splitlines() if line.startswith(f"| {name}"))
