"""The flat piston against its closed form on the axis and direct quadrature off it."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.power import power_through_plane
from arfjax.acoustics.sources.apodisation import Apodisation
from arfjax.acoustics.sources.piston import Piston
from arfjax.errors import InputError
from arfjax.exact.piston import axial_pressure
from arfjax.transducer import Drive
from tests.acoustics.sources.problems import (
    BASIS,
    COMPLEX_WAVENUMBER,
    DENSITY,
    FREQUENCY,
    IMPEDANCE,
    WAVENUMBER,
    axial_wavenumber,
    marched,
    rayleigh,
    series,
)
from tests.checks import assert_gradient_of_each_leaf

RADIUS, HOLE = 15e-3, 4e-3


@pytest.mark.parametrize("hole", [0.0, HOLE])
@pytest.mark.parametrize("attenuation", [0.0, 8.0])
def test_axis_is_the_closed_form(hole, attenuation):
    wavenumber = WAVENUMBER - 1j * attenuation
    z = np.array([3e-3, 10e-3, 40e-3, 76e-3])
    source, wanted = Piston(RADIUS, hole), np.zeros(1)
    pressure = [source.pressure_on_plane(1.0, jnp.asarray(wavenumber), wanted, plane)[0] for plane in z.tolist()]
    exact = axial_pressure(z, radius=RADIUS, wavenumber=wavenumber, hole_radius=hole)
    np.testing.assert_allclose(pressure, exact, rtol=0.0, atol=1e-9)


def test_axis_without_loss_is_the_known_sine():
    z = np.linspace(1e-3, 0.1, 50)
    exact = axial_pressure(z, radius=RADIUS, wavenumber=WAVENUMBER, source_pressure=3.0)
    sine = 6.0 * np.abs(np.sin(0.5 * WAVENUMBER * (np.hypot(z, RADIUS) - z)))
    np.testing.assert_allclose(np.abs(exact), sine, atol=1e-11)


def test_off_the_axis_it_is_the_rayleigh_integral():
    radii = np.array([0.0, 5e-3, 15e-3, 30e-3])

    def profile(points):
        ring = HOLE + (RADIUS - HOLE) * points
        return ring, np.zeros_like(ring), np.full_like(ring, RADIUS - HOLE), np.exp(-100j * ring)

    knots = np.array([HOLE, RADIUS])
    source = Piston(RADIUS, HOLE, Apodisation(knots, np.ones(2), -100.0 * knots))
    pressure = source.pressure_on_plane(1.0, COMPLEX_WAVENUMBER, radii, 8e-3)
    direct = [rayleigh(r, 8e-3, WAVENUMBER, profile, n=200) for r in radii]
    np.testing.assert_allclose(pressure, direct, rtol=0.0, atol=1e-9)


def test_march_from_a_plane_follows_the_axis():
    z = np.array([50e-3, 80e-3, 110e-3, RADIUS**2 * WAVENUMBER / (2.0 * np.pi)])
    pressure = marched(series(Piston(RADIUS), plane=10e-3), z - 10e-3, np.zeros(1))[0]
    np.testing.assert_allclose(pressure, axial_pressure(z, radius=RADIUS, wavenumber=WAVENUMBER), rtol=0, atol=0.02)


def test_power_is_that_of_the_area():
    source, drive = Piston(RADIUS, HOLE), Drive(FREQUENCY, 10.0)
    amplitude = drive.source_pressure(source, IMPEDANCE) * series(source, plane=4e-3)
    frequency = jnp.asarray([FREQUENCY])
    power = power_through_plane(amplitude[None], axial_wavenumber(), BASIS, DENSITY, frequency)
    np.testing.assert_allclose(source.area, np.pi * (RADIUS**2 - HOLE**2), rtol=1e-12)
    np.testing.assert_allclose(power, 10.0, rtol=0.01)


def test_gradient_in_radii_and_wavenumber():
    def radiated(parameters):
        radius, hole, wavenumber = parameters
        pressure = Piston(radius, hole).pressure_on_plane(1.0, wavenumber - 2j, np.array([0.0, 7e-3, 20e-3]), 6e-3)
        return jnp.sum(jnp.abs(pressure) ** 2)

    assert_gradient_of_each_leaf(radiated, (RADIUS, HOLE, WAVENUMBER), step=3e-6, reverse=False)


@pytest.mark.parametrize(("radius", "hole"), [(15e-3, 16e-3), (15e-3, -1e-3), (-1e-3, 0.0)])
def test_dimensions_that_are_no_piston_are_refused(radius, hole):
    with pytest.raises(InputError, match="a piston needs"):
        Piston(radius, hole).check()


def test_an_apodisation_that_ends_early_is_refused():
    with pytest.raises(InputError, match="does not cover"):
        Piston(RADIUS, 0.0, Apodisation([0.0, 10e-3], np.ones(2), np.zeros(2))).check()
