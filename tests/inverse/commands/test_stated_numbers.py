"""What commands state of results that are made up: every number under its own name, in its unit, with its remarks."""

import csv
import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from arfjax import Heating, InputError, SineIntensity, SinePressure, Square, discretise, read_experiment
from arfjax.io import full_field_dataset, labelled, push_dataset
from inverse.commands import calibrate, field, fit_heating, monitor, push, simulate, sonicate, vibrate
from inverse.commands.vibrate import ModulationKind
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.figures import draw_calibration
from inverse.hmi_fit import CalibrationSettings, HmiFit, constants_of
from inverse.least_squares import descend
from inverse.thermometry_model import CONSTANTS
from tests.inverse.test_figures import fit_of
from tests.test_io import FOCUS, beam, watched

DESCRIBED = read_experiment(shipped("suomi2016_experiment"))
MODEL = DESCRIBED.model()


def rows_of(path):
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


@pytest.fixture
def heated():
    """A fit of forty-one rows, three of which were not seen."""
    fit = fit_of(37.0 + 7.0 * np.linspace(0.0, 1.0, 41) ** 0.5)
    used = np.arange(41) > 2
    correlation = np.eye(5)
    correlation[1, 2] = correlation[2, 1] = -0.97
    correlation[0, 4] = correlation[4, 0] = 0.9
    sure = dataclasses.replace(
        fit.uncertainty,
        standard_errors=0.1 * np.arange(1.0, 6.0),
        correlation=correlation,
        not_identified={"start": "start is not fixed by these data."},
    )
    return dataclasses.replace(
        fit, used=used, uncertainty=sure, values=np.array([7.0, 20.0, 4.0, 5.5, 60.0]), rms=0.05, noise_sd=0.06,
        fitted=fit.fitted - 0.25, ratio_range=(None, 12.0), autocorrelation=0.7, n_starts=4, n_agreeing=3,
    )  # fmt: skip


def test_a_heating_fit(heated, tmp_path):
    found = fit_heating._results(heated)
    for number, (name, unit, _) in enumerate(CONSTANTS):
        expected = {"value": heated.values[number], "unit": unit, "standard_error": 0.1 * (1.0 + number)}
        assert found["constants"][name] == pytest.approx(expected)
    assert found["diffusion_time_ratio_95_percent"] == {"lower": None, "upper": 12.0, "unit": "1"}
    assert (found["rms"]["value"], found["noise_sd"]["value"]) == (0.05, 0.06)
    assert (found["n_rows"], found["n_fitted"], found["n_starts"], found["n_agreeing"]) == (41, 38, 4, 3)
    said = fit_heating._notes(heated)
    assert "38 rows fitted, 3 left out as occluded; rises are counted from 37 degC" in said[1]
    assert "data minus fit 0.05 K root mean square, noise 0.06 K" in said[1]
    failed = dataclasses.replace(heated, converged=False, status="stopped")
    assert fit_heating._notes(failed)[0] == "THE FIT DID NOT CONVERGE: stopped."
    fit_heating._write_parameters(tmp_path / "parameters.csv", heated)
    rows = rows_of(tmp_path / "parameters.csv")
    assert [row["identified"] for row in rows] == ["true", "true", "true", "false", "true"]
    assert [float(row["estimate"]) for row in rows] == heated.values.tolist()
    data = fit_heating._dataset(heated)
    np.testing.assert_allclose(data["residual"], 0.25)
    assert data["fitted_row"].to_numpy().tolist() == [0] * 3 + [1] * 38 and data.attrs["baseline_degc"] == 37.0


def test_what_a_heating_fit_warns_of(heated):
    """Constants that are told apart poorly by name, the range with an open end, noise that is none, a baseline."""
    said = dataclasses.replace(heated, baseline_unseen=True, ratio_doubt="It is in doubt.").warnings
    assert said[0] == "start is not fixed by these data."
    (pair,) = (each for each in said if "hard to tell apart" in each)
    assert pair.startswith("diffusion_time_ratio and diffusion_time are") and "(correlation -0.97)" in pair
    assert "only between the lower end of its range (1) and 12 (95 %)" in " ".join(said)
    assert "It is in doubt." in said and "are correlated (+0.70)" in " ".join(said)
    assert "The baseline of 37 degC is that of the first row, which is occluded" in said[-1]
    quiet = dataclasses.replace(heated, autocorrelation=0.45, ratio_range=(2.0, None)).warnings
    assert "correlated (" not in " ".join(quiet)
    alternating = " ".join(dataclasses.replace(heated, autocorrelation=-0.6).warnings)
    assert "too small" in " ".join(said) and "they alternate" in alternating and "too large" in alternating
    assert "between 2 and the upper end of its range (400)" in " ".join(quiet)


def calibrated(*, in_percent=True):
    """A calibration whose numbers are all different, of three rows."""
    constants = constants_of(MODEL, CalibrationSettings())
    unit = 1.0 if in_percent else 1e-6
    data = HmiData(
        Path("hmi.csv"), ("a", "a", "b"), np.array([40.0, 50.0, 60.0]), None, unit * np.array([100.0, 90.0, 80.0]),
        in_percent, None, (),
    )  # fmt: skip
    fit = HmiFit(
        constants=constants, values=np.arange(1.0, 9.0), standard_errors=0.01 * np.arange(1.0, 9.0),
        correlation=np.eye(8), shrinkage=np.array([0.1, 0.2, 0.3, 0.95, 0.5, 0.6, 0.7, 0.99]), level_shrinkage=0.5,
        coefficients=np.arange(11.0, 16.0), coefficient_errors=np.arange(21.0, 26.0), model=MODEL,
        before=unit * np.array([103.0, 94.0, 80.0]), after=unit * np.array([101.0, 92.0, 82.0]),
        noise_sd=unit * np.array([3.0, 4.0, 5.0]), noise_estimated=True, noise_settled=False, determined=4.25,
        descent=descend(lambda u, _: u - 1.0, np.zeros(1)),
    )  # fmt: skip
    return fit, data


@pytest.mark.parametrize(("in_percent", "unit"), [(True, "percent"), (False, "um")])
def test_a_calibration(tmp_path, in_percent, unit):
    """Root mean squares of 3, 4 and 0 before and 1, 2 and 2 after, in percent or micrometres."""
    fit, data = calibrated(in_percent=in_percent)
    assert calibrate._misfit(fit, data) == (pytest.approx(5.0 / np.sqrt(3.0)), pytest.approx(np.sqrt(3.0)), unit)
    found = calibrate._results(fit, data)
    assert found["rms_misfit_before"] == {"value": pytest.approx(5.0 / np.sqrt(3.0)), "unit": unit}
    assert found["rms_misfit_after"] == {"value": pytest.approx(np.sqrt(3.0)), "unit": unit}
    names = [parameter.name for parameter in fit.constants.parameters]
    assert found["not_identified"] == [names[3], names[7]] and found["determined_constants"] == 4.25
    assert found["constants"][names[2]] == {
        "value": 3.0, "unit": "percent", "standard_error": pytest.approx(0.03), "error_over_prior": 0.3,
    }  # fmt: skip
    assert found["attenuation_coefficients"]["attenuation_p1"] == {
        "value": 12.0, "unit": "percent/K", "standard_error": 22.0,
    }  # fmt: skip
    scale = 1.0 if in_percent else 1e-6
    assert found["rows"][1] == {
        "sonication": "a", "temperature_degc": 50.0, "time_s": None, "measured": pytest.approx(90.0 * scale),
        "standard_deviation": pytest.approx(4.0 * scale), "before": pytest.approx(94.0 * scale),
        "after": pytest.approx(92.0 * scale), "unit": "percent" if in_percent else "m",
    }  # fmt: skip
    calibrate._write_parameters(tmp_path / "parameters.csv", fit)
    rows = rows_of(tmp_path / "parameters.csv")
    assert [row["identified"] for row in rows[:8]] == ["yes"] * 3 + ["no"] + ["yes"] * 3 + ["no"]
    assert (rows[5]["constant"], rows[5]["estimate"], rows[5]["error_over_prior"]) == (names[5], "6", "0.6000")
    assert (rows[12]["constant"], rows[12]["unit"], rows[12]["estimate"]) == ("attenuation_p4", "percent/K^4", "15")
    (before, prior) = calibrate._rows(fit)[5][2], float(fit.constants.parameters[5].transform.scale)
    assert float(before) == pytest.approx(prior, rel=1e-3)


def test_what_a_calibration_warns_of():
    fit, data = calibrated()
    curves = xr.Dataset(
        {"lesion_length": (("stage", "step_temperature"), np.zeros((2, 2)))},
        {"stage": ["before", "after"], "step_temperature": [40.0, 50.0]},
    )
    settings = discretise(MODEL, refinement=0.4)
    said = calibrate._notes(fit, data, curves, settings)
    assert "2.89 percent before, 1.73 percent after; the data determine 4.2 of 8 constants" in said[1]
    assert "3 percent was estimated" in said[2]
    assert sum("is not fixed by these data" in each for each in said) == 2
    assert any(each.startswith("THE ESTIMATE OF THE SCATTER DID NOT SETTLE") for each in said)
    assert any("linear sound at 1.1 MHz" in each for each in said)
    settled = dataclasses.replace(fit, noise_estimated=False, noise_settled=True)
    quiet = " ".join(calibrate._notes(settled, data, curves, settings))
    assert "SETTLE" not in quiet and "estimated" not in quiet
    in_metres = calibrate._notes(*calibrated(in_percent=False), curves, settings)
    assert "2.89 um before, 1.73 um after" in in_metres[1] and "3 um was estimated" in in_metres[2]


def test_the_figure_of_a_calibration():
    """Readings on the curves, and constants by how far their logarithms moved in prior standard deviations."""
    fit, data = calibrated()
    curves = xr.Dataset(
        {"displacement_percent": (("stage", "step_temperature"), [[100.0, 90.0], [100.0, 80.0]])},
        {"stage": ["before", "after"], "step_temperature": [37.0, 60.0]},
    )
    measured, attenuation, constants = draw_calibration(data, fit, curves).axes
    shown = {line.get_label(): line.get_xydata() for line in measured.lines}
    np.testing.assert_allclose(shown["before"], [[37.0, 100.0], [60.0, 90.0]])
    np.testing.assert_allclose(shown["calibrated"], [[37.0, 100.0], [60.0, 80.0]])
    np.testing.assert_allclose(shown["sonication a"], [[40.0, 100.0], [50.0, 90.0]])
    np.testing.assert_allclose(shown["sonication b"], [[60.0, 80.0]])
    anchor = fit.constants.anchors[0]
    (after,) = (line.get_xydata() for line in attenuation.lines if line.get_label() == "calibrated")
    np.testing.assert_allclose(after[0], [anchor, np.polynomial.Polynomial(fit.coefficients)(anchor)])
    (before,) = (line.get_xydata() for line in attenuation.lines if line.get_label() == "before")
    np.testing.assert_allclose(before[0], [anchor, float(MODEL.liver.attenuation.percent(anchor))], rtol=1e-6)
    standing = np.array([float(each.transform.scale) for each in fit.constants.parameters])
    widths = np.array([np.hypot(0.25, 0.25)] * 5 + [0.5] * 3)
    points = constants.containers[0][0].get_xydata()
    np.testing.assert_allclose(points[:, 0], np.log(fit.values / standing) / widths)
    assert [label.get_text() for label in constants.get_yticklabels()] == [
        each.label for each in fit.constants.parameters
    ]
    np.testing.assert_array_equal(constants.get_yticks(), points[:, 1])


def test_a_watched_sonication():
    """Highest in its middle, a lesion from the fourth moment on, and less displacement at the end."""
    course = {
        "tracked_displacement": 1e-6 * np.array([2.0, 2.2, 2.4, 1.6, 1.4]),
        "tracked_displacement_percent": np.array([100.0, 110.0, 120.0, 80.0, 70.0]),
        "thermocouple_temperature": np.array([37.0, 45.0, 55.0, 65.0, 60.0]),
        "lesion_length": 1e-3 * np.array([0.0, 0.0, 0.0, 4.0, 5.0]),
        "lesion_diameter": 1e-3 * np.array([0.0, 0.0, 0.0, 1.0, 2.0]),
        "probed_anew": np.array([1.0, 0.0, 1.0, 1.0, 0.0]),
        "field_updates": np.array([0.0, 1.0, 1.0, 2.0, 4.0]),
    }
    data = labelled(
        {name: (("heating_time",), values) for name, values in course.items()},
        {"heating_time": np.array([0.0, 10.0, 20.0, 30.0, 40.0])},
    ).assign_attrs(reference_temperature_degc=37.0)
    assert {name: (each["value"], each["unit"]) for name, each in monitor._results(data).items()} == {
        "start_displacement": (pytest.approx(2e-6), "m"),
        "highest_displacement": (120.0, "percent"),
        "temperature_of_highest_displacement": (55.0, "degC"),
        "end_displacement": (70.0, "percent"),
        "lesion_time": (30.0, "s"),
        "lesion_length": (pytest.approx(5e-3), "m"),
        "lesion_diameter": (pytest.approx(2e-3), "m"),
    }
    rows = dict(monitor._rows(data))
    assert rows["displacement at the start, tracked"] == "2.000 um"
    assert rows["lesion appears at"] == "30 s, displacement 80.0 %"
    assert rows["lesion at the end"] == "5.00 x 2.00 mm"
    assert rows["highest temperature that the thermocouple shows"] == "65.0 degC"
    assert (rows["displacement computed"], rows["field computed again"]) == ("3 times", "4 times")
    never = data.assign(lesion_length=0.0 * data["lesion_length"])
    assert dict(monitor._rows(never))["lesion appears at"] == "never"
    assert np.isnan(monitor._results(never)["lesion_time"]["value"])


def test_what_a_watched_sonication_is_normalised_at():
    shown = np.array([37.0, 50.0, 62.0, 40.0])
    monitoring = DESCRIBED.monitoring
    for wanted, expected in ((None, 37.0), (37.0, 37.0), (62.0, 62.0)):
        changed = DESCRIBED.model_copy(update={"monitoring": monitoring.model_copy(update={"normalised_at_c": wanted})})
        assert monitor._reference(changed, shown) == expected
    for wanted in (36.9, 62.1):
        changed = DESCRIBED.model_copy(update={"monitoring": monitoring.model_copy(update={"normalised_at_c": wanted})})
        with pytest.raises(InputError, match="the thermocouple shows 37.0 to 62.0 degC"):
            monitor._reference(changed, shown)


def test_a_push():
    """Roots of 1e-12 m^2 each half millisecond; the wave has come to the last radius but one."""
    data = push_dataset(dataclasses.replace(watched(), arrival=jnp.asarray([jnp.nan, 1e-3, 2e-3, jnp.nan])), 40.0)
    data.attrs["push_duration_s"] = 2.1e-3
    assert {name: (each["value"], each["unit"]) for name, each in push._results(data).items()} == {
        "displacement": (pytest.approx(2e-6), "m"),
        "largest_displacement": (pytest.approx(np.sqrt(8.0) * 1e-6), "m"),
        "time_of_largest": (pytest.approx(4e-3), "s"),
        "shear_wave_speed": (1.0, "m s-1"),
        "followed_to": (pytest.approx(2e-3), "m"),
        "lesion_length": (4e-3, "m"),
        "lesion_diameter": (2e-3, "m"),
    }
    rows = dict(push._rows(data))
    assert rows["displacement at the focus at the end of the push"] == "2.000 um"
    assert rows["largest displacement at the focus"] == "2.828 um at 4.00 ms" and rows["lesion"] == "4.0 x 2.0 mm"
    assert rows["shear wave in the focal plane"] == "1.00 m/s, followed to r = 2.0 mm"
    still = data.assign_attrs(shear_wave_speed_m_s=np.nan)
    assert dict(push._rows(still))["shear wave in the focal plane"] == "has not passed"
    assert push._results(still)["shear_wave_speed"]["value"] is None


def test_a_push_is_watched_as_long_as_is_asked_and_at_the_last_temperature():
    temperature, watch = push._checked(DESCRIBED, None, 12.0)
    assert (temperature, watch.duration) == (DESCRIBED.protocol.temperatures_c[-1], pytest.approx(12e-3))
    assert push._checked(DESCRIBED, 50.0, 12.0)[0] == 50.0


def test_a_vibration():
    data = labelled(
        {
            "vibration_amplitude": (("vibration_harmonic",), 1e-6 * np.array([3.0, 0.5])),
            "vibration_phase": (("vibration_harmonic",), np.array([-0.25, 1.5])),
        },
        {"vibration_harmonic": np.array([1, 2])},
    ).assign_attrs(
        focal_peak_to_peak_m=6.5e-6, left_out_harmonics_m=2e-8, absorbing_layer_relative_error=0.02,
        lesion_length_m=8e-3, lesion_diameter_m=3e-3, modulation_frequency_hz=60.0, modulation="square, duty cycle 0.5",
    )  # fmt: skip
    found = vibrate._results(data)
    assert found["peak_to_peak_displacement"] == {"value": 6.5e-6, "unit": "m"}
    assert found["amplitude"]["value"] == pytest.approx([3e-6, 5e-7]) and found["phase"]["value"] == [-0.25, 1.5]
    assert (found["lesion_length"]["value"], found["lesion_diameter"]["value"]) == (8e-3, 3e-3)
    assert (found["left_out_harmonics"]["value"], found["absorbing_layer_relative_error"]["value"]) == (2e-8, 0.02)
    rows = dict(vibrate._rows(data))
    assert rows["peak-to-peak displacement at the focus"] == "6.500 um" and rows["lesion"] == "8.0 x 3.0 mm"
    assert rows["amplitude and phase at 60 Hz"] == "3.000 um, -0.25 rad"
    assert rows["amplitude and phase at 120 Hz"] == "0.500 um, 1.50 rad"
    assert rows["harmonics left out, if inertia rules them"] == "at most 0.020 um"
    assert rows["error of the absorbing layer"] == "2 %"
    settings = discretise(MODEL, refinement=0.4)
    (mean, layer) = vibrate._notes(DESCRIBED, settings, data)
    assert mean.startswith("the mean displacement is left out") and layer.endswith("its error is 2.0 %.")
    assert len(vibrate._notes(DESCRIBED, settings, data.assign_attrs(absorbing_layer_relative_error=0.009))) == 1


def test_a_modulation_is_whole_unless_less_of_it_is_asked_for():
    hottest = DESCRIBED.protocol.temperatures_c[-1]
    kinds = ModulationKind
    for kind, depth, duty, expected in (
        (kinds.INTENSITY, None, None, SineIntensity(1.0)),
        (kinds.PRESSURE, 0.3, None, SinePressure(0.3)),
        (kinds.SQUARE, None, None, Square(0.5)),
        (kinds.SQUARE, None, 0.2, Square(0.2)),
    ):
        assert vibrate._checked(DESCRIBED, None, 50.0, kind, depth, duty) == (hottest, expected)
    assert [vibrate._words(each) for each in (SineIntensity(0.7), SinePressure(0.3), Square(0.2))] == [
        "sine of the intensity, depth 0.7", "sine of the pressure, depth 0.3", "square, duty cycle 0.2",
    ]  # fmt: skip


def test_a_simulation():
    steps, by_step = np.array([37.0, 60.0]), ("step_temperature",)
    data = labelled(
        {
            "pressure_amplitude_on_axis": (("z",), 1e6 * np.array([1.0, 6.0, 2.0])),
            "sonication_time": (by_step, np.array([2.5, 40.0])),
            "displacement": (by_step, np.array([2e-6, 1.5e-6])),
            "displacement_percent": (by_step, np.array([100.0, 75.0])),
            "lesion_length": (by_step, np.array([0.0, 9e-3])),
            "lesion_diameter": (by_step, np.array([0.0, 2e-3])),
        },
        {"z": np.array([0.05, 0.06, 0.07]), "step_temperature": steps},
    )
    assert simulate._rows(data)[1] == ("60", "40.00", "9.0 x 2.0", "1.500", "75.0")
    blank = jnp.zeros((1, 1, 1))
    heating = Heating(jnp.zeros(1), jnp.zeros(1), blank, blank, jnp.asarray(21.0))
    found = simulate._results(data, heating)
    assert found["peak_pressure"] == {"value": 6e6, "unit": "Pa"}
    assert found["peak_position"] == {"value": 0.06, "unit": "m"}
    assert found["heating_acoustic_power"] == {"value": 21.0, "unit": "W"}
    assert found["displacement"] == {"value": [2e-6, 1.5e-6], "unit": "m"}
    assert found["displacement_percent"] == {"value": [100.0, 75.0], "unit": "percent"}
    assert found["lesion_length"]["value"] == [0.0, 9e-3] and found["lesion_diameter"]["value"] == [0.0, 2e-3]


def test_times_that_are_shown_of_a_sonication():
    """A tenth, three and six tenths of the way to the hottest moment, that moment, a fifth after it, and the end."""
    time = np.linspace(0.0, 100.0, 101)
    data = xr.Dataset({"peak_temperature": ("heating_time", -np.abs(time - 60.0))}, {"heating_time": time})
    assert sonicate.shown_times(data) == [6.0, 18.0, 36.0, 60.0, 68.0, 100.0]
    rising = data.assign(peak_temperature=("heating_time", time))
    assert sonicate.shown_times(rising) == [10.0, 30.0, 60.0, 100.0]


@pytest.fixture(scope="module")
def sound():
    return full_field_dataset(beam(12), FOCUS, tolerance=1e-3)


def test_a_field(sound):
    """Of the made-up beam of test_io.py, whose peak lies at 60 mm on the axis."""
    found, rows = field._results(sound), dict(field._rows(sound))
    highest, lowest = float(sound["peak_positive_pressure"].max()), float(sound["peak_negative_pressure"].min())
    assert found["peak_positive_pressure"] == {"value": pytest.approx(highest), "unit": "Pa"}
    assert found["peak_negative_pressure"] == {"value": pytest.approx(lowest), "unit": "Pa"}
    assert found["peak_positive_pressure_position"] == {"value": pytest.approx(60e-3), "unit": "m"}
    assert found["peak_positive_pressure_radius"] == {"value": 0.0, "unit": "m"}
    assert found["peak_intensity"]["value"] == pytest.approx(float(sound["intensity"].max()))
    assert found["peak_heat_deposition"]["value"] == pytest.approx(float(sound["heat_deposition"].max()))
    assert found["entering_power"]["value"] == [50.0, 47.0] and found["leaving_power"]["value"] == [48.0, 30.0]
    assert found["lost_power"]["value"] == [2.0, 17.0] and found["reflected_power"]["unit"] == "W"
    assert found["convergence"].keys() >= {"harmonics", "radial", "axial"}
    assert rows["highest positive pressure"] == f"{1e-6 * highest:.3f} MPa at z = 60.00 mm"
    assert rows["lowest negative pressure"] == f"{1e-6 * lowest:.3f} MPa"
    first = float(sound["focal_spectrum"][0])
    assert rows["harmonics 1 to 5 at the geometric focus"].startswith(f"{1e-6 * first:.3f}, ")
    assert rows["highest intensity (spatial peak, temporal average)"] == (
        f"{1e-4 * float(sound['intensity'].max()):.0f} W/cm2"
    )
    heat = sound["heat_deposition"]
    place = float(heat["z"][np.unravel_index(np.argmax(heat.to_numpy()), heat.shape)[1]])
    assert rows["highest heat deposition"] == f"{1e-6 * float(heat.max()):.1f} W/cm3 at z = {1e3 * place:.2f} mm"
    assert (
        rows["highest radiation force density"] == f"{1e-3 * float(sound['radiation_force_density'].max()):.1f} kN/m3"
    )


def test_whether_a_field_reached_its_tolerance(sound):
    assert field._verdict(sound).startswith("the tolerance of 0.001 is reached")
    short = sound.assign_attrs(tolerance_statement="not reached: why", convergence_shock_fraction=0.19)
    assert field._verdict(short) == "the tolerance of 0.001 is not reached: why."
    shocked = short.assign_attrs(convergence_shock_fraction=0.21)
    assert "There is a shock thinner than the harmonics resolve" in field._verdict(shocked)


def test_positions_of_a_field_hold_the_axis_and_the_focal_plane_once():
    settings = discretise(MODEL)
    r, z = field.positions(MODEL, settings)
    back = MODEL.liver_depth + MODEL.liver_thickness
    assert r[0] == 0.0 and np.all(np.diff(r) > 0.0) and np.all(np.diff(z) > 0.05e-3)
    assert np.sum(np.abs(z - settings.focus) < 1e-12) == 1
    assert settings.march.start_plane <= z[0] and z[-1] <= back and z[-1] > back - 0.5e-3
    near = np.abs(z - settings.focus) < 3.9e-3
    np.testing.assert_allclose(np.diff(z[near]), 0.125e-3, rtol=1e-6)
    assert np.max(np.diff(r[r < 2.9e-3])) < 0.07e-3 and 19e-3 < r[-1] <= 20e-3
