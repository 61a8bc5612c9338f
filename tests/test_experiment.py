"""Experiment files: the example in SI units, and files that are refused in one line that names the key."""

import re
from pathlib import Path

import equinox as eqx
import numpy as np
import pytest

from arfjax import (
    DoseSize,
    InputError,
    LinearEdge,
    OuterLayer,
    SharpEdge,
    ShearModulus,
    ShortPush,
    Square,
    TabulatedSize,
    Wall,
    YoungModulus,
    discretise,
    read_experiment,
)
from arfjax.acoustics.diffraction import ExactOneWay, Pade11, Pade12, Parabolic
from arfjax.acoustics.sources.projected_bowl import ProjectedBowl
from arfjax.mechanics.elements.mesh import Walls
from arfjax.mechanics.material.viscoelastic import ConstrainedModulus
from arfjax.model import DamageEdge
from inverse.datasets.shipped import shipped
from tests.mutations import mutations

EXAMPLE = Path(__file__).parent.parent / "examples" / "suomi2016.toml"
GOOD = EXAMPLE.read_text(encoding="utf-8")
BY_DOSE = GOOD[GOOD.index('size = "dose"') : GOOD.index('"linear"')] + '"linear"'
TEMPERATURES = "[35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0]"


def changed(*replacements):
    """The example with one place after the other changed."""
    text = GOOD
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def write(tmp_path, text):
    path = tmp_path / "experiment.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(path):
    with pytest.raises(InputError) as error:
        read_experiment(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ") and len(message.splitlines()) == 1
    return message.removeprefix(f"{path}: ")


def test_example_is_the_papers_experiment():
    described = read_experiment(EXAMPLE)
    model, protocol = described.model(), described.stepwise()
    np.testing.assert_allclose(
        [model.bowl.aperture_radius, model.bowl.hole_radius, model.bowl.focal_length], [32e-3, 10e-3, 62.6e-3]
    )
    np.testing.assert_allclose([model.drive.frequency, model.drive.acoustic_power], [1.1e6, 50.0])
    np.testing.assert_allclose([layer.thickness for layer in model.path], [20.6e-3, 2e-3, 10e-3, 10e-3])
    np.testing.assert_allclose([model.liver_depth, model.liver_thickness], [42.6e-3, 40e-3])
    # Table 1 of the paper.
    np.testing.assert_allclose([layer.tissue.density(35.0) for layer in model.layers], [1000, 1090, 950, 1050, 1060])
    assert isinstance(model.modulus_reading, YoungModulus) and isinstance(model.lesion.size, DoseSize)
    assert model.poisson_ratio == 0.499
    assert (protocol.start_temperature, protocol.final_temperature, protocol.duration) == (35.0, 70.0, 60.0)
    assert protocol.push_duration == pytest.approx(0.5e-3)
    assert described.calibration["reference_temperature_c"] == 37.0
    assert described.transducer.rim_depth_mm == pytest.approx(1e3 * float(model.bowl.rim_depth), rel=1e-12)


def test_shipped_experiment_is_the_example():
    assert shipped("suomi2016_experiment").read_bytes() == EXAMPLE.read_bytes()


def test_the_five_layers():
    described = read_experiment(EXAMPLE.parent / "five_layers.toml")
    model = described.model()
    np.testing.assert_allclose([layer.thickness for layer in model.layers], [34e-3, 2e-3, 10e-3, 10e-3, 40e-3])
    assert model.drive.acoustic_power == 50.0 and described.acoustics.nonlinear
    assert described.acoustics.harmonics is None


def test_choices_and_defaults(tmp_path):
    text = changed(
        ('modulus = "young"', 'modulus = "shear"'),
        ('size = "dose"', 'size = "table"'),
        ("poisson_ratio = 0.499\n", ""),
        ("inner_diameter_mm = 20.0\n", ""),
        ("thickness_mm = 40.0", "thickness_mm = 40\nperfused = false"),
    )
    described = read_experiment(write(tmp_path, b"\xef\xbb\xbf" + text.encode()))  # with a byte-order mark
    model = described.model()
    assert isinstance(model.modulus_reading, ShearModulus) and isinstance(model.lesion.size, TabulatedSize)
    assert (model.poisson_ratio, model.bowl.hole_radius, model.liver_thickness) == (0.499, 0.0, 40e-3)
    assert float(model.liver.perfusion_rate(37.0)) == 0.0
    assert float(read_experiment(EXAMPLE).model().liver.perfusion_rate(37.0)) > 0.0


def test_surroundings_and_edges(tmp_path):
    """The paper's by default; every other choice reaches the model."""
    model = read_experiment(EXAMPLE).model()
    assert model.walls == Walls(True, True, True) and model.outer_layer is None
    assert isinstance(model.lesion.edge, LinearEdge)
    text = changed(
        ('modulus = "young"', 'modulus = "constrained"'),
        ('outer = "fixed", front = "fixed", back = "fixed"', 'outer = "free", front = "sliding"'),
        ("# outer_layers_mm", "outer_layers_mm"),
        ("= 5.0 adds", "= 5.0  # adds"),
        ('edge = "linear"', 'edge = "damage"'),
    )
    other = read_experiment(write(tmp_path, text)).model()
    assert isinstance(other.modulus_reading, ConstrainedModulus) and isinstance(other.lesion.edge, DamageEdge)
    assert other.walls == Walls(outer=Wall.FREE, bottom=Wall.SLIDING, top=Wall.FIXED)
    assert other.outer_layer == OuterLayer(5e-3)
    table = BY_DOSE, 'size = "table"\ntable_sizes_are = "semi-axes"\nedge = "sharp"'
    doubled = read_experiment(write(tmp_path, changed(table))).model().lesion
    assert isinstance(doubled.edge, SharpEdge)
    np.testing.assert_allclose([doubled.size.length(65.0), doubled.size.diameter(65.0)], [10e-3, 2.4e-3])


def test_the_monitoring_of_the_example_and_its_choices(tmp_path):
    monitoring = read_experiment(EXAMPLE).monitoring
    assert (monitoring.mean_force(), monitoring.normalised_at_c) == (0.5, 37.0)
    assert monitoring.words().startswith("steady shaking at 50 Hz (sine of the intensity, depth 1)")
    point = monitoring.tracking.tracker(0.09)
    assert (point.lateral_width, point.window_length) == (0.0, 0.0)
    text = changed(
        ('modulation = "intensity"', 'modulation = "square"\nduty_cycle = 0.3'),
        ("[monitoring]", "[monitoring.tracking]\naperture_diameter_mm = 16.5\nwindow_mm = 1.0\n\n[monitoring]"),
    )
    monitoring = read_experiment(write(tmp_path, text)).monitoring
    assert monitoring.mean_force() == pytest.approx(0.3)
    tracker = monitoring.tracking.tracker(0.09)
    # lambda z / (pi D) at the middle of the band, 7.25 MHz.
    assert float(tracker.lateral_width) == pytest.approx(1540.0 / 7.25e6 * 0.09 / (np.pi * 16.5e-3))
    assert float(tracker.window_length) == pytest.approx(1e-3)
    text = changed(('probe = "shaking"', 'probe = "push"'), ("frequency_hz = 50.0\n", ""), ('modulation = "i', '# "i'))
    described = read_experiment(write(tmp_path, text.replace('push_modulation = "none"', 'push_modulation = "square"')))
    assert described.stepwise().modulation == Square() and read_experiment(EXAMPLE).stepwise().modulation is None
    probe = described.monitoring.plan(described.model(), discretise(described.model(), refinement=0.3), 70.0)
    assert isinstance(probe, ShortPush) and probe.duration == 0.5e-3 and described.monitoring.mean_force() == 1.0


def test_the_measurement_s_experiment_can_be_read():
    described = read_experiment(EXAMPLE.with_name("suomi2016_hmi.toml"))
    model = described.sonicated()
    assert (model.drive.frequency, model.bowl.focal_length) == pytest.approx((4.755e6, 90e-3))
    assert model.liver_depth < 90e-3 < model.liver_depth + model.liver_thickness == pytest.approx(105e-3)
    assert float(model.liver.perfusion_rate(37.0)) == 0.0 and isinstance(model.lesion.edge, DamageEdge)
    assert described.monitoring.mean_force() == pytest.approx(0.375)


def test_the_sonication_of_the_example_and_its_choices(tmp_path):
    described = read_experiment(EXAMPLE)
    plan, model = described.sonication.plan(), described.sonicated()
    assert [(phase.duration, phase.n_steps, phase.power) for phase in plan.phases] == [
        (60.0, 120, 1.0),
        (60.0, 120, 0.0),
    ]
    assert (plan.start_temperature, plan.field_tolerance, model.drive.acoustic_power) == (37.0, 2.0, 13.0)
    assert described.model().drive.acoustic_power == 50.0
    thermocouple = described.sonication.thermocouple.instrument()
    np.testing.assert_allclose([thermocouple.radial_offset, thermocouple.junction_diameter], [0.3e-3, 0.25e-3])
    text = changed(
        ("acoustic_power_w = 13.0\n", ""),
        ('field = "updated"', 'field = "frozen"'),
        ("step_s = 0.5", "step_s = 0.7"),
        (
            "thickness_mm = 40.0",
            'thickness_mm = 40\nheat_constants = "warming"\ncoagulation_stops_perfusion = true\n'
            "coagulation_doubles_attenuation = true",
        ),
    )
    described = read_experiment(write(tmp_path, text))
    plan, model = described.sonication.plan(), described.sonicated()
    assert (plan.field_tolerance, model.drive.acoustic_power, plan.phases[0].n_steps) == (np.inf, 50.0, 86)
    assert float(model.liver.perfusion_rate(37.0)) > 0.0 and float(model.liver.perfusion_rate(37.0, 1e6)) < 1e-10
    assert float(model.liver.attenuation(40.0, 1e9)) == pytest.approx(2.0 * float(model.liver.attenuation(40.0)))
    assert float(model.liver.conductivity(90.0)) > 1.4 * float(model.liver.conductivity(37.0))


def test_the_choices_of_acoustics(tmp_path):
    plain = read_experiment(EXAMPLE)
    assert plain.acoustics.nonlinear is None and plain.acoustics.tolerance == 1e-3
    default, standard = plain.discretised(plain.model()), discretise(plain.model())
    assert eqx.tree_equal(default, standard)  # linear, the exact operator, the true bowl
    lines = 'nonlinear = true\nharmonics = 24\ndiffraction = "pade12"\nsource = "projected"'
    described = read_experiment(write(tmp_path, changed(acoustics(lines))))
    assert isinstance(described.acoustics.operator(), Pade12)
    for name, operator in (("pade11", Pade11), ("parabolic", Parabolic)):
        other = read_experiment(write(tmp_path, changed(acoustics(f'diffraction = "{name}"'))))
        assert type(other.acoustics.operator()) is operator
        settings = other.discretised(other.model())
        assert type(settings.diffraction) is operator and settings.march == standard.march
    along_axis = read_experiment(write(tmp_path, changed(acoustics('steepening = "along-axis"')))).acoustics.operator()
    assert along_axis == ExactOneWay(steepening_along_ray=False) != plain.acoustics.operator()
    projected = read_experiment(write(tmp_path, changed(acoustics('source = "projected"'))))
    source = projected.discretised(projected.model()).source(projected.model())
    assert isinstance(source, ProjectedBowl) and source.plane == pytest.approx(8.797e-3, abs=1e-6)


def test_a_source_pressure_is_the_power_that_it_sends_out(tmp_path):
    """0.217114 MPa and 50 W are one drive in water of 1.482 MPa s/m."""
    text = changed(("acoustic_power_w = 50.0", "source_pressure_kpa = 217.1142"))
    described = read_experiment(write(tmp_path, text))
    drive = described.model().drive
    assert drive.acoustic_power == pytest.approx(50.0, rel=1e-5)
    assert float(drive.source_pressure(described.model().bowl, 1.482e6)) == pytest.approx(217114.2, rel=1e-12)
    assert described.model_at(7.0).drive.acoustic_power == 7.0
    assert described.model_at(7.0).drive.frequency == drive.frequency


def test_a_focal_pressure_is_the_power_that_makes_it_in_water(tmp_path):
    """By O'Neil's gain of 37.413 in lossless water, where sound is said to be linear; 50 W make 8.1 MPa then."""
    lines = acoustics("nonlinear = false")
    text = changed(("acoustic_power_w = 50.0", "focal_pressure_mpa = 8.1229"), lines)
    assert read_experiment(write(tmp_path, text)).model().drive.acoustic_power == pytest.approx(50.0, rel=5e-3)


@pytest.mark.slow
def test_a_focal_pressure_of_steepened_sound_takes_less_power(tmp_path):
    text = changed(("acoustic_power_w = 50.0", "focal_pressure_mpa = 8.1229"), acoustics("tolerance = 0.01"))
    described = read_experiment(write(tmp_path, text))
    power = described.model().drive.acoustic_power
    assert 25.0 < power < 45.0 and described.model().drive.acoustic_power == power


UNKNOWN = {
    "top": (("title", "titel"), "unknown key `titel`; did you mean `title`?"),
    "section": (("[mechanics]", "[mechanic]"), "unknown key `mechanic`; did you mean `mechanics`?"),
    "misspelt and so missing": (
        ("focal_length_mm", "focal_lenght_mm"),
        "unknown key `transducer.focal_lenght_mm`; did you mean `transducer.focal_length_mm`?",
    ),
    "in metres": (
        ("focal_length_mm = 62.6", "focal_length_m = 0.0626"),
        "unknown key `transducer.focal_length_m`; did you mean `transducer.focal_length_mm`?",
    ),
    "in a list": (
        ("thickness_mm = 2.0", "thicknes_mm = 2.0"),
        "unknown key `layers.thicknes_mm` (entry 2); did you mean `layers.thickness_mm`?",
    ),
    "in the wrong section": (
        ('kind = "stepwise"', "frequency_mhz = 1.1"),
        "unknown key `protocol.frequency_mhz`; did you mean `transducer.frequency_mhz`?",
    ),
    "like nothing": (
        ('size = "dose"', "xyzzy = 1"),
        "unknown key `lesion.xyzzy`; remove it; known here are size, table_sizes_are, edge.",
    ),
    "with a line break": (("title", '"ti\\ntle"'), "unknown key `ti tle`; did you mean `title`?"),
    "with an escape": (("title", '"\\u001b[2Jtitle"'), "unknown key `\\x1b[2Jtitle`; did you mean `title`?"),
}


@pytest.mark.parametrize(("replacement", "message"), UNKNOWN.values(), ids=UNKNOWN.keys())
def test_unknown_keys_are_refused_with_the_nearest_known_one(tmp_path, replacement, message):
    assert refusal(write(tmp_path, changed(replacement))) == message


@pytest.mark.parametrize(
    "line",
    [
        "outer_diameter_mm = 64.0\n",
        "focal_length_mm = 62.6\n",
        "frequency_mhz = 1.1\n",
        f"temperatures_c = {TEMPERATURES}\n",
        "normalised_at_c = 35.0\n",
    ],
)
def test_missing_keys(tmp_path, line):
    section = "protocol" if "_c =" in line else "transducer"
    assert refusal(write(tmp_path, changed((line, "")))).startswith(
        f"missing key `{section}.{line.split()[0]}`; add it"
    )


def test_missing_sections_and_entries(tmp_path):
    assert refusal(write(tmp_path, GOOD[: GOOD.index("[protocol]")])).startswith("missing key `protocol`")
    assert refusal(write(tmp_path, 'title = "nothing else"\n')).startswith("missing key `transducer`")
    assert refusal(write(tmp_path, changed(("thickness_mm = 10.0\n", "")))).startswith(
        "missing key `layers.thickness_mm` (entry 3)"
    )


FOCAL = "focal_length_mm = 62.6"


def acoustics(lines):
    """A change of the example: with a section on acoustics."""
    return "[mechanics]", f"[acoustics]\n{lines}\n\n[mechanics]"


WRONG = {
    "number as text": (
        (FOCAL, 'focal_length_mm = "62.6"'),
        "`transducer.focal_length_mm`: expected a number, got '62.6'",
    ),
    "truth value": ((FOCAL, "focal_length_mm = true"), "`transducer.focal_length_mm`: expected a number, got True"),
    "list": ((FOCAL, "focal_length_mm = [62.6]"), "`transducer.focal_length_mm`: expected a number, got [62.6]"),
    "date": ((FOCAL, "focal_length_mm = 2016-01-01"), "`transducer.focal_length_mm`: expected a number"),
    "NaN": ((FOCAL, "focal_length_mm = nan"), "`transducer.focal_length_mm`: expected a finite number, got nan"),
    "infinite": ((FOCAL, "focal_length_mm = inf"), "`transducer.focal_length_mm`: expected a finite number, got inf"),
    "too many digits": ((FOCAL, f"focal_length_mm = {'9' * 400}"), "`transducer.focal_length_mm`: "),
    "too many hexadecimal digits": ((FOCAL, f"focal_length_mm = 0x{'F' * 5000}"), "`transducer.focal_length_mm`: "),
    "text in a list": (
        (TEMPERATURES, '[35.0, "hot"]'),
        "`protocol.temperatures_c` (entry 2): expected a number, got 'hot'",
    ),
    "number for list": ((TEMPERATURES, "35.0"), "`protocol.temperatures_c`: expected a list, got 35.0"),
    "one temperature": ((TEMPERATURES, "[35.0]"), "`protocol.temperatures_c`: expected at least 2 values, got [35.0]"),
    "number for title": (('"Suomi et al. 2016, stepwise sonication of liver"', "3"), "`title`: expected text"),
    "text for truth": (
        ("thickness_mm = 2.0", 'thickness_mm = 2.0\nperfused = "no"'),
        "(entry 2): expected true or false",
    ),
    "table for section": (("[mechanics]", "[[mechanics]]"), "`mechanics`: expected a table, got [{"),
    "unknown tissue": (
        ('"fat"', '"bone"'),
        "`layers.tissue` (entry 3): expected 'water', 'skin', 'fat', 'muscle' or 'liver'",
    ),
    "unknown modulus": (
        ('"young"', '"bulk"'),
        "`mechanics.modulus`: expected 'young', 'shear' or 'constrained', got 'bulk'",
    ),
    "unknown size": (('"dose"', '"guess"'), "`lesion.size`: expected 'dose' or 'table', got 'guess'"),
    "unknown protocol": (('"stepwise"', '"transient"'), "`protocol.kind`: expected 'stepwise', got 'transient'"),
    "unknown wall": (('outer = "fixed"', 'outer = "glued"'), "`mechanics.walls.outer`: expected 'fixed', 'free' or"),
    "unknown side": (('outer = "fixed"', 'side = "fixed"'), "unknown key `mechanics.walls.side`"),
    "layers in metres": (
        ("poisson_ratio = 0.499", "poisson_ratio = 0.499\nouter_layers_mm = 0.005"),
        "`mechanics.outer_layers_mm`: expected 0.5 to 100 mm, got 0.005; is it in metres?",
    ),
    "unknown edge": (('"linear"', '"soft"'), "`lesion.edge`: expected 'linear', 'sharp' or 'damage', got 'soft'"),
    "edge by dose of a table": (
        (BY_DOSE, 'size = "table"\nedge = "damage"'),
        '`lesion`: edge = "damage" takes the lesion from the computed dose',
    ),
    "table without a table": (
        ('size = "dose"', 'table_sizes_are = "semi-axes"\nsize = "dose"'),
        '`lesion`: table_sizes_are = "semi-axes" has no effect with size = "dose"',
    ),
    "incompressible": (("0.499", "0.5"), "`mechanics.poisson_ratio`: expected 0 to 0.49999, got 0.5"),
    "metres": (
        (FOCAL, "focal_length_mm = 0.0626"),
        "`transducer.focal_length_mm`: expected 0.2 to 1000 mm, got 0.0626; is it in metres?",
    ),
    "hole in metres": (("inner_diameter_mm = 20.0", "inner_diameter_mm = 0.02"), "inner_diameter_mm 0.02 is too small"),
    "layer in metres": (
        ("thickness_mm = 40.0", "thickness_mm = 0.04"),
        "`layers.thickness_mm` (entry 5): expected 0.2 to 1000 mm",
    ),
    "hertz": (
        ("= 1.1", "= 1.1e6"),
        "`transducer.frequency_mhz`: expected 0.05 to 20 MHz, got 1.1e+06; is it in Hz or kHz?",
    ),
    "kilohertz": (("= 1.1", "= 1100"), "got 1100; is it in Hz or kHz? Give MHz"),
    "zero frequency": (("= 1.1", "= 0"), "`transducer.frequency_mhz`: expected 0.05 to 20 MHz, got 0"),
    "no power": (("= 50.0", "= 0.0"), "`transducer.acoustic_power_w`: expected 0.001 to 10000 W, got 0"),
    "kelvin": (
        (TEMPERATURES, "[308.15, 343.15]"),
        "`protocol.temperatures_c` (entry 1): expected 0 to 120 degC, got 308.15; is it in kelvin?",
    ),
    "kelvin once": (
        ("normalised_at_c = 35.0", "normalised_at_c = 308.15"),
        "`protocol.normalised_at_c`: expected 0 to 120 degC",
    ),
    "milliseconds": (
        ("= 60.0", "= 60000"),
        "`protocol.sonication_s`: expected 0.1 to 180 s, got 60000; is it in milliseconds?",
    ),
    "seconds": (
        ("push_ms = 0.5", "push_ms = 0.0005"),
        "`protocol.push_ms`: expected 0.01 to 20 ms, got 0.0005; is it in seconds?",
    ),
    "no drive": (
        ("acoustic_power_w = 50.0", ""),
        "`transducer`: expected exactly one of acoustic_power_w, source_pressure_kpa, focal_pressure_mpa, got none",
    ),
    "two drives": (
        ("acoustic_power_w = 50.0", "acoustic_power_w = 50.0\nsource_pressure_kpa = 217.0"),
        "got acoustic_power_w and source_pressure_kpa; how strongly is it driven?",
    ),
    "source pressure in pascal": (
        ("acoustic_power_w = 50.0", "source_pressure_kpa = 217114.0"),
        "`transducer.source_pressure_kpa`: expected 0.01 to 100000 kPa, got 217114; is it in pascal?",
    ),
    "too few harmonics": (acoustics("harmonics = 2"), "`acoustics.harmonics`: expected 4 to 1024 harmonics, got 2"),
    "too many harmonics": (acoustics("harmonics = 5000"), "got 5000; leave it out and they are chosen by `tolerance`"),
    "half a harmonic": (acoustics("harmonics = 32.5"), "`acoustics.harmonics`: expected a whole number, got 32.5"),
    "harmonics of linear sound": (
        acoustics("nonlinear = false\nharmonics = 32"),
        "`acoustics`: harmonics 32 cannot be carried by linear sound; leave harmonics out or set nonlinear = true",
    ),
    "text for nonlinear": (acoustics('nonlinear = "yes"'), "`acoustics.nonlinear`: expected true or false, got 'yes'"),
    "tolerance in percent": (
        acoustics("tolerance = 1.0"),
        "`acoustics.tolerance`: expected 0.0001 to 0.1, got 1; it is relative: 0.001 is 0.1 percent",
    ),
    "unknown operator": (
        acoustics('diffraction = "kzk"'),
        "`acoustics.diffraction`: expected 'exact', 'pade12', 'pade11' or 'parabolic', got 'kzk'",
    ),
    "steepening along rays of an operator without": (
        acoustics('diffraction = "parabolic"\nsteepening = "along-ray"'),
        '`acoustics`: steepening "along-ray" needs diffraction "exact": "parabolic" has only "along-axis"',
    ),
    "negative thickness": (
        ("thickness_mm = 2.0", "thickness_mm = -2.0"),
        "`layers.thickness_mm` (entry 2): expected 0.2 to 1000 mm, got -2; correct",
    ),
    "negative hole": (
        ("inner_diameter_mm = 20.0", "inner_diameter_mm = -1"),
        "`transducer.inner_diameter_mm`: expected 0 to 1000 mm, got -1",
    ),
    "falling temperatures": (("[35.0, 40.0", "[45.0, 40.0"), "`protocol`: temperatures_c must rise, got [45.0, 40.0"),
    "equal temperatures": (("[35.0, 40.0", "[40.0, 40.0"), "`protocol`: temperatures_c must rise"),
    "normalised outside": (
        ("normalised_at_c = 35.0", "normalised_at_c = 34.0"),
        "`protocol`: normalised_at_c 34 must lie in the range of temperatures_c, 35 to 70",
    ),
    "phase in milliseconds": (
        ("{ duration_s = 60.0 }", "{ duration_s = 60000.0 }"),
        "`sonication.phases.duration_s` (entry 1): expected 0.01 to 3600 s, got 60000; is it in milliseconds?",
    ),
    "no phases": (
        ("phases = [{ duration_s = 60.0 }, { duration_s = 60.0, relative_power = 0.0 }]", "phases = []"),
        "`sonication.phases`: expected at least 1 values, got []",
    ),
    "negative power": (("relative_power = 0.0", "relative_power = -1.0"), "expected 0 to 10, got -1"),
    "too many steps": (
        ("step_s = 0.5", "step_s = 0.01"),
        "`sonication`: 12000 steps of step_s 0.01 are too many to keep; up to 5000",
    ),
    "nothing heats": (
        ("phases = [{ duration_s = 60.0 }, {", "phases = [{ duration_s = 60.0, relative_power = 0 }, {"),
        "`sonication`: no phase has a relative_power above 0",
    ),
    "a depth of a square": (
        ('modulation = "intensity"', 'modulation = "square"\ndepth = 0.5'),
        "`monitoring`: depth has no effect with probe = shaking, modulation = square; leave it out",
    ),
    "a frequency of a push": (
        ('probe = "shaking"', 'probe = "push"'),
        "`monitoring`: frequency_hz, modulation has no effect with probe = push; leave it out",
    ),
    "kilohertz for hertz": (("frequency_hz = 50.0", "frequency_hz = 0.05"), "expected 5 to 1000 Hz, got 0.05"),
    "tracking by nothing": (
        ("[monitoring]", "[monitoring.tracking]\nwindow_mm = 2.0\n\n[monitoring]"),
        "`monitoring.tracking`: tracking by a perfect point has no other keys; give aperture_diameter_mm",
    ),
    "a band upside down": (
        (
            "[monitoring]",
            "[monitoring.tracking]\naperture_diameter_mm = 16.5\nlowest_frequency_mhz = 9.0\n\n[monitoring]",
        ),
        "`monitoring.tracking`: lowest_frequency_mhz 9 must be below highest_frequency_mhz 8.66",
    ),
    "an artefact that cannot last": (
        ("time_constant_s = 0.2", "viscous_fraction = 0.5"),
        "`sonication.thermocouple`: viscous_fraction 0.5 has no effect at viscous_time_constant_s 0",
    ),
    "percent for a share": (
        ("time_constant_s = 0.2", "viscous_fraction = 81.0"),
        "`sonication.thermocouple.viscous_fraction`: expected 0 to 10, got 81",
    ),
    "metres for millimetres": (("radial_offset_mm = 0.3", "radial_offset_mm = 300.0"), "got 300; give millimetres"),
    "hole as wide as the bowl": (
        ("inner_diameter_mm = 20.0", "inner_diameter_mm = 64.0"),
        "`transducer`: the hole (inner_diameter_mm 64) must be smaller than the bowl",
    ),
    "more than a hemisphere": (
        ("= 64.0", "= 125.2"),
        "`transducer`: a bowl of outer_diameter_mm 125.2 cannot have a radius of curvature of only focal_length_mm",
    ),
    "focus next to the rim": (
        ("= 64.0", "= 125.0"),
        "`transducer`: the focus lies only 3.54 mm beyond the bowl's rim, and 6 mm are needed",
    ),
    "too many wavelengths": (
        ("= 1.1", "= 19"),
        "`transducer`: a bowl of outer_diameter_mm 64 at frequency_mhz 19 is 17 times as many wavelengths wide",
    ),
    "focus in front of the liver": (
        ("thickness_mm = 20.6", "thickness_mm = 60.6"),
        "the focus at focal_length_mm 62.6 must lie 1 mm or more inside the liver, which the layers put at 82.6 to",
    ),
    "focus behind the liver": (
        ("thickness_mm = 40.0", "thickness_mm = 10.0"),
        "which the layers put at 42.6 to 52.6 mm",
    ),
    "focus on the liver's front": (
        ("thickness_mm = 20.6", "thickness_mm = 40.55"),
        "must lie 1 mm or more inside the liver",
    ),
    "liver not last": (('"liver"', '"muscle"'), "layers must end with the only layer of liver"),
    "two livers": (('"muscle"', '"liver"'), "got water, skin, fat, liver, liver"),
}


@pytest.mark.parametrize(("replacement", "message"), WRONG.values(), ids=WRONG.keys())
def test_wrong_values_are_refused_by_key(tmp_path, replacement, message):
    assert message in refusal(write(tmp_path, changed(replacement)))


def test_layers_that_make_no_path(tmp_path):
    start, stop = GOOD.index("[[layers]]"), GOOD.index("[mechanics]")
    liver = '[[layers]]\ntissue = "liver"\nthickness_mm = 90.0\n'
    only = refusal(write(tmp_path, GOOD[:start] + liver + GOOD[stop:]))
    assert "layers must end with the only layer of liver, after at least one other, got liver" in only
    assert "missing key `layers`" in refusal(write(tmp_path, GOOD[:start] + GOOD[stop:]))
    one_table = GOOD[:start] + liver.replace("[[layers]]", "[layers]") + GOOD[stop:]
    assert "`layers`: expected a list, got {" in refusal(write(tmp_path, one_table))


def test_the_first_layer_must_hold_the_bowl(tmp_path):
    shorter = (("thickness_mm = 20.6", "thickness_mm = 11.9"), ("thickness_mm = 40.0", "thickness_mm = 48.7"))
    message = refusal(write(tmp_path, changed(*shorter)))
    assert "the first layer must hold the bowl" in message and "must exceed 12, past the rim, got 11.9" in message


def test_what_is_accepted_can_be_discretised(tmp_path):
    random = np.random.default_rng(3)
    accepted = 0
    for _ in range(60):
        focal, first, skin = random.uniform(20.0, 150.0), random.uniform(5.0, 60.0), 0.2 * random.uniform(1.0, 10.0)
        path = write(
            tmp_path,
            changed(
                ("= 64.0", f"= {2.0 * focal * random.uniform(0.2, 1.0)}"),
                ("inner_diameter_mm = 20.0", "inner_diameter_mm = 5.0"),
                (FOCAL, f"focal_length_mm = {focal}"),
                ("= 1.1", f"= {random.uniform(0.05, 2.0)}"),
                ("thickness_mm = 20.6", f"thickness_mm = {first}"),
                ("thickness_mm = 2.0", f"thickness_mm = {skin}"),
                ("thickness_mm = 40.0", "thickness_mm = 60.0"),
            ),
        )
        try:
            described = read_experiment(path)
        except InputError:
            continue
        settings = discretise(described.model())
        assert settings.march.start_plane < min(first * 1e-3, settings.heat_grid.z[0], settings.mesh.z_edges[0])
        accepted += 1
    assert accepted > 5


def test_files_that_are_no_experiment(tmp_path):
    for content, message in (
        ("", "the file is empty"),
        (b"\x00\x01\xff\xfe", "is not UTF-8 text (byte 2)"),
        (b"PK\x03\x04", "not valid TOML"),
        (GOOD.encode("utf-16"), "is not UTF-8 text"),
        (
            GOOD.replace(" = ", " "),
            "not valid TOML: Expected '=' after a key in a key/value pair (at line 3, column 7)",
        ),
        (GOOD[: GOOD.index("64.0") - 1], "not valid TOML"),
        (changed(("[transducer]", "[transducer")), "not valid TOML"),
        ("a = " + "[" * 5000, "not valid TOML"),
        ("a = " + "9" * 5000, "not valid TOML"),
        ("frequency_hz,temperature_c\n1,37\n", "not valid TOML"),
    ):
        refused = refusal(write(tmp_path, content))
        assert message in refused and "expected an experiment in TOML" in refused
    for path, message in (
        (tmp_path / "absent.toml", "no such file"),
        (tmp_path, "is a folder"),
        (tmp_path / "experiment.toml" / "below", "cannot be read (Not a directory)"),
    ):
        assert message in refusal(path)


def test_damaged_files_are_read_or_refused_in_one_line(tmp_path):
    refused = 0
    for damaged in mutations(EXAMPLE.read_bytes(), seed=4, count=300):
        path = write(tmp_path, damaged)
        try:
            read_experiment(path).model()
        except InputError as error:
            refused += 1
            assert re.match(re.escape(f"{path}: ") + r"[^\n\r\x1b]+\Z", str(error))
    assert refused > 100
