"""Every key of an experiment file reaches what is built of it, in SI units: each has a number that no other key has."""

import numpy as np
import pytest

from arfjax import (
    Experiment,
    OuterLayer,
    SharpEdge,
    ShearModulus,
    ShortPush,
    Square,
    StepwiseProtocol,
    TabulatedSize,
    Wall,
    discretise,
)
from arfjax.acoustics.diffraction import ExactOneWay, Pade12
from arfjax.experiment.messages import _known_keys
from arfjax.mechanics.modulation import SineIntensity, SinePressure
from arfjax.suomi2016 import TABLE_3_LESION

DEPTH = 80e-3


def probe(described):
    model = described.model()
    return described.monitoring.plan(model, discretise(model, refinement=0.3), 60.0)


def source_pressure(described):
    model = described.model()
    water = model.path[0].tissue.acoustic(described.protocol.temperatures_c[0])
    return model.drive.source_pressure(model.bowl, water.density * water.sound_speed)


def band(described):
    delays = described.monitoring.tracking.tracker(DEPTH).delays
    return delays.centre_frequency * (1.0 + 0.5 * delays.fractional_bandwidth * np.array([-1.0, 1.0]))


def bead(described):
    return described.sonication.thermocouple.instrument()


def tracker(described):
    return described.monitoring.tracking.tracker(DEPTH)


def liver(described):
    return described.model().liver


def sound(described):
    return described.acoustics.start(described.model(), nonlinear=True)


KEYS = {
    "title": ("ours", "ours", lambda it: it.title),
    "transducer.outer_diameter_mm": (61.0, 30.5e-3, lambda it: it.model().bowl.aperture_radius),
    "transducer.inner_diameter_mm": (19.0, 9.5e-3, lambda it: it.model().bowl.hole_radius),
    "transducer.focal_length_mm": (63.0, 63e-3, lambda it: it.model().bowl.focal_length),
    "transducer.frequency_mhz": (1.3, 1.3e6, lambda it: it.model().drive.frequency),
    "transducer.acoustic_power_w": (47.0, 47.0, lambda it: it.model().drive.acoustic_power),
    "transducer.source_pressure_kpa": (231.0, 231e3, source_pressure),
    "layers.tissue": (
        ["water", "skin", "fat", "muscle", "liver"],
        [1000.0, 1090.0, 950.0, 1050.0, 1060.0],  # table 1 of the paper
        lambda it: [float(layer.tissue.density(35.0)) for layer in it.model().layers],
    ),
    "layers.thickness_mm": (
        [22.0, 1.5, 9.0, 11.0, 43.0],
        [22e-3, 1.5e-3, 9e-3, 11e-3, 43e-3],
        lambda it: [layer.thickness for layer in it.model().layers],
    ),
    "layers.perfused": ([True] * 4 + [False], 0.0, lambda it: liver(it).perfusion_rate(37.0)),
    "layers.coagulation_stops_perfusion": (
        [False] * 4 + [True],
        [True, False],
        lambda it: [bool(liver(it).perfusion_rate(37.0, dose) > 1e-10) for dose in (0.0, 1e6)],
    ),
    "layers.coagulation_doubles_attenuation": (
        [False] * 4 + [True],
        2.0,
        lambda it: liver(it).attenuation(40.0, 1e9) / liver(it).attenuation(40.0, 0.0),
    ),
    "layers.heat_constants": (
        ["constant"] * 4 + ["warming"],
        [False] * 4 + [True],
        lambda it: [
            bool(each.tissue.conductivity(90.0) > each.tissue.conductivity(37.0)) for each in it.model().layers
        ],
    ),
    "mechanics.modulus": ("shear", ShearModulus(), lambda it: it.model().modulus_reading),
    "mechanics.poisson_ratio": (0.497, 0.497, lambda it: it.model().poisson_ratio),
    "mechanics.walls.outer": ("free", Wall.FREE, lambda it: it.model().walls.outer),
    "mechanics.walls.front": ("sliding", Wall.SLIDING, lambda it: it.model().walls.bottom),
    "mechanics.walls.back": ("fixed", Wall.FIXED, lambda it: it.model().walls.top),
    "mechanics.outer_layers_mm": (6.0, OuterLayer(6e-3), lambda it: it.model().outer_layer),
    "lesion.size": ("table", TabulatedSize, lambda it: type(it.model().lesion.size)),
    "lesion.table_sizes_are": (
        "semi-axes",
        2e-3 * TABLE_3_LESION[65.0].length_mm,
        lambda it: it.model().lesion.size.length(65.0),
    ),
    "lesion.edge": ("sharp", SharpEdge(0.5e-3), lambda it: it.model().lesion.edge),
    "protocol.kind": ("stepwise", StepwiseProtocol, lambda it: type(it.stepwise())),
    "protocol.temperatures_c": (
        [36.0, 49.0, 71.0],
        [36.0, 71.0],
        lambda it: [it.stepwise().start_temperature, it.stepwise().final_temperature],
    ),
    "protocol.normalised_at_c": (42.0, 42.0, lambda it: it.protocol.normalised_at_c),
    "protocol.sonication_s": (53.0, 53.0, lambda it: it.stepwise().duration),
    "protocol.push_ms": (0.7, 0.7e-3, lambda it: it.stepwise().push_duration),
    "protocol.push_modulation": ("pressure", SinePressure(), lambda it: it.stepwise().modulation),
    "acoustics.nonlinear": (False, 1, lambda it: sound(it).march.n_harmonics),
    "acoustics.harmonics": (24, 24, lambda it: sound(it).march.n_harmonics),
    "acoustics.diffraction": ("pade12", Pade12(), lambda it: sound(it).diffraction),
    "acoustics.tolerance": (0.02, 0.02, lambda it: it.acoustics.tolerance),
    "acoustics.steepening": ("along-axis", ExactOneWay(steepening_along_ray=False), lambda it: sound(it).diffraction),
    "acoustics.source": ("projected", 63e-3 - np.sqrt(63e-3**2 - 30.5e-3**2), lambda it: sound(it).source_plane),
    "sonication.acoustic_power_w": (12.0, 12.0, lambda it: it.sonicated().drive.acoustic_power),
    "sonication.start_temperature_c": (38.0, 38.0, lambda it: it.sonication.plan().start_temperature),
    "sonication.phases.duration_s": (
        [30.0, 28.0],
        [30.0, 28.0],
        lambda it: [phase.duration for phase in it.sonication.plan().phases],
    ),
    "sonication.phases.relative_power": (
        [1.1, 0.25],
        [1.1, 0.25],
        lambda it: [phase.power for phase in it.sonication.plan().phases],
    ),
    "sonication.step_s": (0.4, [75, 70], lambda it: [phase.n_steps for phase in it.sonication.plan().phases]),
    "sonication.steps": ("adaptive", "adaptive", lambda it: it.sonication.steps),
    "sonication.field": ("frozen", np.inf, lambda it: it.sonication.plan().field_tolerance),
    "sonication.field_tolerance_k": (3.0, 3.0, lambda it: it.sonication.plan().field_tolerance),
    "sonication.thermocouple.radial_offset_mm": (0.35, 0.35e-3, lambda it: bead(it).radial_offset),
    "sonication.thermocouple.axial_offset_mm": (-0.8, -0.8e-3, lambda it: bead(it).axial_offset),
    "sonication.thermocouple.junction_diameter_mm": (0.15, 0.15e-3, lambda it: bead(it).junction_diameter),
    "sonication.thermocouple.time_constant_s": (0.2, 0.2, lambda it: bead(it).time_constant),
    "sonication.thermocouple.viscous_fraction": (0.45, 0.45, lambda it: bead(it).viscous_fraction),
    "sonication.thermocouple.viscous_time_constant_s": (2.5, 2.5, lambda it: bead(it).viscous_time_constant),
    "monitoring.probe": ("push", ShortPush, lambda it: type(probe(it))),
    "monitoring.frequency_hz": (55.0, 55.0, lambda it: probe(it).frequency),
    "monitoring.modulation": ("pressure", SinePressure(0.65), lambda it: probe(it).modulation),
    "monitoring.depth": (0.65, SineIntensity(0.65), lambda it: probe(it).modulation),
    "monitoring.duty_cycle": (0.32, Square(0.32), lambda it: probe(it).modulation),
    "monitoring.push_ms": (0.9, 0.9e-3, lambda it: probe(it).duration),
    "monitoring.tolerance_k": (4.0, 4.0, lambda it: it.monitoring.tolerance_k),
    "monitoring.normalised_at_c": (39.0, 39.0, lambda it: it.monitoring.normalised_at_c),
    "monitoring.tracking.aperture_diameter_mm": (
        16.5,
        1540.0 / 7e6 * DEPTH / (np.pi * 16.5e-3),  # of the middle of the band
        lambda it: tracker(it).lateral_width,
    ),
    "monitoring.tracking.lowest_frequency_mhz": (5.6, 5.6e6, lambda it: band(it)[0]),
    "monitoring.tracking.highest_frequency_mhz": (8.4, 8.4e6, lambda it: band(it)[1]),
    "monitoring.tracking.window_mm": (1.7, 1.7e-3, lambda it: tracker(it).window_length),
    "monitoring.tracking.radial_offset_mm": (0.55, 0.55e-3, lambda it: tracker(it).radial_offset),
    "monitoring.tracking.axial_offset_mm": (-0.95, -0.95e-3, lambda it: tracker(it).axial_offset),
    "calibration": ({"reference_temperature_c": 37.0}, {"reference_temperature_c": 37.0}, lambda it: it.calibration),
    "inference": ({"reference_temperature_c": 40.0}, {"reference_temperature_c": 40.0}, lambda it: it.inference),
}
"""By key: what the file says, what that is in SI units, and where it is found."""

_PUSH = {f"monitoring.{name}": None for name in ("frequency_hz", "depth")}
APART = {
    "transducer.source_pressure_kpa": {"transducer.acoustic_power_w": None},
    "layers.perfused": {},
    "acoustics.nonlinear": {"acoustics.harmonics": None},
    "acoustics.steepening": {"acoustics.diffraction": "exact"},
    "sonication.field": {},
    "monitoring.probe": _PUSH,
    "monitoring.modulation": {},
    "monitoring.duty_cycle": {"monitoring.modulation": "square", "monitoring.depth": None},
    "monitoring.push_ms": {"monitoring.probe": "push"} | _PUSH,
}
"""Keys that cannot stand beside all others, and what has to be otherwise where they are; all others are in every file.
"""

ELSEWHERE = {"transducer.focal_pressure_mpa"}  # takes a search: test_experiment


def described_with(key):
    """An experiment with all keys that can stand beside one of them, in its sections."""
    said = {name: value for name, (value, _, _) in KEYS.items() if name not in APART or name == key} | APART.get(
        key, {}
    )
    sections = {}
    for name, value in said.items():
        *path, last = name.split(".")
        section = sections
        for part in path:
            section = section.setdefault(part, {})
        if value is not None:
            section[last] = value
    sections["layers"] = entries(sections["layers"])
    sections["sonication"]["phases"] = entries(sections["sonication"]["phases"])
    return Experiment.model_validate(sections)


def entries(columns):
    """Entries of a list of sections."""
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


@pytest.mark.parametrize("key", KEYS)
def test_a_key_reaches_what_is_built_of_it(key):
    _, expected, found = KEYS[key]
    found = found(described_with(key))
    if isinstance(expected, (float, list)):
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    else:
        assert found == expected


def test_every_key_is_here_with_a_number_of_its_own():
    known = set(_known_keys(Experiment))
    sections = {name.rpartition(".")[0] for name in known}
    assert known - sections == set(KEYS) | ELSEWHERE
    numbers = [value for value, _, _ in KEYS.values() if type(value) in (int, float)]
    assert len(set(numbers)) == len(numbers)
