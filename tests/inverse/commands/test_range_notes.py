"""Commands that heat tissue say which laws were followed beyond their range, of results that are made up."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from arfjax import DamageEdge, InputError, SonicationResult, TransientResult, discretise, read_experiment
from arfjax.experiment.monitoring import MonitoringSection
from arfjax.thermal.feedback import Effort
from arfjax.thermal.lesion import LesionSize
from inverse.commands import monitor, notes, vary
from inverse.commands.main import run
from inverse.datasets.shipped import shipped

FILE = shipped("suomi2016_experiment")
DESCRIBED = read_experiment(FILE)
MODEL = DESCRIBED.model()


def heated(settings, focal, dose):
    """All cells as warm as the focus [degC] and with that dose [min], but the last one, which stays as it was."""
    focal, dose = jnp.asarray(focal), jnp.asarray(dose)
    time = jnp.arange(float(len(focal)))
    cells = jnp.ones((1, *settings.heat_grid.shape))
    temperature = (focal[:, None, None] * cells).at[:, -1, -1].set(focal[0])
    doses = (dose[:, None, None] * cells).at[:, -1, -1].set(0.0)
    length = jnp.where(dose >= 240.0, 1e-3, 0.0)
    effort = Effort(jnp.asarray(1), jnp.asarray(0), jnp.asarray(0.0), jnp.asarray(True))
    size = LesionSize(length, length, length, length)
    updates = jnp.zeros(len(focal) - 1)
    nan = jnp.asarray(jnp.nan)
    return SonicationResult(time, focal, temperature, doses, doses, size, temperature[1:], updates, nan, effort)


def told(found, place):
    return [note.split(";")[0] for note in found if place in note]


def test_a_lesion_speaks_for_the_hottest_that_its_tissue_saw():
    settings = discretise(MODEL)
    result = heated(settings, [37.0, 55.0, 91.0, 40.0], [0.0, 1.0, 300.0, 300.0])
    by_dose = dataclasses.replace(MODEL, lesion=dataclasses.replace(MODEL.lesion, edge=DamageEdge()))
    for model in (MODEL, by_dose):
        (said,) = told(notes.lesion_range_notes(model, result), "lesion.viscoelasticity.branch_modulus")
        assert said.endswith("extrapolated to 91 degC")
        assert notes.lesion_range_notes(model, heated(settings, [37.0, 91.0], [0.0, 1.0])) == []
    found = notes.heated_range_notes(MODEL, DESCRIBED, settings, result)
    assert found[0].startswith("for the field, attenuation and sound speed are held")
    assert told(found, "liver.attenuation") == ["liver.attenuation: extrapolated to 91 degC"]


def test_monitor_says_so(tmp_path, monkeypatch):
    def watched(model, protocol, settings, *, steps):
        result = heated(settings, [37.0, 60.0, 91.0], [0.0, 1.0, 300.0])
        mesh = protocol.probe.mesh(settings)
        size = 1e-6 * jnp.ones(3)
        maps = size[:, None, None] * jnp.ones((1, len(mesh.node_r), len(mesh.node_z)))
        return TransientResult(result.time, size, size, maps, size > 0.0, result.focal_temperature, result)

    monkeypatch.setattr(monitor, "run_transient", watched)
    monkeypatch.setattr(monitor, "compiled", lambda function: function)
    text = FILE.read_text().replace("frequency_mhz = 1.1", "frequency_mhz = 0.2").replace("_s = 60.0 }", "_s = 700.0 }")
    (tmp_path / "e.toml").write_text(text.replace('tissue = "liver"', 'tissue = "liver"\nperfused = false'))
    assert run(["monitor", str(tmp_path / "e.toml"), "--out", str(tmp_path / "out")]) == 0
    report = (tmp_path / "out" / "report.md").read_text()
    assert "liver.attenuation: extrapolated to 91 degC" in report
    assert "lesion.viscoelasticity.branch_modulus: extrapolated to 91 degC" in report
    assert "heat is followed over 760 s without blood flow" in report
    assert "narrow for waves as long as at 0.2 MHz" in report
    assert "the border of the grid warms by 54.0 K" in report


def test_monitor_takes_its_start_for_reached_whatever_rounding_says():
    """What the thermocouple shows is a mean over cells: 37.000000000000014 degC where all are at 37."""
    at_37 = DESCRIBED.model_copy(update={"monitoring": MonitoringSection(normalised_at_c=37.0)})
    assert monitor._reference(at_37, np.array([np.nextafter(37.0, 40.0), 60.0, 50.0])) == 37.0
    for course in ([37.1, 60.0], [35.0, 36.0]):
        with pytest.raises(InputError, match="name a temperature in between"):
            monitor._reference(at_37, np.array(course))


@pytest.mark.parametrize(("protocol", "hottest"), [("stepwise", 80.0), ("transient", 91.0)])
def test_vary_says_so_of_the_central_run(protocol, hottest, tmp_path, monkeypatch):
    (tmp_path / "e.toml").write_text(FILE.read_text().replace("65.0, 70.0]", "65.0, 80.0]"))
    found = []

    def made_up(task, factors, partial):
        del partial
        # It rises and falls in the first run alone, that of the central constants.
        course = np.array([37.0, 50.0, hottest, 45.0]) if task.temperatures is None else task.temperatures
        hotter = np.linspace(0.0, 5.0, len(factors))[:, None]
        lesion, border = 1e-3 * (course + hotter > 60.0), np.linspace(1.0, 2.0, len(factors))
        boiling, power = np.linspace(12.5, 9.0, len(factors)), np.linspace(4.0, 5.0, len(factors))
        found = {"focal_temperature": course + hotter, "lesion_length": lesion, "border_rise": border}
        by_power = {} if task.temperatures is None else {"heating_power": power}
        return found | {"boiling_time": boiling} | by_power

    def written(folder, data, task):
        del folder, data
        found.extend(task.notes)
        raise InputError("enough was seen")

    monkeypatch.setattr(vary, "_run", made_up)
    monkeypatch.setattr(vary, "_dataset", lambda *given: xr.Dataset())
    monkeypatch.setattr(vary, "_write", written)
    call = ["vary", str(tmp_path / "e.toml"), "--out", str(tmp_path / "out"), "--protocol", protocol, "--samples", "2"]
    assert run(call) == 2
    assert len(told(found, "with the central constants, liver.attenuation: extrapolated to ")) == 1
    assert len(told(found, "the border of the grid warms by 1.0 K")) == 1
    assert len(told(found, "tissue reaches 100 degC at 12.5 s")) == 1
    assert not told(found, "nonlinear sound")
    (said,) = told(found, "lesion.viscoelasticity.branch_modulus")
    assert said.startswith("with the central constants, ") and said.endswith(f"to {hottest:g} degC")


def test_vary_says_that_the_heat_of_nonlinear_sound_is_scaled():
    """To the power that takes the central tissue to its last temperature: a third of the one that is stated."""
    described = read_experiment(FILE)
    model = described.model()
    settings = described.discretised(model)
    nonlinear = dataclasses.replace(settings, march=dataclasses.replace(settings.march, n_harmonics=24))
    power = float(model.drive.acoustic_power) * np.array([0.33, 1.0])
    outcomes = {
        "lesion_length": np.zeros((2, 2)), "border_rise": np.zeros(2), "boiling_time": np.full(2, np.nan),
        "heating_power": power,
    }  # fmt: skip
    for march, said in ((settings, 0), (nonlinear, 1)):
        task = vary.Task(model, march, lambda model: {}, np.array([37.0, 50.0]), 37.0, 37.0, "displacement", "", 2, ())
        assert len(told(vary._central_notes(task, outcomes), "heat is that of the stated power times 0.33")) == said
