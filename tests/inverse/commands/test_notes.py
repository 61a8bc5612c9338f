"""What commands have to say besides their results."""

import dataclasses

from arfjax import MarchSettings, discretise, read_experiment
from inverse.commands.notes import boiling_notes, sound_notes
from inverse.datasets.shipped import shipped


def test_heat_of_nonlinear_sound_at_another_power():
    linear = discretise(read_experiment(shipped("suomi2016_experiment")).model())
    nonlinear = dataclasses.replace(linear, march=MarchSettings(n_harmonics=16))
    assert sound_notes(linear, 0.4) == sound_notes(nonlinear, 1.0, 0.0, 1.001) == []
    (said,) = sound_notes(nonlinear, 1.0, 0.0, 0.4, 1.2)
    assert said.startswith("heat is that of the stated power times 0.4, but nonlinear sound of that other power")


def test_boiling():
    assert boiling_notes(float("nan")) == []
    assert "reaches 100 degC at 2.5 s" in boiling_notes(2.5)[0]
