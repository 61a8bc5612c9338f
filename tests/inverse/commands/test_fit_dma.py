"""The fit-dma command as a function: files, their content, and nothing on failure."""

import csv
import json

import numpy as np
import pytest
import xarray as xr

from arfjax import InputError
from arfjax.mechanics.material.complex_modulus import complex_modulus
from arfjax.media import FractionalZener
from inverse.commands.fit_dma import ModelChoice, ResidualChoice, fit_dma
from inverse.datasets.dma import group_sweeps, read_dma
from inverse.datasets.shipped import shipped
from inverse.dma_fit import fit_sweeps, magnitude_only
from inverse.dma_residuals import LogModulus
from inverse.figures import dma_figure

TRUTHS = {21.0: FractionalZener(855.2, 3.0e3, 1.23e-2, 0.4), 50.0: FractionalZener(1.0e3, 2.0e4, 8.0e-3, 0.35)}


@pytest.fixture
def measured(tmp_path):
    frequency = np.geomspace(0.1, 100.0, 12)
    path = tmp_path / "sweeps.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frequency_hz", "temperature_c", "storage_modulus_pa", "loss_modulus_pa"])
        for temperature, solid in TRUTHS.items():
            for f, modulus in zip(frequency, np.asarray(complex_modulus(solid, 2 * np.pi * frequency)), strict=True):
                writer.writerow([repr(float(v)) for v in (f, temperature, modulus.real, modulus.imag)])
        writer.writerow([1.0, 80.0, 5000.0, 500.0])
    return path


def test_what_is_written_twice_is_fitted_once(measured, tmp_path, capsys):
    header, *rows = measured.read_text().splitlines()
    twice = tmp_path / "twice.csv"
    twice.write_text("\n".join([header, *rows, *rows, ""]))
    for file in (measured, twice):
        fit_dma(file, tmp_path / file.stem, model=ModelChoice.ZENER, residuals=ResidualChoice.LOG, starts=2)
    one, other = ((tmp_path / name / "parameters.csv").read_text() for name in ("sweeps", "twice"))
    assert one == other
    said = "25 rows repeat others in every column that is used and are left out"
    assert said in (tmp_path / "twice" / "report.md").read_text() and said in " ".join(capsys.readouterr().out.split())


def test_where_nothing_can_be_fitted_nothing_is_written(tmp_path):
    few = tmp_path / "few.csv"
    few.write_text("frequency_hz,temperature_c,storage_modulus_pa,loss_modulus_pa\n1,20,5000,500\n2,20,5100,500\n")
    with pytest.raises(InputError, match=r"few.csv: nothing can be fitted. 20.0 degC: "):
        fit_dma(few, tmp_path / "out")
    close = tmp_path / "close.csv"
    rows = [f"{f},{t},5000,500" for t in range(20, 28) for f in (1, 2, 4)]
    close.write_text("\n".join(["frequency_hz,temperature_c,storage_modulus_pa,loss_modulus_pa", *rows, ""]))
    with pytest.raises(InputError, match=r"close.csv: sweeps from 20 to 27 degC cannot be told apart"):
        fit_dma(close, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_everything_is_written(measured, tmp_path, capsys):
    out = tmp_path / "out"
    fit_dma(measured, out, residuals=ResidualChoice.BOTH, starts=6, seed=2)
    names = {path.name for path in out.iterdir()}
    figures = {f"fit_{kind}.{ending}" for kind in ("log", "linear") for ending in ("png", "pdf")}
    assert names == figures | {"parameters.csv", "fit.nc", "summary.json", "report.md"}
    rows = list(csv.DictReader((out / "parameters.csv").read_text().splitlines()))
    assert len(rows) == 2 * 2 * (3 + 4)
    taus = [
        row
        for row in rows
        if row["parameter"] == "relaxation_time" and row["model"] == "fractional" and row["unit"] == "s"
    ]
    np.testing.assert_allclose([float(row["estimate"]) for row in taus], [1.23e-2, 8.0e-3] * 2, rtol=1e-6)
    by_fit = {
        (row["residuals"], row["model"], row["temperature_c"]): row
        for row in rows
        if row["parameter"] == "relaxation_time"
    }
    assert {(row["n_points"], row["n_starts"], row["converged"]) for row in rows} == {("12", "6", "true")}
    assert {row["identified"] for row in rows if row["model"] == "fractional"} == {"true"}
    with xr.open_dataset(out / "fit.nc", engine="h5netcdf") as dataset:
        # The conventional solid does not fit: its misfit and its errors are the same in every file.
        at = {"sweep": 1, "residuals": 1}
        storage, loss = (dataset[f"zener_{kind}_modulus"].isel(at).to_numpy()[:12] for kind in ("storage", "loss"))
        fitted = storage + 1j * loss
        actual = (dataset["measured_storage_modulus"] + 1j * dataset["measured_loss_modulus"])[1].to_numpy()[:12]
        stated = by_fit["linear", "zener", "50.000"]
        sums = {
            "sse_log": np.sum(np.abs(np.log(fitted / actual)) ** 2),
            "sse_linear_pa2": np.sum(np.abs(fitted - actual) ** 2),
            "sse_relative": np.sum((np.abs(fitted / actual) - 1.0) ** 2),
        }
        assert {name: float(stated[name]) for name in sums} == pytest.approx(sums, rel=1e-4)
        error = float(dataset["zener_relaxation_time_standard_error"].isel(at))
        assert float(stated["standard_error"]) == pytest.approx(error, rel=1e-3)
        assert float(stated["estimate"]) == pytest.approx(float(dataset["zener_relaxation_time"].isel(at)), rel=1e-6)
        assert int(stated["n_agreeing"]) in range(1, 7) and error < float(stated["estimate"])
        assert dataset["fractional_relaxation_time"].attrs["units"] == "s"
        difference = dataset["fractional_storage_modulus"] - dataset["measured_storage_modulus"]
        assert float(np.abs(difference).max()) < 1e-2 and dataset["temperature"].size == 3
    summary = json.loads((out / "summary.json").read_text())
    assert summary["seed"] == 2 and len(summary["results"]["fits"]) == 8
    assert summary["results"]["not_fitted"][0]["temperature"] == {"value": 80.0, "unit": "degC"}
    assert "80.0 degC" in (out / "report.md").read_text()
    assert "8 fits, 0 did not converge" in capsys.readouterr().out


def test_one_model_one_residual_magnitude(measured, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for ending in ("png", "pdf"):
        (out / f"fit_linear.{ending}").write_text("of an earlier run")
    fit_dma(measured, out, model=ModelChoice.ZENER, residuals=ResidualChoice.LOG, magnitude=True, starts=4)
    assert len(list(csv.DictReader((out / "parameters.csv").read_text().splitlines()))) == 2 * 3
    assert {path.name for path in out.glob("fit_*")} == {"fit_log.png", "fit_log.pdf"}


def test_a_single_reading_has_no_scatter(measured, tmp_path):
    fit_dma(measured, tmp_path / "out", model=ModelChoice.ZENER, residuals=ResidualChoice.LOG, starts=2)
    report = (tmp_path / "out" / "report.md").read_text()
    assert "80.0 degC (zener): its only row is at 1 Hz: one frequency cannot fix" in report and "nan" not in report
    assert "its modulus is given instead. One reading: storage 5000 Pa; loss 500 Pa; magnitude 5025 Pa\n" in report


def test_deviations_of_both_moduli_count_in_a_fit_of_the_magnitude(measured, tmp_path):
    """Ten times larger at high frequencies, they let the fit keep to the low ones, and say how it errs."""
    header, *rows = measured.read_text().splitlines()[:13]
    sized = [f"{row},{size},{size}" for row, size in zip(rows, [5.0] * 6 + [500.0] * 6, strict=True)]
    stated = tmp_path / "stated.csv"
    stated.write_text("\n".join([f"{header},storage_modulus_sd_pa,loss_modulus_sd_pa", *sized, ""]))
    found = {}
    for file in (measured, stated):
        out = tmp_path / file.stem
        fit_dma(file, out, model=ModelChoice.ZENER, residuals=ResidualChoice.LINEAR, magnitude=True, starts=2)
        rows = csv.DictReader((out / "parameters.csv").read_text().splitlines())
        found[file.stem] = [float(row["estimate"]) for row in rows if row["temperature_c"] == "21.000"]
    assert abs(found["stated"][0] / found["sweeps"][0] - 1.0) > 0.01
    assert "not used" not in (tmp_path / "stated" / "report.md").read_text()


def test_single_frequency_is_reported(tmp_path):
    fit_dma(shipped("nist_foam"), tmp_path / "out")
    report = (tmp_path / "out" / "report.md").read_text()
    assert "one frequency cannot fix" in report and "Mean: storage" in report
    assert not list((tmp_path / "out").glob("*.png"))


def test_figure_shows_measurements_and_both_models():
    sweeps = group_sweeps(read_dma(shipped("pyvisco_polymer")))[::7]
    fit = fit_sweeps(magnitude_only(sweeps), residuals=(LogModulus(),), n_starts=4)
    figure = dma_figure(fit, LogModulus())
    upper, lower = figure.axes
    assert upper.get_ylabel() == "Modulus magnitude $|M|$ [GPa]" and lower.get_xlabel() == "Frequency [Hz]"
    assert lower.get_ylabel().startswith("measured − fit")
    measured = [line for line in upper.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(measured[0].get_ydata(), sweeps[0].data.modulus_magnitude / 1e9)
    assert len(upper.lines) == len(sweeps) * 3
    solid = [line for line in lower.lines if line.get_linestyle() == "-" and len(line.get_xdata()) > 2]
    expected = 1.0 - np.abs(fit.fits[-1].modulus(sweeps[-1].data.frequency_hz)) / sweeps[-1].data.modulus_magnitude
    np.testing.assert_allclose(solid[-1].get_ydata(), 100.0 * expected)


@pytest.mark.parametrize("loss", ["0", "300"])
def test_a_solid_without_loss_or_of_constant_loss_is_drawn(tmp_path, loss):
    rows = [f"{frequency},37,{1500 + 10 * frequency},{loss}" for frequency in (1, 2, 5, 10, 20, 50)]
    header = "frequency_hz,temperature_c,storage_modulus_pa,loss_modulus_pa"
    path = tmp_path / "sweep.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    fit_dma(path, tmp_path / "out", residuals=ResidualChoice.LINEAR, starts=4)
    assert (tmp_path / "out" / "fit_linear.png").exists()
