"""Experiment files: the example in SI units, choices and defaults; what is accepted can be discretised."""

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
from arfjax.exact.oneil import axial_pressure
from arfjax.mechanics.elements.mesh import Walls
from arfjax.mechanics.material.viscoelastic import ConstrainedModulus
from arfjax.model import DamageEdge
from inverse.datasets.shipped import shipped
from tests.experiment_files import BY_DOSE, EXAMPLE, FOCAL, acoustics, changed, write


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


def test_a_focal_pressure_of_a_bowl_that_hardly_focuses(tmp_path):
    """By O'Neil, whose highest pressure lies at 34.5 mm, of a radius of curvature of 62.6 mm."""
    text = changed(
        ("acoustic_power_w = 50.0", "focal_pressure_mpa = 0.01"),
        ("outer_diameter_mm = 64.0", "outer_diameter_mm = 20.0"),
        ("inner_diameter_mm = 20.0", "inner_diameter_mm = 0.0"),
        ("frequency_mhz = 1.1", "frequency_mhz = 0.8"),
        acoustics("nonlinear = false"),
    )
    model = read_experiment(write(tmp_path, text)).model()
    water = model.path[0].tissue.acoustic(35.0)
    source = float(model.drive.source_pressure(model.bowl, water.density * water.sound_speed))
    z, wavenumber = np.linspace(20e-3, 70e-3, 2001), 2.0 * np.pi * 0.8e6 / float(water.sound_speed)
    pressure = np.abs(axial_pressure(model.bowl, z, wavenumber=wavenumber, source_pressure=source))
    assert z[pressure.argmax()] == pytest.approx(34.5e-3, abs=0.5e-3)
    assert pressure.max() == pytest.approx(1e4, rel=1e-2)
    unfocused = text.replace("outer_diameter_mm = 20.0", "outer_diameter_mm = 5.0")
    with pytest.raises(InputError, match="which is no focus; give acoustic_power_w"):
        read_experiment(write(tmp_path, unfocused)).model()


@pytest.mark.slow
def test_a_focal_pressure_of_steepened_sound_takes_less_power(tmp_path):
    text = changed(("acoustic_power_w = 50.0", "focal_pressure_mpa = 8.1229"), acoustics("tolerance = 0.01"))
    described = read_experiment(write(tmp_path, text))
    power = described.model().drive.acoustic_power
    assert 25.0 < power < 45.0 and described.model().drive.acoustic_power == power


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
