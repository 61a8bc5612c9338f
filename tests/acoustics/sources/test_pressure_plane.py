"""A measured plane as source: the bowl's own field there and back, scale, faults in the data, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.sources.pressure_plane import PressurePlane
from arfjax.acoustics.sources.radiating_bowl import RadiatingBowl
from arfjax.errors import InputError
from arfjax.transducer import Drive, PressureDrive
from tests.acoustics.sources.problems import (
    BASIS,
    BOWL,
    COMPLEX_WAVENUMBER,
    FREQUENCY,
    IMPEDANCE,
    marched,
    series,
)
from tests.checks import assert_gradient_of_each_leaf

PLANE = 12e-3
RADII = np.linspace(0.0, 60e-3, 401)


@pytest.fixture(scope="module")
def scan():
    """The bowl's field across the axis, every 0.15 mm, a ninth of a wavelength."""
    return np.asarray(RadiatingBowl(BOWL).pressure_on_plane(1.0, COMPLEX_WAVENUMBER, RADII, PLANE))


@pytest.fixture(scope="module")
def axis():
    return marched(series(RadiatingBowl(BOWL), plane=PLANE), Z - PLANE, np.array([0.0, 0.6e-3]))


Z = np.array([55e-3, 60e-3, 62.1e-3, 65e-3])


def as_measured(source):
    pressure = PressureDrive(FREQUENCY).source_pressure(source, IMPEDANCE)
    return np.asarray(source.series(pressure, COMPLEX_WAVENUMBER, BASIS))


@pytest.mark.parametrize("first", [0, 1])
def test_the_bowls_own_field_there_and_back(scan, axis, first):
    # With the axis among the samples and without.
    source = PressurePlane(RADII[first:], scan[first:], PLANE, taper=0.43)
    field = marched(as_measured(source), Z - PLANE, np.array([0.0, 0.6e-3]))
    np.testing.assert_allclose(field, axis, rtol=0.0, atol=1e-4 * np.abs(axis).max())


def test_coarser_samples_err_as_the_fourth_power(scan, axis):
    errors = []
    for stride in (2, 4):
        source = PressurePlane(RADII[::stride], scan[::stride], PLANE, taper=0.43)
        errors.append(np.abs(marched(as_measured(source), Z - PLANE, np.array([0.0, 0.6e-3])) - axis).max())
    assert errors[0] / np.abs(axis).max() < 2e-3
    assert errors[1] / errors[0] > 8.0


def test_it_samples_what_it_was_given(scan):
    source = PressurePlane(RADII, scan, PLANE, taper=0.2)
    at = np.array([0.0, 3e-3, 30e-3, 61e-3])
    pressure = source.pressure_on_plane(source.peak_pressure, COMPLEX_WAVENUMBER, at, PLANE)
    np.testing.assert_allclose(pressure[:3], scan[[0, 20, 200]], rtol=1e-12)
    assert pressure[3] == 0.0


def test_drives_by_pressure_and_by_power():
    r = np.linspace(0.0, 20e-3, 81)
    source = PressurePlane(r, 7e4 * np.exp(-((r / 6e-3) ** 2)) * np.exp(0.3j), 0.0)
    np.testing.assert_allclose(source.area, 0.5 * np.pi * 6e-3**2, rtol=1e-6)
    np.testing.assert_allclose(PressureDrive(FREQUENCY).source_pressure(source, IMPEDANCE), 7e4, rtol=1e-12)
    assert PressureDrive(FREQUENCY, 2e5).source_pressure(source, IMPEDANCE) == 2e5
    expected = np.sqrt(2.0 * IMPEDANCE * 50.0 / (0.5 * np.pi * 6e-3**2))
    np.testing.assert_allclose(Drive(FREQUENCY, 50.0).source_pressure(source, IMPEDANCE), expected, rtol=1e-6)
    on_axis = source.pressure_on_plane(2e5, COMPLEX_WAVENUMBER, np.zeros(1), 0.0)[0]
    np.testing.assert_allclose(on_axis, 2e5 * np.exp(0.3j), rtol=1e-12)


def test_only_a_measured_source_brings_its_pressure():
    with pytest.raises(InputError, match="needs a pressure"):
        PressureDrive(FREQUENCY).source_pressure(RadiatingBowl(BOWL), IMPEDANCE)


def test_gradient_in_the_data_and_a_batch():
    r = np.linspace(0.0, 20e-3, 41)
    shape = np.exp(-((r / 6e-3) ** 2))

    def total(parameters):
        real, imaginary, source_pressure = parameters
        source = PressurePlane(r, real * shape + 1j * imaginary * shape**2, 0.0)
        coefficients = source.series(source_pressure, COMPLEX_WAVENUMBER, BASIS)
        return jnp.sum(jnp.abs(coefficients) ** 2) + 1e3 * source.area

    assert_gradient_of_each_leaf(total, (0.7, -1.3, 2.0), reverse=False)
    gradient = jax.jit(jax.vmap(jax.grad(lambda real: total((real, 1.0, 2.0)))))(jnp.array([0.5, 0.7]))
    forward = jax.jvp(lambda real: total((real, 1.0, 2.0)), (0.7,), (1.0,))[1]
    np.testing.assert_allclose(gradient[1], forward, rtol=1e-10)


def test_single_precision(scan):
    wanted = PressurePlane(RADII, scan, PLANE, taper=0.4).series(1.0, COMPLEX_WAVENUMBER, BASIS)
    with jax.enable_x64(False):
        source = PressurePlane(RADII, jnp.asarray(scan, dtype=jnp.complex64), PLANE, taper=0.4)
        got = source.series(1.0, COMPLEX_WAVENUMBER.astype("complex64"), BASIS)
        assert got.dtype == jnp.complex64
    assert np.linalg.norm(np.asarray(got) - wanted) < 1e-5 * np.linalg.norm(wanted)


GOOD = np.linspace(0.0, 20e-3, 41)


@pytest.mark.parametrize(
    ("radius", "change", "message"),
    [
        (GOOD, {3: np.nan}, "not finite at 1 radii"),
        (GOOD, {40: 0.5}, "cut off"),
        (GOOD[::-1], {}, "must ascend"),
        (GOOD[:1], {}, "two or more"),
        (1e3 * GOOD, {}, "Millimetres"),
        (5e-3 + GOOD, {}, "begin at the axis"),
        (GOOD[:-1], {}, "41 values for 40"),
        (GOOD, dict.fromkeys(range(41), 0.0), "zero everywhere"),
    ],
)
def test_data_that_cannot_be_meant_are_refused(radius, change, message):
    pressure = np.exp(-((GOOD / 6e-3) ** 2)) + 0j
    for index, value in change.items():
        pressure[index] = value
    with pytest.raises(InputError, match=message):
        PressurePlane(radius, pressure, 0.0)


def test_a_plane_larger_than_the_domain_is_refused():
    r = np.linspace(0.0, 70e-3, 50)
    with pytest.raises(InputError, match="does not fit a domain"):
        PressurePlane(r, np.exp(-((r / 6e-3) ** 2)) + 0j, 0.0).series(1.0, COMPLEX_WAVENUMBER, BASIS)


def test_a_taper_is_a_part_of_the_radius():
    with pytest.raises(InputError, match="from 0 to 1"):
        PressurePlane(GOOD, np.ones(41) + 0j, 0.0, taper=2.0)


def test_traced_radii_to_sample_at_are_refused():
    source = PressurePlane(GOOD, np.exp(-((GOOD / 6e-3) ** 2)) + 0j, 0.0)
    with pytest.raises(InputError, match="concrete radii"):
        jax.jit(lambda r: source.pressure_on_plane(1.0, COMPLEX_WAVENUMBER, r, 0.0))(jnp.zeros(1))
