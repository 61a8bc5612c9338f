"""simulate, calibrate and reproduce from the command line to the files that a script reads."""

import csv
import json

import numpy as np
import pytest
import xarray as xr

from arfjax.io import COORDINATES, VARIABLES
from inverse.commands.main import run
from inverse.datasets.shipped import shipped

EXPERIMENT = str(shipped("suomi2016_experiment"))
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def summary_of(folder):
    summary = json.loads((folder / "summary.json").read_text())
    assert set(summary) == {"command", "inputs", "settings", "seed", "versions", "results"}
    for given in summary["inputs"].values():
        assert len(given["sha256"]) == 64
    return summary


def test_simulate(tmp_path, capfd):
    assert run(["simulate", EXPERIMENT, "--out", str(tmp_path)]) == 0
    results = summary_of(tmp_path)["results"]
    assert results["displacement_percent"]["value"][0] == pytest.approx(100.0)
    # 50 W: 37.4 times the source pressure in water, less what five layers take.
    assert results["peak_pressure"]["value"] == pytest.approx(6.2e6, rel=0.02)
    with xr.open_dataset(tmp_path / "simulation.nc", engine="h5netcdf") as data:
        for name in (*data.data_vars, *data.coords):
            assert data[name].attrs["units"] == (VARIABLES | COORDINATES)[name][0]
        assert data.attrs["reference_temperature_degc"] == 35.0
        assert data.attrs["acoustic_power_w"] == 50.0
        assert data.attrs["heating_acoustic_power_w"] == pytest.approx(results["heating_acoustic_power"]["value"])
        on_axis = data["pressure_amplitude"].sel(harmonic=1, r=0.0)
        np.testing.assert_array_equal(on_axis, data["pressure_amplitude_on_axis"])
        focal = data["pressure_amplitude"].sel(harmonic=1).sel(z=62.6e-3, method="nearest")
        assert float(focal["z"]) == pytest.approx(62.6e-3, abs=1e-12)
        np.testing.assert_array_equal(focal, data["pressure_amplitude_focal_plane"])
    for name in ("field", "heating", "displacement"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000 and (tmp_path / f"{name}.pdf").exists()
    assert "20.8 W" in (tmp_path / "report.md").read_text()
    assert "displacement" in capfd.readouterr().out


def test_push(tmp_path, capfd):
    """At 65 degC, watched for 5 ms: the wave gets 3 mm out, and the files hold what the summary says."""
    assert run(["push", EXPERIMENT, "--temperature-c", "65", "--watch-ms", "5", "--out", str(tmp_path)]) == 0
    results = summary_of(tmp_path)["results"]
    assert results["shear_wave_speed"]["value"] == pytest.approx(0.8, rel=0.1)
    assert 2e-3 < results["followed_to"]["value"] < 5e-3
    with xr.open_dataset(tmp_path / "push.nc", engine="h5netcdf") as data:
        for name in (*data.data_vars, *data.coords):
            assert data[name].attrs["units"] == (VARIABLES | COORDINATES)[name][0]
        assert data.attrs["temperature_degc"] == 65.0
        assert float(data["focal_displacement"].max()) == pytest.approx(results["largest_displacement"]["value"])
    assert (tmp_path / "push.png").stat().st_size > 10_000 and (tmp_path / "push.pdf").exists()
    assert "shear wave" in capfd.readouterr().out


def test_vibrate(tmp_path, capfd):
    """A sine of the pressure at 65 degC: two harmonics, and files that hold what the summary says."""
    options = ["--temperature-c", "65", "--frequency-hz", "60", "--modulation", "pressure", "--depth", "0.8"]
    assert run(["vibrate", EXPERIMENT, *options, "--out", str(tmp_path)]) == 0
    results = summary_of(tmp_path)["results"]
    assert results["harmonics"]["value"] == [1, 2] and results["left_out_harmonics"]["value"] == 0.0
    assert 0.0 < results["absorbing_layer_relative_error"]["value"] < 2e-3
    with xr.open_dataset(tmp_path / "vibration.nc", engine="h5netcdf") as data:
        for name in (*data.data_vars, *data.coords):
            assert data[name].attrs["units"] == (VARIABLES | COORDINATES)[name][0]
        assert data.attrs["modulation"] == "sine of the pressure, depth 0.8"
        assert float(data["modulation_time"][-1]) == pytest.approx(1.0 / 60.0)
        motion = results["peak_to_peak_displacement"]["value"]
        assert np.ptp(data["focal_vibration"].to_numpy()) == pytest.approx(motion, rel=1e-3)
        focal = data["peak_to_peak_displacement"].sel(r=0.0).sel(z=62.6e-3, method="nearest")
        assert float(focal) == pytest.approx(motion, rel=1e-6)
    assert (tmp_path / "vibration.png").stat().st_size > 10_000 and (tmp_path / "vibration.pdf").exists()
    assert "mean displacement is left out" in (tmp_path / "report.md").read_text()
    assert "peak-to-peak" in capfd.readouterr().out


def test_sonicate(tmp_path, capfd):
    """13 W for 60 s: a lesion, larger and hotter than with the field of the start, and files that others open."""
    assert run(["sonicate", EXPERIMENT, "--out", str(tmp_path / "updated")]) == 0
    results = summary_of(tmp_path / "updated")["results"]
    assert 8 <= results["field_updates"]["value"] <= 20 and results["boiling_time"]["value"] is None
    assert results["highest_thermocouple_temperature"]["value"] < results["highest_focal_temperature"]["value"]
    with xr.open_dataset(tmp_path / "updated" / "sonication.nc", engine="h5netcdf") as data:
        for name in (*data.data_vars, *data.coords):
            assert data[name].attrs["units"] == (VARIABLES | COORDINATES)[name][0]
        assert data.sizes["heating_time"] == 241 and data.attrs["acoustic_power_w"] == 13.0
        grown = data["lesion_volume"].to_numpy()
        assert np.all(np.diff(grown) >= 0.0) and 1e-9 < grown[-1] < 1e-7
    header = (tmp_path / "updated" / "curves.csv").read_text().splitlines()
    assert header[0].startswith("heating_time,") and len(header) == 242
    for name in ("course", "maps", "lesion_on_force"):
        assert (tmp_path / "updated" / f"{name}.png").stat().st_size > 10_000
    frozen = shipped("suomi2016_experiment").read_text().replace('field = "updated"', 'field = "frozen"')
    (tmp_path / "frozen.toml").write_text(frozen.replace('steps = "fixed"', 'steps = "adaptive"'))
    assert run(["sonicate", str(tmp_path / "frozen.toml"), "--out", str(tmp_path / "frozen")]) == 0
    without = summary_of(tmp_path / "frozen")["results"]
    assert without["field_updates"]["value"] == 0.0
    assert without["highest_focal_temperature"]["value"] < results["highest_focal_temperature"]["value"] - 1.0
    assert without["lesion_volume"]["value"] < 0.9 * grown[-1]
    assert "lesion by dose" in capfd.readouterr().out


def test_monitor(tmp_path, capfd):
    """The same heat as `sonicate` has, 26 W at the beam's strongest; displacement falls once the lesion is there."""
    text = shipped("suomi2016_experiment").read_text().replace("{ duration_s = 60.0 }", "{ duration_s = 30.0 }")
    (tmp_path / "e.toml").write_text(text.replace(", { duration_s = 60.0, relative_power = 0.0 }", ""))
    assert run(["monitor", str(tmp_path / "e.toml"), "--out", str(tmp_path / "out")]) == 0
    results = summary_of(tmp_path / "out")["results"]
    with xr.open_dataset(tmp_path / "out" / "monitoring.nc", engine="h5netcdf") as data:
        for name in (*data.data_vars, *data.coords):
            assert data[name].attrs["units"] == (VARIABLES | COORDINATES)[name][0]
        assert data.attrs["acoustic_power_w"] == pytest.approx(26.0)
        assert data.attrs["mean_acoustic_power_w"] == pytest.approx(13.0)
        percent, shown = data["tracked_displacement_percent"].to_numpy(), data["thermocouple_temperature"].to_numpy()
        assert percent[0] == pytest.approx(100.0) and shown[0] == pytest.approx(37.0)
        assert 50.0 < shown.max() < 70.0
        # The attenuation polynomial has its minimum at 44 degC, 4 percent below that at 37.
        assert 95.0 < percent.min() < 99.0
        assert float(data["tracked_displacement"][0]) == pytest.approx(results["start_displacement"]["value"])
    header = (tmp_path / "out" / "curves.csv").read_text().splitlines()
    assert header[0].startswith("heating_time,") and len(header) == 62
    assert (tmp_path / "out" / "monitoring.png").stat().st_size > 10_000
    assert "displacement computed" in capfd.readouterr().out


def test_monitor_refuses_a_reference_that_is_never_shown(tmp_path, capfd):
    text = shipped("suomi2016_experiment").read_text().replace("{ duration_s = 60.0 }", "{ duration_s = 1.0 }")
    text = text.replace(", { duration_s = 60.0, relative_power = 0.0 }", "")
    (tmp_path / "e.toml").write_text(text.replace("normalised_at_c = 37.0", "normalised_at_c = 80.0"))
    assert run(["monitor", str(tmp_path / "e.toml"), "--out", str(tmp_path / "out")]) == 2
    message = capfd.readouterr().err
    assert "`monitoring.normalised_at_c` 80: the thermocouple shows 37.0 to" in message
    assert not (tmp_path / "out").exists()


def test_sonicate_warns_of_boiling(tmp_path, capfd):
    text = shipped("suomi2016_experiment").read_text().replace("acoustic_power_w = 13.0", "acoustic_power_w = 60.0")
    (tmp_path / "hot.toml").write_text(text.replace("{ duration_s = 60.0 }", "{ duration_s = 6.0 }"))
    assert run(["sonicate", str(tmp_path / "hot.toml"), "--out", str(tmp_path / "out")]) == 0
    boiling = summary_of(tmp_path / "out")["results"]["boiling_time"]["value"]
    assert 0.5 <= boiling <= 6.0
    warning = f"tissue reaches 100 degC at {boiling:g} s"
    assert warning in capfd.readouterr().out and warning in (tmp_path / "out" / "report.md").read_text()


def test_sonicate_thin_liver(tmp_path):
    """What is drawn about the focus ends where the liver does."""
    text = shipped("suomi2016_experiment").read_text().replace("thickness_mm = 40.0", "thickness_mm = 25.0")
    (tmp_path / "thin.toml").write_text(text.replace("{ duration_s = 60.0 }", "{ duration_s = 1.0 }"))
    assert run(["sonicate", str(tmp_path / "thin.toml"), "--out", str(tmp_path / "out")]) == 0
    with xr.open_dataset(tmp_path / "out" / "force.nc", engine="h5netcdf") as force:
        assert 67e-3 < float(force["z"].max()) <= 67.6e-3


def test_simulate_warns_of_boiling(tmp_path, capfd):
    text = shipped("suomi2016_experiment").read_text().replace("60.0, 65.0, 70.0]", "60.0, 101.0]")
    (tmp_path / "hot.toml").write_text(text)
    assert run(["simulate", str(tmp_path / "hot.toml"), "--out", str(tmp_path / "out")]) == 0
    assert "tissue reaches 100 degC at" in (tmp_path / "out" / "report.md").read_text()


def test_calibrate(tmp_path):
    out = tmp_path / "out"
    assert run(["calibrate", EXPERIMENT, "--hmi", str(shipped("suomi2016_hmi")), "--out", str(out)]) == 0
    results = summary_of(out)["results"]
    assert results["converged"] and results["noise_estimated"] and results["noise_settled"]
    assert results["rms_misfit_after"]["value"] < 0.6 * results["rms_misfit_before"]["value"]
    # Sonications that differ by 31 points at 84 degC leave that much scatter whatever the constants.
    assert results["rms_misfit_after"]["value"] > 5.0
    assert {"attenuation_level", "lesion_relaxation_time_at_65_degc"} <= set(results["not_identified"])
    assert len(results["rows"]) == 11 and len(results["attenuation_coefficients"]) == 5
    for constant in results["constants"].values():
        assert constant["standard_error"] > 0.0 and constant["unit"]
    with xr.open_dataset(out / "calibration.nc", engine="h5netcdf") as data:
        assert data["stage"].values.tolist() == ["before", "after"]
        reference = data["displacement_percent"].sel(step_temperature=37.0)
        np.testing.assert_allclose(reference, 100.0)
    report = (out / "report.md").read_text()
    assert "is not fixed by these data" in report and "extrapolated to" in report
    table = (out / "parameters.csv").read_text().splitlines()
    assert table[0].startswith("constant,unit,estimate,standard_error") and len(table) == 1 + 8 + 5


@pytest.mark.timeout(1800)
def test_reproduce(tmp_path):
    assert run(["reproduce", "--out", str(tmp_path)]) == 0
    rows = {row["quantity"]: row for row in summary_of(tmp_path)["results"]["rows"]}
    assert rows["displacement at 55 degC, lesion by dose"]["verdict"] == "agrees"
    assert rows["displacement at 70 degC, lesion by table 3"]["verdict"] == "differs"
    assert rows["lesion length at 70 degC"]["here"] > 6.8
    for name in ("attenuation", "moduli", "loss_tangent", "geometry", "displacement", "readings", "lesion_on_force"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000 and (tmp_path / f"{name}.pdf").exists()
    table = list(csv.DictReader((tmp_path / "reproduction.csv").read_text(encoding="utf-8").splitlines()))
    assert {row["verdict"] for row in table} == {"agrees", "differs", "not stated"} and all(row["why"] for row in table)
    assert all((row["paper"] == "") == (row["verdict"] == "not stated") for row in table)
    readings = list(csv.DictReader((tmp_path / "readings.csv").read_text(encoding="utf-8").splitlines()))
    assert len(readings) == 1 + 64 and readings[0]["percent_at_70_degc"] == "49"
    nearest = min(readings[1:], key=lambda row: float(row["rms_difference_from_text"]))
    assert nearest["lesion"] == "semi-axes" and nearest["beam"].startswith("bowl, harmonics")
    assert (tmp_path / "variations.csv").read_text(encoding="utf-8").count("\n") > 100
    with xr.open_dataset(tmp_path / "second_study.nc", engine="h5netcdf") as data:
        assert data["displacement_per_watt"].shape == (151, 121)
        assert all(data[name].attrs["units"] for name in (*data.data_vars, *data.coords))
    with xr.open_dataset(tmp_path / "reproduction_lesion_by_dose.nc", engine="h5netcdf") as data:
        assert data.attrs["reference_temperature_degc"] == 35.0
    report = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "## Second study" in report and "## Readings" in report


def test_field(tmp_path, capfd):
    """Nonlinear where the file does not say; everything in SI in the file, and watts that add up."""
    assert run(["field", EXPERIMENT, "--out", str(tmp_path)]) == 0
    results = summary_of(tmp_path)["results"]
    assert results["tolerance_statement"] == "reached" and results["tolerance"] == 1e-3
    assert results["peak_positive_pressure"]["value"] > 1.3 * -results["peak_negative_pressure"]["value"] > 6e6
    assert results["peak_positive_pressure_position"]["value"] == pytest.approx(61.5e-3, abs=1.5e-3)
    lost, reflected = (np.sum(results[f"{name}_power"]["value"]) for name in ("lost", "reflected"))
    assert lost + reflected + results["leaving_power"]["value"][-1] == pytest.approx(50.0, rel=3e-3)
    with xr.open_dataset(tmp_path / "field.nc", engine="h5netcdf") as data:
        for name in (*data.data_vars, *data.coords):
            assert data[name].attrs["units"] == (VARIABLES | COORDINATES)[name][0]
        assert data.attrs["acoustic_power_w"] == 50.0 and data.attrs["march_n_harmonics"] >= 16
        # What the layers take from the beam beyond water is mostly heat in the tissue that the map covers.
        liver = data["heat_deposition"].sel(z=slice(42.7e-3, None))
        heat = (2.0 * np.pi * liver["r"] * liver).integrate("r").integrate("z")
        assert float(heat) == pytest.approx(results["lost_power"]["value"][-1], rel=0.05)
    for name in ("field", "sound"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000 and (tmp_path / f"{name}.pdf").exists()
    report = (tmp_path / "report.md").read_text()
    assert "Nonlinear field of 50 W" in report and "The tolerance of 0.001 is reached" in report
    assert "the tolerance of 0.001 is reached" in capfd.readouterr().out


def test_field_that_falls_short_or_is_linear(tmp_path, capfd):
    text = shipped("suomi2016_experiment").read_text()
    (tmp_path / "few.toml").write_text(text + "\n[acoustics]\nharmonics = 5\n")
    assert run(["field", str(tmp_path / "few.toml"), "--out", str(tmp_path / "few"), "--power-w", "100"]) == 0
    results = summary_of(tmp_path / "few")["results"]
    assert results["tolerance_statement"].startswith("not reached: the harmonics end too early")
    assert "the tolerance of 0.001 is not reached: the harmonics end too early" in capfd.readouterr().out
    assert "Nonlinear field of 100 W" in (tmp_path / "few" / "report.md").read_text()
    (tmp_path / "linear.toml").write_text(text + "\n[acoustics]\nnonlinear = false\n")
    assert run(["field", str(tmp_path / "linear.toml"), "--out", str(tmp_path / "linear")]) == 0
    results = summary_of(tmp_path / "linear")["results"]
    assert results["peak_positive_pressure"]["value"] == pytest.approx(-results["peak_negative_pressure"]["value"])
    assert results["peak_positive_pressure"]["value"] == pytest.approx(6.2e6, rel=0.02)
    assert results["radiation_force_of_intensity_relative_difference"]["value"] == pytest.approx(0.0, abs=1e-12)
    assert "Linear field of 50 W" in (tmp_path / "linear" / "report.md").read_text()
