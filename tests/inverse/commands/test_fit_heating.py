"""The fit-heating command: files, their content, and what it says about itself."""

import csv
import json

import numpy as np
import pytest
import xarray as xr

from inverse.commands.main import run
from inverse.datasets.shipped import shipped
from inverse.thermometry_model import CONSTANTS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("heating") / "out"
    assert run(["fit-heating", str(shipped("mr_hifu_60s")), "--out", str(folder), "--seed", "2", "--starts", "3"]) == 0
    return folder


def test_files(out):
    names = {path.name for path in out.iterdir()}
    assert names == {"parameters.csv", "fit.nc", "heating.png", "heating.pdf", "summary.json", "report.md"}
    assert (out / "heating.png").read_bytes().startswith(b"\x89PNG") and (out / "heating.pdf").stat().st_size > 5000


def test_numbers_are_the_same_everywhere(out):
    rows = list(csv.DictReader((out / "parameters.csv").read_text().splitlines()))
    assert [(row["constant"], row["unit"]) for row in rows] == [(name, unit) for name, unit, _ in CONSTANTS]
    summary = json.loads((out / "summary.json").read_text())
    results = summary["results"]
    assert summary["command"] == "fit-heating" and summary["seed"] == 2
    assert summary["settings"] == {"baseline": None, "starts": 3, "trust_units": False}
    assert len(summary["inputs"]["data"]["sha256"]) == 64
    for row in rows:
        stated = results["constants"][row["constant"]]
        assert float(row["estimate"]) == pytest.approx(stated["value"], rel=1e-6) and stated["unit"] == row["unit"]
        assert float(row["standard_error"]) == pytest.approx(stated["standard_error"], rel=1e-2)
    assert abs(results["constants"]["duration"]["value"] - 60.0) < 1.0
    assert results["rms"] == {"value": pytest.approx(0.0506, abs=1e-3), "unit": "K"}
    assert results["n_rows"] == 51 and results["n_fitted"] == 48 and results["converged"]
    assert results["diffusion_time_ratio_95_percent"]["lower"] is None


def test_dataset(out):
    with xr.open_dataset(out / "fit.nc", engine="h5netcdf") as dataset:
        assert dataset["time"].attrs["units"] == "s" and dataset["fitted_temperature"].attrs["units"] == "degC"
        left = (dataset["measured_temperature"] - dataset["fitted_temperature"]).to_numpy()
        np.testing.assert_allclose(left, dataset["residual"], atol=1e-12)
        fitted = dataset["fitted_row"].to_numpy().astype(bool)
        assert fitted.sum() == 48 and np.sqrt(np.mean(left[fitted] ** 2)) < 0.06
        assert dataset.sizes == {"time": 51, "constant": 5, "other_constant": 5}


def test_report_says_what_the_numbers_cannot_tell(out):
    report = (out / "report.md").read_text(encoding="utf-8")
    for phrase in (
        "48 rows fitted, 3 left out as occluded; rises are counted from 37 degC",
        "neither of them by itself",
        "hard to tell apart",
        "(95 %)",
        "| duration | s | 59.6",
        "![heating.png](heating.png)",
    ):
        assert phrase in report
