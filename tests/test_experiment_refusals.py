"""Experiment files that are refused, in one line that names the key."""

import re

import pytest

from arfjax import InputError, read_experiment
from tests.experiment_files import BY_DOSE, EXAMPLE, FOCAL, GOOD, TEMPERATURES, acoustics, changed, refusal, write
from tests.mutations import mutations

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
    "too few harmonics": (acoustics("harmonics = 2"), "`acoustics.harmonics`: expected 5 to 1024 harmonics, got 2"),
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
    "an artefact of nothing": (
        ("time_constant_s = 0.2", "viscous_time_constant_s = 2.0"),
        "viscous_time_constant_s 2 has no effect without viscous_fraction",
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


def test_a_thermocouple_lies_where_heat_is_followed(tmp_path):
    """It was refused only after the sonication, by a line that named no key of the file."""
    thin = changed(("time_constant_s = 0.2", "axial_offset_mm = 4.0"), ("thickness_mm = 40.0", "thickness_mm = 22.5"))
    said = refusal(write(tmp_path, thin))
    assert "sonication.thermocouple reaches from 66.475 to 66.725 mm" in said and "axial_offset_mm" in said


@pytest.mark.parametrize("line", ['heat_constants = "warming"', "coagulation_doubles_attenuation = true"])
def test_water_is_no_tissue(tmp_path, line):
    assert f"{line.split()[0]} is of tissue" in refusal(
        write(tmp_path, changed(('tissue = "water"', f'tissue = "water"\n{line}')))
    )


def test_linear_sound_does_not_steepen(tmp_path):
    text = changed(acoustics('nonlinear = false\nsteepening = "along-axis"'))
    assert "linear sound does not steepen" in refusal(write(tmp_path, text))
