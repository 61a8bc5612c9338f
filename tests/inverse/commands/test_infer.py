"""`arfjax infer`: what it writes, that it goes on where it was stopped, and what it says of a mistake."""

import csv
import json

import numpy as np
import pytest

from inverse.commands.main import run
from inverse.datasets.shipped import shipped
from inverse.sampling import load_posterior

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
        (["--out", "{out}", "--dma", POLYMER], "holds 21 sweeps; choose one by --temperature"),
        (["--out", "{out}", "--dma", POLYMER, "--sampler", "guess"], "Invalid value for '--sampler'"),
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
