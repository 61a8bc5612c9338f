"""`arfjax infer`: what it writes, that it goes on where it was stopped, and what it says of a mistake."""

import csv
import dataclasses
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from arfjax import InputError
from inverse.commands import infer as command
from inverse.commands.infer import Across
from inverse.commands.infer import _sweeps as infer_command_sweeps
from inverse.commands.infer_report import parameter_rows, report, results, write_parameters
from inverse.commands.main import run
from inverse.datasets.dma import group_sweeps, read_dma
from inverse.datasets.shipped import shipped
from inverse.fast_hmi import Verification
from inverse.inference.dma import dma_problem
from inverse.inference.experiment import _SCALED
from inverse.inference.profile import Stop
from inverse.sampling import Draws, Evidence, Laplace, diagnose_draws, load_posterior
from inverse.study import Effort, Sampler, infer
from tests.inverse.sampling.conjugate import conjugate_problem, exact_posterior
from tests.inverse.sampling.test_evidence import exact_draws

POLYMER = str(shipped("pyvisco_polymer"))
HMI = str(shipped("suomi2016_hmi"))
EXPERIMENT = str(shipped("suomi2016_experiment"))


def complaint(arguments: list[str], capsys) -> str:
    assert run(["infer", *arguments]) == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--out", "{out}"], "nothing to infer from: give --dma FILE, --hmi FILE or both"),
        (["--out", "{out}", "--hmi", HMI], "HMI needs an experiment file"),
        ([EXPERIMENT, "--out", "{out}", "--dma", POLYMER, "--across", "sample"], "goes with sweeps alone"),
        ([EXPERIMENT, "--out", "{out}", "--dma", POLYMER, "--across", "sonication"], "needs the sonications of an HMI"),
        ([EXPERIMENT, "--out", "{out}", "--hmi", HMI, "--varying", "noise"], "give --across sonication, too"),
        (
            [EXPERIMENT, "--out", "{out}", "--hmi", HMI, "--across", "sonication", "--varying", "noise"],
            "`noise` is not one constant of the model",
        ),
        (["--out", "{out}", "--dma", POLYMER, "--sampler", "laplace", "--evidence"], "--evidence needs draws"),
        (
            ["--out", "{out}", "--dma", POLYMER, "--sampler", "emcee", "--target-acceptance", "0.9"],
            "--target-acceptance is of nuts: leave it out, or take --sampler nuts",
        ),
        (
            [EXPERIMENT, "--out", "{out}", "--hmi", HMI, "--target-acceptance", "0.9"],
            "--target-acceptance is of nuts: leave it out, or take --sampler nuts",
        ),
        (["--out", "{out}", "--dma", POLYMER], "holds 21 sweeps; choose one by --temperature"),
        (["--out", "{out}", "--dma", POLYMER, "--sampler", "guess"], "Invalid value for '--sampler'"),
        (["--out", "{out}", "--dma", POLYMER, "--temperature", "313"], "are at -49.9 to 100.0 degC; give one of their"),
        (["--out", "{out}", "--dma", POLYMER, "--temperature", "nan"], "are at -49.9 to 100.0 degC"),
        ([EXPERIMENT, "--out", "{out}", "--hmi", HMI, "--temperature", "40"], "--temperature are of a DMA"),
        (
            ["--out", "{out}", "--dma", POLYMER, "--across", "temperature", "--temperature", "40"],
            "a population needs two sweeps or more, here is one (40.0 degC)",
        ),
        (["--out", POLYMER, "--dma", POLYMER, "--temperature", "40"], "is a file, not a folder"),
    ],
)
def test_mistakes_are_told_in_one_line(arguments, said, tmp_path, capsys):
    err = complaint([each.format(out=tmp_path / "out") for each in arguments], capsys)
    assert said in err and len(err.strip().splitlines()) == 1
    assert not list(tmp_path.glob("out/*"))


def test_a_wrong_section_is_told(tmp_path, capsys):
    text = shipped("suomi2016_experiment").read_text()
    section = '[[inference.parameters]]\nname = "a"\nplace = "model.liver.stiffness"\nprior = {{ kind = "{kind}" }}\n'
    for kind, said in (("log-normal", "a log-normal prior needs log_sd"), ("triangular", "expected")):
        path = tmp_path / f"{kind}.toml"
        path.write_text(text + section.format(kind=kind))
        err = complaint([str(path), "--dma", POLYMER, "--temperature", "20", "--out", str(tmp_path / "out")], capsys)
        assert str(path) in err and said in err
    path.write_text(text + section.format(kind='normal", mean = 1.0, sd = 1.0, source = "x'))
    err = complaint([str(path), "--dma", POLYMER, "--temperature", "20", "--out", str(tmp_path / "out")], capsys)
    assert "has no `stiffness`" in err and "liver.density.value" in err


def two_samples(folder):
    """Sample a at 20 and 40 degC, b at 20."""
    rows = [f"{f},{t},{sample},{1e4 * f**0.1:g},{2e3 * f**0.1:g}" for sample, t in (("a", 20), ("a", 40), ("b", 20))
            for f in (0.1, 1, 10, 100, 300)]  # fmt: skip
    path = folder / "two.csv"
    path.write_text("\n".join(["frequency_hz,temperature_c,sample,storage_modulus_pa,loss_modulus_pa", *rows, ""]))
    return path


def test_sweeps_of_a_population_are_called_apart(tmp_path):
    """By their samples where each has one sweep, else by sample and temperature."""
    path = two_samples(tmp_path)
    whole = group_sweeps(read_dma(path))
    names = dma_problem(whole, across="sample").parameters.names
    assert {f"relaxed_modulus[{each}]" for each in ("a, 20.0 degC", "a, 40.0 degC", "b, 20.0 degC")} <= set(names)
    at_one = infer_command_sweeps(path, 21.0, Across.SAMPLE, False, alone=True)
    assert [sweep.label for sweep in at_one] == ["a, 20.0 degC", "b, 20.0 degC"]
    names = dma_problem(at_one, across="sample").parameters.names
    assert {"relaxed_modulus[a]", "relaxed_modulus[b]"} <= set(names)


def test_sweeps_of_a_population_of_samples_are_of_about_one_temperature(tmp_path):
    """Else what a temperature does would be taken for a difference of samples."""
    rows = [f"{f},{t},{1e4 + f},{1e3 + f},{s}" for s, t in (("A", 20), ("A", 60), ("B", 20)) for f in (1, 2, 5, 10)]
    path = tmp_path / "two.csv"
    path.write_text("\n".join(["frequency_hz,temperature_c,storage_modulus_pa,loss_modulus_pa,sample", *rows]))
    with pytest.raises(InputError, match="the nearest sweep of sample B .* is at 20.0 degC"):
        infer_command_sweeps(path, 60.0, Across.SAMPLE, False, alone=True)
    assert len(infer_command_sweeps(path, 20.0, Across.SAMPLE, False, alone=True)) == 2


def test_sweeps_of_a_population_differ_by_what_is_named(tmp_path):
    path = two_samples(tmp_path)
    with pytest.raises(InputError, match=r"at a, 20.0 degC and a, 40.0 degC do not differ by sample; choose one sweep"):
        infer_command_sweeps(path, None, Across.SAMPLE, False, alone=True)
    with pytest.raises(InputError, match=r"a, 20.0 degC and b, 20.0 degC do not differ by temperature; take --across"):
        infer_command_sweeps(path, None, Across.TEMPERATURE, False, alone=True)
    with pytest.raises(InputError, match="are of one sample; name samples in a column 'sample', or take --across temp"):
        infer_command_sweeps(Path(POLYMER), None, Across.SAMPLE, False, alone=True)
    assert len(infer_command_sweeps(Path(POLYMER), None, Across.TEMPERATURE, False, alone=True)) == 21


def test_units_that_look_wrong_can_be_believed(tmp_path, capsys):
    path = tmp_path / "soft.csv"
    rows = [f"{f},20,{2.0 * f**0.1:g},{0.4 * f**0.1:g}" for f in (0.1, 1, 10, 100, 300)]
    path.write_text("\n".join(["frequency_hz,temperature_c,storage_modulus_pa,loss_modulus_pa", *rows, ""]))
    arguments = ["--dma", str(path), "--sampler", "none", "--no-profiles", "--out", str(tmp_path / "out")]
    assert "--trust-units" in complaint(arguments, capsys)
    assert run(["infer", *arguments, "--trust-units"]) == 0
    settings = json.loads((tmp_path / "out" / "summary.json").read_text())["settings"]
    assert settings["trust_units"] and settings["sweeps"] == ["20.0 degC"] and settings["profiles"] is False
    assert "Sweeps: 20.0 degC." in (tmp_path / "out" / "report.md").read_text()


def test_inputs_are_those_that_were_read(tmp_path, monkeypatch):
    """A file that is changed or moved while it runs costs no results, and is not what they are of."""
    path = two_samples(tmp_path)
    read = path.read_bytes().replace(b"sample,", b"sample,note,", 1).replace(b",a,", b",a,x,").replace(b",b,", b",b,x,")
    path.write_bytes(read)
    study = command.infer

    def slow(*given, **named):
        path.unlink()
        return study(*given, **named)

    monkeypatch.setattr(command, "infer", slow)
    arguments = ["--temperature", "40", "--sampler", "none", "--no-profiles", "--starts", "2"]
    assert run(["infer", "--dma", str(path), *arguments, "--out", str(tmp_path / "out")]) == 0
    inputs = json.loads((tmp_path / "out" / "summary.json").read_text())["inputs"]
    assert inputs == {"dma": {"path": str(path), "sha256": hashlib.sha256(read).hexdigest()}}
    assert "\nColumns not used: note.\n" in (tmp_path / "out" / "report.md").read_text()


@pytest.mark.parametrize(("drawn", "said"), [(True, "draws so far are kept in"), (False, "nothing was written")])
def test_what_is_said_when_it_is_stopped(drawn, said, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"

    def stopped(*_, file, **__):
        if drawn:
            out.mkdir()
            file.write_text("draws")
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "infer", stopped)
    assert run(["infer", "--dma", POLYMER, "--temperature", "60", "--out", str(out)]) == 130
    assert said in capsys.readouterr().err
    assert [each.name for each in tmp_path.glob("**/*")] == (["out", "run.h5"] if drawn else [])


@pytest.mark.parametrize("unit", ["1", "Pa", "s", "1/K", "Np/m", "m/s", "kg/m^3", "W/(m K)", "J/(kg K)", "Pa s"])
def test_si_units_are_no_multiples(unit):
    assert _SCALED.search(unit) is None


def test_what_is_asked_for_reaches_the_study(tmp_path, monkeypatch):
    """With HMI no more than four starts, beyond which none are advised."""
    asked = []

    def stopped(*_, effort, **__):
        asked.append(effort)
        raise InputError("enough")

    monkeypatch.setattr(command, "infer", stopped)
    monkeypatch.setattr(command, "_problem", lambda *_: (None, {}, None))
    dma = ["infer", "--dma", POLYMER, "--temperature", "60", "--out", str(tmp_path / "out")]
    hmi = ["infer", EXPERIMENT, "--hmi", HMI, "--out", str(tmp_path / "out")]
    for arguments in (dma, [*dma, "--target-acceptance", "0.95"], hmi):
        assert run(arguments) == 2
    assert [each.target_acceptance for each in asked] == [0.8, 0.95, 0.8]
    assert [(each.starts, each.most_starts) for each in asked] == [(16, None), (16, None), (4, 4)]


def test_what_a_prior_does_not_take_and_attenuation_without_anchors(tmp_path, capsys):
    text = shipped("suomi2016_experiment").read_text()
    path, tail = tmp_path / "mine.toml", ["--dma", POLYMER, "--temperature", "20", "--out", str(tmp_path / "out")]
    section = '[[inference.parameters]]\nname = "a"\nplace = "model.liver.density.value"\n'
    path.write_text(text + section + 'prior = { kind = "log-normal", log_sd = 0.5, mean = 3000.0 }\n')
    assert "a log-normal prior has no mean; it takes log_sd and median" in complaint([str(path), *tail], capsys)
    stiffness = section.replace("liver.density.value", "lesion.viscoelasticity.branch_modulus.value")
    path.write_text(text + stiffness + 'unit = "kPa"\nprior = { kind = "log-normal", log_sd = 0.5 }\n')
    assert "a: the unit kPa is a multiple (kPa), and the model's" in complaint([str(path), *tail], capsys)
    for prior in ('kind = "log-normal", log_sd = 0.5, median = 50.0', 'kind = "uniform", lower = 10.0, upper = 90.0'):
        path.write_text(f'{text}{stiffness}unit = "Pa"\nprior = {{ {prior} }}\n')
        assert "and the model holds 5.26e+04 Pa at" in complaint([str(path), *tail], capsys)
    liver = '[[layers]]\ntissue = "liver"\n'
    assert liver in text
    path.write_text(text.replace(liver, f"{liver}coagulation_doubles_attenuation = true\n"))
    said = "set `coagulation_doubles_attenuation = false` under liver"
    assert said in complaint([str(path), *tail], capsys)
    assert run(["calibrate", str(path), "--hmi", HMI, "--out", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err


def test_the_level_of_profiles_stands_above_them():
    effort = Effort(starts=2, level=0.9)
    study = infer(conjugate_problem(), sampler=Sampler.NONE, effort=effort)
    header, rows = parameter_rows(study)
    assert header[4] == "profile, 90 %" and " to " in rows[0][4]
    header, rows = parameter_rows(dataclasses.replace(study, profiles=()))
    assert header[4] == "profile" and not rows[0][4]


@pytest.fixture(scope="module")
def studied():
    """A linear model with all that a study can hold, whose numbers are known."""
    problem = conjugate_problem()
    study = infer(problem, sampler=Sampler.NONE, effort=Effort(starts=2))
    draws = exact_draws(problem)
    weighed = Evidence(-12.5, 0.03, 0.9, True, ("it is doubtful.",))
    return dataclasses.replace(study, draws=draws, diagnostics=diagnose_draws(problem, draws), evidence=weighed)


def test_numbers_of_a_study_stand_in_their_columns(studied, tmp_path):
    """Fit, profile and posterior of a normal posterior are the same three times over."""
    mean, covariance, _ = exact_posterior(studied.problem)
    write_parameters(tmp_path / "parameters.csv", studied)
    with (tmp_path / "parameters.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["parameter"] for row in rows] == [f"coefficient_{k}" for k in range(3)]
    for row, centre, sd in zip(rows, mean, np.sqrt(np.diag(covariance)), strict=True):
        shown = {name: float(row[name]) for name in row if name.startswith(("profile_l", "profile_u", "posterior"))}
        assert float(row["estimate"]) == pytest.approx(centre, abs=1e-4 * sd)
        assert float(row["standard_error"]) == pytest.approx(sd, rel=1e-4)
        assert shown["profile_lower"] == pytest.approx(centre - 1.96 * sd, abs=0.01 * sd)
        assert shown["profile_upper"] == pytest.approx(centre + 1.96 * sd, abs=0.01 * sd)
        assert row["profile_level"] == "0.95" and row["profile_ends"] == "reached the level; reached the level"
        assert shown["posterior_mean"] == pytest.approx(centre, abs=0.1 * sd)
        assert shown["posterior_median"] == pytest.approx(centre, abs=0.1 * sd)
        assert shown["posterior_sd"] == pytest.approx(sd, rel=0.1)
        assert shown["posterior_5_percent"] == pytest.approx(centre - 1.645 * sd, abs=0.15 * sd)
        assert shown["posterior_95_percent"] == pytest.approx(centre + 1.645 * sd, abs=0.15 * sd)
        assert 0.99 < float(row["r_hat"]) < 1.01 and min(float(row["bulk_ess"]), float(row["tail_ess"])) > 3000.0
        assert row["unit"] == "m" and row["prior"].startswith("normal, ") and row["profile_converged"] == "True"


def test_what_a_summary_and_a_report_hold_of_a_study(studied):
    """Verified curves that differ by 0.4 percent are as they should be; by 0.6, they are not."""
    near, far = (Verification(np.array([[1.0, 1.0 + e]]), np.ones((1, 2)), np.ones(1, bool)) for e in (4e-3, 6e-3))
    found = results(studied, near, "a remark")
    assert found["log_evidence"] == {"value": -12.5, "unit": "nats", "standard_error": 0.03, "converged": True}
    assert found["posterior"]["draws"] == 4000 and found["posterior"]["stopping_rule_met"] is True
    assert found["fast_model"] == {"models": 1, "largest_error": pytest.approx(4e-3)}
    assert found["warnings"] == ["Evidence: it is doubtful.", "a remark"]
    values, errors = studied.estimates
    np.testing.assert_allclose([each["value"] for each in found["parameters"].values()], values)
    np.testing.assert_allclose([each["standard_error"] for each in found["parameters"].values()], errors)
    texts = [report(studied, [Path("a/sweep.csv")], ["20.0 degC"], [], each, "a remark") for each in (near, far)]
    for text in texts:
        assert "# Inference from sweep.csv" in text and "Sweeps: 20.0 degC." in text and "- a remark" in text
        assert "- log evidence -12.500 ± 0.03 nats" in text and "- it is doubtful." in text
        assert "Nothing was found wrong with it." in text and "| coefficient_2 | normal, 0.6 ± 1.5 m | " in text
    without = report(dataclasses.replace(studied, draws=None), [Path("sweep.csv")], [], [], None, "a remark")
    assert "\na remark\n" in without and "## Posterior" not in without
    assert "differ by 0.4 % of their largest value at most." in texts[0]
    assert "differ by 0.6 % of their largest value at most, more than the 0.5 % that it is meant to keep" in texts[1]


@pytest.mark.parametrize(
    ("stops", "said"),
    [
        ((Stop.CROSSED, Stop.CROSSED), "1 to 2"),
        ((Stop.CROSSED, Stop.FLAT), "> 1"),
        ((Stop.BOUND, Stop.CROSSED), "< 2"),
        ((Stop.FLAT, Stop.FLAT), "open"),
    ],
)
def test_an_interval_has_no_end_where_the_data_set_no_limit(studied, stops, said):
    one = dataclasses.replace(studied.profiles[0], interval=(1.0, 2.0), stops=stops, unfinished=(0, 1))
    _, rows = parameter_rows(dataclasses.replace(studied, profiles=(one,)))
    assert rows[0][4] == f"{said} ?" and rows[1][4] == ""
    _, (sound, *_) = parameter_rows(
        dataclasses.replace(studied, profiles=(dataclasses.replace(one, unfinished=(0, 0)),))
    )
    assert sound[4] == said


@pytest.mark.slow
def test_constants_of_a_sweep_with_their_posterior(tmp_path, capsys):
    """Fit, profile and posterior beside each other in every format, and the same draws when asked again."""
    out = tmp_path / "out"
    arguments = ["infer", "--dma", POLYMER, "--temperature", "60", "--draws", "300", "--out", str(out), "--evidence"]
    assert run(arguments) == 0
    with (out / "parameters.csv").open() as file:
        rows = {row["parameter"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["relaxed_modulus", "branch_modulus", "relaxation_time", "fractional_order", "noise"]
    for row in rows.values():
        low, high = float(row["posterior_5_percent"]), float(row["posterior_95_percent"])
        assert low < float(row["posterior_median"]) < high and row["prior"]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["results"]["fit"]["converged"] and np.isfinite(summary["results"]["log_evidence"]["value"])
    first = load_posterior(out / "posterior.nc")["posterior"]["fractional_order"].to_numpy()
    for name in ("corner", "overlap", "traces", "predictions_dma"):
        assert (out / f"{name}.png").stat().st_size > 10_000
    capsys.readouterr()
    assert run(arguments) == 0
    again = load_posterior(out / "posterior.nc")["posterior"]["fractional_order"].to_numpy()
    np.testing.assert_array_equal(again, first)
    assert run([*arguments, "--seed", "1"]) == 2
    assert "seed" in capsys.readouterr().err


def test_every_column_of_a_population_is_in_the_figure_of_pairs(studied, tmp_path, monkeypatch):
    """Middle, spread and one of each sweep: none of them has the name of the constant."""
    sweeps = [sweep for sweep in group_sweeps(read_dma(POLYMER)) if sweep.temperature_c > 90.0]
    problem = dma_problem(sweeps[:2], fractional=False, across="temperature", estimate_noise=False)
    count = len(problem.parameters.columns)
    assert len(problem.parameters.entries) == 3 < count <= 12
    u = np.asarray(problem.start) + 0.01 * np.random.default_rng(0).normal(size=(2, 60, problem.parameters.size))
    draws = Draws(u, np.zeros((2, 60)), {}, "test 1.0", 7, {}, True, "as asked", 120, 1.5)
    drawn = {}
    monkeypatch.setattr(command, "write_figures", lambda folder, figures: drawn.update(figures) or list(figures))
    command._write_posterior(tmp_path, dataclasses.replace(studied, problem=problem, draws=draws), {}, 7)
    labels = [axis.get_xlabel() for axis in drawn["corner"].axes if axis.get_xlabel()]
    assert len(labels) == count


@pytest.mark.parametrize("converged", [True, False])
def test_the_report_says_that_a_normal_approximation_is_unsound(studied, converged):
    """As the terminal and the summary do."""
    found = Laplace(
        np.zeros(3), np.eye(3), -1.0, ("a", "b", "c"), 0.1, converged, True, np.zeros(8), "not a mode yet"
    )  # fmt: skip
    study = dataclasses.replace(studied, laplace=found)
    said = report(study, [], [], [], None, "")
    assert ("- Normal approximation: not a mode yet." in said) is not converged
