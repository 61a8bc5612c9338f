"""What the full simulation says about the paper: each number of the report, within what the discretisation leaves."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import read_experiment, suomi2016
from inverse import reproduction
from inverse.datasets.hmi import read_hmi
from inverse.datasets.shipped import shipped
from inverse.reproduction import GAUSSIAN, TEMPERATURES, Bench, Case, beam_size, reading

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def described():
    return read_experiment(shipped("suomi2016_experiment"))


@pytest.fixture(scope="module")
def bench(described):
    return Bench.of(described)


@pytest.fixture(scope="module")
def power(bench):
    """At which fresh liver moves by 9 um [W]."""
    first = jnp.vdot(bench.response(Case(), 35.0), bench.linear(35.0).force)
    return float(bench.model.drive.acoustic_power) * 9e-6 / float(first)


def read(bench, forces, case):
    return reading("", case, {t: bench.response(case, t) for t in TEMPERATURES}, forces)


@pytest.fixture(scope="module")
def gaussian(bench):
    mesh, focus = bench.settings.mesh, bench.settings.focus
    return {t: GAUSSIAN.force_density(bench.model, jnp.asarray(t), mesh=mesh, focus=focus) for t in TEMPERATURES}


@pytest.fixture(scope="module")
def linear(bench):
    return {t: bench.linear(t).force for t in TEMPERATURES}


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        # By another finite-element code, rounded to a point.
        (Case(liver="1.1 Pa"), (96.0, 95.0, 98.0, 105.0, 101.0, 84.0, 67.0)),
        (Case(edge="sharp", liver="1.1 Pa"), (96.0, 95.0, 98.0, 105.0, 98.0, 77.0, 60.0)),
        (Case(modulus="constrained"), (96.0, 95.0, 98.0, 105.0, 115.0, 130.0, 148.0)),
    ],
    ids=["literal", "uniform lesion", "constrained modulus"],
)
def test_literal_sequence_with_a_gaussian_beam(bench, gaussian, case, expected):
    """The other code's lesion is uniform up to its surface; here it falls within 0.2 mm, which is what 6 points are."""
    atol = 7.0 if case.edge == "sharp" else 1.0
    np.testing.assert_allclose(read(bench, gaussian, case).percent[1:], expected, atol=atol)


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        (Case(liver="1.1 Pa"), (108.0, 103.0, 94.0)),
        (Case("semi-axes", liver="1.1 Pa"), (91.0, 67.0, 52.0)),
    ],
    ids=["lengths", "semi-axes"],
)
def test_readings_in_the_true_field(bench, linear, case, expected):
    """Another code's percentages at 60, 65 and 70 degC, its field in homogeneous liver: one point and its rounding."""
    np.testing.assert_allclose(read(bench, linear, case).percent[5:], expected, atol=1.5)


def test_what_the_default_gives(bench, linear):
    """Above 60 degC neither lesion gives the text's 85 and 49 percent; below, attenuation alone gives its curve."""
    np.testing.assert_allclose(read(bench, linear, Case()).percent[4:], (104.9, 108.8, 104.1, 95.4), atol=0.4)
    np.testing.assert_allclose(read(bench, linear, Case("dose")).percent[4:], (104.9, 96.4, 80.0, 60.3), atol=0.4)


def test_the_reading_that_comes_nearest(bench, power):
    """Harmonics at the power of 9 um, the table's numbers as semi-axes, liver's M_0 as printed."""
    forces = {t: bench.nonlinear(t, power).force for t in TEMPERATURES}
    nearest = read(bench, forces, Case("semi-axes", liver="1.1 Pa"))
    np.testing.assert_allclose(nearest.percent[1:], (96.3, 95.2, 97.8, 104.8, 87.1, 63.1, 49.8), atol=0.5)
    assert nearest.misfit < 1.4
    assert float(bench.nonlinear(35.0, power).error) < 2e-3


def test_the_lesion_appears_early(bench):
    """Item 9: a constant power heats fast at first, so 240 min come at 53 degC, not at 55.5 as on a ramp, nor at 60."""
    time, temperature = reproduction.lethal_moment(bench.heating)
    assert temperature == pytest.approx(53.4, abs=0.3) and 6.0 < time < 9.0
    assert float(bench.size("dose", 55.0).length) > 3e-3


def test_lesions_by_dose_are_twice_as_large(bench):
    sizes = reproduction.sizes_by_dose(bench)
    for temperature, column in suomi2016.TABLE_3_LESION.items():
        ratio = np.asarray([1e3 * sizes[temperature].length / column.length_mm])
        assert 1.8 < ratio[0] < 2.5
    with_harmonics = reproduction.sizes_by_dose(bench, nonlinear=True)
    for temperature, size in sizes.items():
        assert float(with_harmonics[temperature].length) == pytest.approx(float(size.length), rel=0.01)


def test_the_beam_is_wider_than_the_lesion(bench, power):
    """Item 10: 1.7 x 11.8 mm in the layers, which the lesion of 65 degC (1.2 x 5 mm) does not exceed."""
    sizes = reproduction.beam_sizes(bench, power)
    assert 1e3 * sizes["linear"].width == pytest.approx(1.73, abs=0.02)
    assert 1e3 * sizes["linear"].length == pytest.approx(11.8, abs=0.1)
    narrowest = min(sizes.values(), key=lambda size: size.width)
    assert 1.2e-3 < narrowest.width < sizes["linear"].width


def test_size_of_a_gaussian_beam():
    r, z = np.linspace(0.0, 3e-3, 61), np.linspace(-9e-3, 9e-3, 121)
    found = beam_size(r, z, np.exp(-((r[:, None] / GAUSSIAN.radius) ** 2) - (z[None, :] / GAUSSIAN.length) ** 2))
    np.testing.assert_allclose(found, (1.4e-3, 9e-3), rtol=2e-3)


@pytest.fixture(scope="module")
def varied(bench):
    return reproduction.lesion_variations(bench, "table")


def test_attenuation_of_the_lesion_is_not_negligible(varied):
    """Item 10: 20 points where the paper says less than 0.1 percent; the path through the lesion makes under one."""
    largest = reproduction.largest
    assert abs(largest(varied, "attenuation", 70.0).points) == pytest.approx(20.3, abs=0.3)
    assert abs(largest(varied, "attenuation, force only", 70.0).points) == pytest.approx(20.9, abs=0.3)
    assert abs(largest(varied, "attenuation, path only", 70.0).points) == pytest.approx(0.75, abs=0.15)
    assert abs(largest(varied, "attenuation, linear edge", 70.0).points) == pytest.approx(7.6, abs=0.3)


def test_modulus_of_the_lesion_makes_two_points(varied):
    assert abs(reproduction.largest(varied, "modulus", 70.0).points) == pytest.approx(2.5, abs=0.2)
    assert abs(reproduction.largest(varied, "modulus", 60.0).points) < 0.7


def test_sound_speed_and_exponent_of_the_lesion(varied):
    assert abs(reproduction.largest(varied, "sound speed").points) == pytest.approx(3.2, abs=0.3)
    assert abs(reproduction.largest(varied, "exponent").points) == pytest.approx(1.94, abs=0.1)


def test_exponent_acts_as_attenuation_does(varied):
    """1.1^(n / 4) at 1.1 MHz is 2.41 percent of attenuation: the same slope."""
    (exponent,) = (each for each in varied if each.what == "exponent" and each.change > 0 and each.temperature == 70.0)
    (quarter,) = (
        each for each in varied if each.what == "attenuation" and each.change > 0 and each.temperature == 70.0
    )
    assert exponent.points == pytest.approx(quarter.points * (1.1**0.25 - 1.0) / 0.25, rel=0.01)


def test_no_variation_is_no_change(bench):
    r, z = np.zeros((60, 120)), np.zeros((60, 120))
    same = bench.varied_force(65.0, r, z)
    assert float(jnp.max(jnp.abs(same - bench.linear(65.0).force))) < 1e-5 * float(jnp.max(same))


def test_run_equals_its_responses(bench, linear):
    """The stored protocol, push by push, against responses: to rounding."""
    run = bench.run("table")
    here = np.asarray(run.displacement) / float(run.displacement[0])
    np.testing.assert_allclose(100.0 * here, read(bench, linear, Case()).percent, rtol=1e-8)


def test_second_study(bench):
    """Coarse in both axes; between points it is within 1 percent of a push there."""
    study = reproduction.run_second_study(bench.model, bench.protocol, bench.coarse, points=(31, 25))
    # The literature's factors, 4 and 8, at 5 kPa; 9 to 6 um lies inside what assumed averages give.
    assert study.ratio(5.0, 4.0) == pytest.approx(1.04, abs=0.02)
    assert study.ratio(5.0, 8.0) == pytest.approx(0.67, abs=0.02)
    assert study.ratio(10.0, 4.0) == pytest.approx(0.80, abs=0.02)
    assert study.ratio(10.0, 8.0) == pytest.approx(0.505, abs=0.02)
    assert study.factor_for(6.0 / 9.0, 10.0) == pytest.approx(5.2, abs=0.2)
    assert study.power_for(9e-6, 10.0) == pytest.approx(112.5, rel=0.02)
    assert study.dataset()["displacement_per_watt"].shape == (31, 25)


def test_relaxed_modulus_matters_in_soft_liver(bench):
    """M_0 of table 2 changes the displacement at 5 kPa, which the paper denies, and tau does not."""
    soft, stiff = (reproduction.insensitivity(bench, modulus) for modulus in (5.0, 155.0))
    assert -12.0 < soft["M_0"] < -3.0
    assert abs(stiff["M_0"]) < 1.0
    # Of a branch that relaxes in 34.5 ms 1.4 percent are gone after 0.5 ms; that much only where stiffness rules.
    assert abs(soft["tau"]) < 0.1 and 0.3 < abs(stiff["tau"]) < 0.7


def test_measured_values_beside_both_protocols(bench):
    """Up to 70 degC there are eight; without harmonic motion's curve falling, pushes alone fall."""
    measured = read_hmi(shipped("suomi2016_hmi"))
    steady = dict(zip(TEMPERATURES, 100.0 * np.ones(len(TEMPERATURES)), strict=True))
    rows = reproduction.measured_rows(measured, bench.run("dose"), steady)
    assert len(rows) == 2 * 8
    assert all(row.here == pytest.approx(100.0) for row in rows if row.quantity.endswith("50 Hz"))
    assert dataclasses.replace(rows[0], paper=rows[0].here).verdict == "agrees"
