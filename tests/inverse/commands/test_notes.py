"""What commands have to say besides their results."""

import dataclasses
import importlib
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from arfjax import Drive, Heating, InputError, MarchSettings, discretise, read_experiment
from arfjax.experiment.monitoring import MonitoringSection
from arfjax.laws import Constant
from arfjax.tissues import unperfused
from inverse.commands.calibrate import ending
from inverse.commands.field import power_lines
from inverse.commands.main import run
from inverse.commands.notes import (
    assumed_notes,
    boiling_notes,
    border_notes,
    grid_notes,
    heated_border_notes,
    modulation_notes,
    sound_notes,
)
from inverse.datasets.shipped import shipped
from inverse.diagnosis.hmi.causes.perfusion import PERFUSED
from inverse.least_squares import descend


def test_heat_of_nonlinear_sound_at_another_power():
    linear = discretise(read_experiment(shipped("suomi2016_experiment")).model())
    nonlinear = dataclasses.replace(linear, march=MarchSettings(n_harmonics=16))
    assert sound_notes(linear, 0.4) == sound_notes(nonlinear, 1.0, 0.0, 1.001) == []
    (said,) = sound_notes(nonlinear, 1.0, 0.0, 0.4, 1.2)
    assert said.startswith("heat is that of the stated power times 0.4, but nonlinear sound of that other power")


def test_heat_of_a_modulated_beam_of_nonlinear_sound():
    """A share of that at its strongest: exact where heat goes with the power, and where the beam is on or off."""
    linear = discretise(read_experiment(shipped("suomi2016_experiment")).model())
    nonlinear = dataclasses.replace(linear, march=MarchSettings(n_harmonics=16))
    sine, square = MonitoringSection(), MonitoringSection(modulation="square", duty_cycle=0.3)
    assert modulation_notes(linear, sine) == modulation_notes(nonlinear, square) == []
    assert modulation_notes(nonlinear, MonitoringSection(probe="push")) == []
    (said,) = modulation_notes(nonlinear, sine)
    assert said.startswith("heat is that of the beam at its strongest times the mean of its modulation, 0.5, but")


def test_walls_that_cool_the_focus():
    """Said of a push's heating up to its temperature only."""
    shape = (3, 4, 5)
    warm = jnp.full(shape, 37.0)
    heating = Heating(
        jnp.arange(3.0), jnp.asarray([37.0, 50.0, 70.0]), warm.at[2, 1, -1].add(2.0), warm, jnp.asarray(1.0)
    )
    assert heated_border_notes(heating, 50.0) == border_notes(0.5) == []
    assert heated_border_notes(heating, 60.0) == heated_border_notes(heating, 70.0) == border_notes(2.0)
    assert border_notes(2.0)[0].startswith("the border of the grid warms by 2.0 K beside walls that are held")


def test_boiling():
    assert boiling_notes(float("nan")) == []
    assert "reaches 100 degC at 2.5 s" in boiling_notes(2.5)[0]


def test_where_the_grids_are_too_small():
    """For long waves, and for heat that nothing carries away."""
    model = read_experiment(shipped("suomi2016_experiment")).model()
    dry = dataclasses.replace(model, liver=unperfused(model.liver))
    flow = Constant(PERFUSED, unit="1/s", source="test")
    wet = dataclasses.replace(model, liver=dataclasses.replace(model.liver, perfusion_rate=flow))
    assert grid_notes(dry, 600.0) == grid_notes(wet, 3600.0) == []
    (said,) = grid_notes(dry, 601.0)
    assert said.startswith("heat is followed over 601 s without blood flow")
    low, fair = (dataclasses.replace(model, drive=Drive(frequency, 10.0)) for frequency in (0.2e6, 0.25e6))
    assert grid_notes(fair) == []
    (said,) = grid_notes(low)
    assert said.startswith("the sound field's domain is narrow for waves as long as at 0.2 MHz")


def test_more_steps_are_advised_where_they_can_be_had():
    """By `calibrate` alone; commands without such an option are told what else may help."""

    def residual(u, _):
        return u**2 - 2.0

    stopped = descend(residual, np.ones(1), max_steps=1)
    assert stopped.out_of_steps and "steps: look for constants that the data do not fix" in stopped.message
    assert ending(stopped).endswith("look for constants that the data do not fix, or allow more by --max-steps.")
    assert ending(descend(residual, np.ones(1))) == "The optimisation converged."


def test_power_below_zero_is_explained():
    """Where refraction into a layer makes up for more than is reflected."""
    described = read_experiment(shipped("suomi2016_experiment"))
    names = ("entering_power", "reflected_power", "lost_power", "leaving_power")
    data = xr.Dataset({name: ("layer", np.array([9.0, -0.283])) for name in names})
    lines = power_lines(described, data)
    assert "| 9.000 | 9.000 | 9.000 | 9.000 |" in lines[4] and "| -0.283 |" in lines[5]
    assert "it may be below zero" in lines[-2]


FIVE_LAYERS = Path(__file__).parents[3] / "examples" / "five_layers.toml"
OF_MOTION = ("mechanics", "lesion")


def test_what_is_assumed_in_place_of_a_section_is_said():
    described = read_experiment(FIVE_LAYERS)
    sections = ("sonication", "monitoring", *OF_MOTION)
    sonication, monitoring, mechanics, lesion = assumed_notes(described, *sections, power=50.0)
    assert sonication == "the file has no [sonication]: assumed is 60 s at 50 W, then 60 s at 0 W, from 37 degC."
    assert "no [monitoring]: assumed is steady shaking at 50 Hz" in monitoring
    assert "no [mechanics]: assumed is that tabulated moduli are Young's" in mechanics
    assert "no [lesion]: assumed is a lesion as large as 240 equivalent minutes reach" in lesion
    assert (described.mechanics.modulus, described.lesion.size, described.lesion.edge) == ("young", "dose", "linear")
    assert assumed_notes(read_experiment(shipped("suomi2016_experiment")), *sections, power=50.0) == []


@pytest.mark.parametrize(
    ("command", "sections"),
    [
        (["simulate"], OF_MOTION),
        (["push"], OF_MOTION),
        (["vibrate"], OF_MOTION),
        (["vary"], OF_MOTION),
        (["sonicate"], ("sonication",)),
        (["monitor"], ("sonication", "monitoring", *OF_MOTION)),
        (["vary", "--protocol", "transient"], ("sonication", "monitoring", *OF_MOTION)),
    ],
)
def test_every_command_says_what_it_assumes(command, sections, tmp_path, capsys, monkeypatch):
    def told(described, *names, power=50.0):
        raise InputError(f"{' '.join(names)} at {float(power):g} W")

    monkeypatch.setattr(importlib.import_module(f"inverse.commands.{command[0]}"), "assumed_notes", told)
    assert run([*command, str(FIVE_LAYERS), "--out", str(tmp_path / "out")]) == 2
    assert f"{' '.join(sections)} at 50 W" in capsys.readouterr().err
