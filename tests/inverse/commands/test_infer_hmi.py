"""`arfjax infer` with HMI, in the smallest setting: what it writes for one curve, for populations, by each sampler."""

import csv
import dataclasses
import functools
import json
import re

import numpy as np
import pytest

from arfjax import discretise, read_experiment
from benchmarks.calibration_cases import SMALL
from inverse.commands import infer
from inverse.commands.main import run
from inverse.datasets.shipped import shipped
from inverse.hmi_problem import hmi_problem
from inverse.sampling import load_posterior

HMI = """sonication,temperature_c,displacement_percent,displacement_percent_sd
a,37,100,3
a,50,97,3
a,60,101,3
a,70,84,3
b,37,100,3
b,50,99,3
b,60,97,3
b,70,93,3
"""
FREE = """
[[inference.parameters]]
name = "attenuation"
place = "model.liver.attenuation.values[3]"
unit = "Np/m"
prior = { kind = "log-normal", log_sd = 0.35 }

[[inference.parameters]]
name = "lesion_stiffness"
place = "model.lesion.viscoelasticity.branch_modulus.value"
unit = "Pa"
prior = { kind = "log-normal", log_sd = 0.5 }
"""

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.fixture
def small(monkeypatch):
    """The command as it is, with a fast model that takes seconds to prepare."""
    model = read_experiment(shipped("suomi2016_experiment")).model()
    coarse = dataclasses.replace(
        discretise(model, refinement=0.5), n_heat_steps=SMALL.n_heat_steps, n_push_steps=SMALL.n_push_steps
    )
    quick = functools.partial(hmi_problem, focus=False, effort=SMALL, discretisation=coarse, heat_settings=coarse)
    monkeypatch.setattr(infer, "hmi_problem", quick)


@pytest.fixture
def files(tmp_path):
    experiment, hmi = tmp_path / "experiment.toml", tmp_path / "hmi.csv"
    experiment.write_text(shipped("suomi2016_experiment").read_text() + FREE)
    hmi.write_text(HMI)
    return [str(experiment), "--hmi", str(hmi), "--out", str(tmp_path / "out"), "--starts", "2"]


def table(out):
    with (out / "parameters.csv").open() as file:
        return {row["parameter"]: row for row in csv.DictReader(file)}


def test_importance_sampling_of_curves(small, files, tmp_path, capsys):
    assert run(["infer", *files, "--draws", "200"]) == 0
    out, shown = tmp_path / "out", capsys.readouterr().out
    rows, summary = table(out), json.loads((out / "summary.json").read_text())
    assert list(rows) == ["attenuation", "lesion_stiffness"]
    for row in rows.values():
        low, high = float(row["posterior_5_percent"]), float(row["posterior_95_percent"])
        assert low < float(row["posterior_median"]) < high and row["r_hat"] == ""
        assert float(row["profile_lower"]) < float(row["estimate"]) < float(row["profile_upper"])
        assert row["profile_ends"] and row["profile_converged"] in ("True", "False")
    found = summary["results"]
    assert found["posterior"]["sampler"] == "importance sampling" and found["posterior"]["draws"] == 800
    assert found["fast_model"]["models"] == 6 and found["fast_model"]["largest_error"] < 0.05
    record = load_posterior(out / "posterior.nc")
    # Rows at the reference are no data.
    assert record["observed_data"]["hmi"].sizes["hmi_datum"] == 6
    left = record["prior_predictive"].attrs
    assert left["draws_asked"] - left["draws_left_out"] == record["prior_predictive"].sizes["draw"]
    report = (out / "report.md").read_text()
    assert ("lie where the model predicts nothing" in report) == bool(left["draws_left_out"])
    assert not re.search(r"\bnan\b", report + shown)
    for name in ("corner", "overlap", "traces", "predictions_hmi"):
        assert (out / f"{name}.png").stat().st_size > 10_000


def test_a_population_of_sonications_by_emcee(small, files, tmp_path, capsys):
    """The lesion's stiffness differs: middle, spread and one a sonication, with the sonications as coordinates."""
    arguments = ["infer", *files, "--across", "sonication", "--sampler", "emcee", "--steps", "150"]
    assert run(arguments) == 0
    rows = table(tmp_path / "out")
    assert list(rows) == [
        "attenuation",
        "lesion_stiffness_population",
        "lesion_stiffness_spread",
        "lesion_stiffness[a]",
        "lesion_stiffness[b]",
    ]
    # The second lesion hardly moved: it is the softer one.
    softer, stiffer = (float(rows[f"lesion_stiffness[{label}]"]["posterior_median"]) for label in ("b", "a"))
    assert softer < stiffer
    posterior = load_posterior(tmp_path / "out" / "posterior.nc")["posterior"]
    assert posterior["lesion_stiffness"].dims == ("chain", "draw", "sonication")
    assert list(posterior["sonication"].to_numpy()) == ["a", "b"]
    first = posterior["lesion_stiffness_spread"].to_numpy()
    capsys.readouterr()
    # The run is in its file, and the same command gives the same draws without sampling again.
    assert run(arguments) == 0
    again = load_posterior(tmp_path / "out" / "posterior.nc")["posterior"]["lesion_stiffness_spread"].to_numpy()
    np.testing.assert_array_equal(again, first)


def test_a_population_named_in_the_file_or_on_the_command_line(small, files, tmp_path):
    experiment = tmp_path / "experiment.toml"
    named = experiment.read_text().replace("[inference]\n", '[inference]\nacross_sonications = ["attenuation"]\n', 1)
    experiment.write_text(named)
    quick = [*files, "--sampler", "none", "--no-profiles"]
    assert run(["infer", *quick]) == 0
    assert "attenuation[a]" in table(tmp_path / "out") and "lesion_stiffness" in table(tmp_path / "out")
    both = ["--across", "sonication", "--varying", "attenuation", "--varying", "lesion_stiffness"]
    assert run(["infer", *quick, *both]) == 0
    assert {"attenuation[b]", "lesion_stiffness[b]"} <= set(table(tmp_path / "out"))
