"""What commands have to say besides their results."""

import dataclasses

import numpy as np
import xarray as xr

from arfjax import MarchSettings, discretise, read_experiment
from inverse.commands.calibrate import ending
from inverse.commands.field import power_lines
from inverse.commands.notes import boiling_notes, sound_notes
from inverse.datasets.shipped import shipped
from inverse.least_squares import descend


def test_heat_of_nonlinear_sound_at_another_power():
    linear = discretise(read_experiment(shipped("suomi2016_experiment")).model())
    nonlinear = dataclasses.replace(linear, march=MarchSettings(n_harmonics=16))
    assert sound_notes(linear, 0.4) == sound_notes(nonlinear, 1.0, 0.0, 1.001) == []
    (said,) = sound_notes(nonlinear, 1.0, 0.0, 0.4, 1.2)
    assert said.startswith("heat is that of the stated power times 0.4, but nonlinear sound of that other power")


def test_boiling():
    assert boiling_notes(float("nan")) == []
    assert "reaches 100 degC at 2.5 s" in boiling_notes(2.5)[0]


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
