"""The flat piston against its closed form on the axis and direct quadrature off it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.power import power_through_plane
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.apodisation import Apodisation
from arfjax.acoustics.sources.piston import Piston
from arfjax.errors import InputError
from arfjax.exact.piston import axial_pressure
from arfjax.media import AcousticMedium
from arfjax.numerics.hankel import hankel_basis
from arfjax.transducer import Drive, PressureDrive
from tests.acoustics.sources.problems import (
    BASIS,
    COMPLEX_WAVENUMBER,
    DENSITY,
    FREQUENCY,
    IMPEDANCE,
    RADII,
    SOUND_SPEED,
    WAVENUMBER,
    axial_wavenumber,
    marched,
    rayleigh,
    series,
)

RADIUS, HOLE = 15e-3, 4e-3


@pytest.mark.parametrize("hole", [0.0, HOLE])
@pytest.mark.parametrize("attenuation", [0.0, 8.0])
def test_axis_is_the_closed_form(hole, attenuation):
    wavenumber = WAVENUMBER - 1j * attenuation
    z, source = np.array([3e-3, 10e-3, 40e-3, 76e-3]), Piston(RADIUS, hole)
    pressure = [source.pressure_on_plane(1.0, jnp.asarray(wavenumber), RADII, plane)[0] for plane in z.tolist()]
    exact = axial_pressure(z, radius=RADIUS, wavenumber=wavenumber, hole_radius=hole)
    np.testing.assert_allclose(pressure, exact, rtol=0.0, atol=1e-9)


def test_axis_without_loss_is_the_known_sine():
    z = np.linspace(1e-3, 0.1, 50)
    exact = axial_pressure(z, radius=RADIUS, wavenumber=WAVENUMBER, source_pressure=3.0)
    sine = 6.0 * np.abs(np.sin(0.5 * WAVENUMBER * (np.hypot(z, RADIUS) - z)))
    np.testing.assert_allclose(np.abs(exact), sine, atol=1e-11)


def test_off_the_axis_it_is_the_rayleigh_integral():
    def profile(points):
        ring = HOLE + (RADIUS - HOLE) * points
        return ring, np.zeros_like(ring), np.full_like(ring, RADIUS - HOLE), np.ones_like(ring)

    pressure = Piston(RADIUS, HOLE).pressure_on_plane(1.0, COMPLEX_WAVENUMBER, RADII, 8e-3)
    direct = [rayleigh(r, 8e-3, WAVENUMBER, profile, n=200) for r in RADII]
    np.testing.assert_allclose(pressure, direct, rtol=0.0, atol=1e-9)


def test_apodised_it_radiates_what_its_rings_do():
    halves = Apodisation([0.0, 8e-3, 8e-3, RADIUS], np.array([1.0, 1.0, 0.5, 0.5]), np.array([0.0, 0.0, 1.0, 1.0]))
    source = Piston(RADIUS, 0.0, halves)
    z = np.array([10e-3, 40e-3])
    pressure = [source.pressure_on_plane(1.0, COMPLEX_WAVENUMBER, RADII, plane)[0] for plane in z.tolist()]
    inner = axial_pressure(z, radius=8e-3, wavenumber=WAVENUMBER)
    outer = axial_pressure(z, radius=RADIUS, wavenumber=WAVENUMBER, hole_radius=8e-3)
    np.testing.assert_allclose(pressure, inner + 0.5 * np.exp(1j) * outer, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(source.area, np.pi * (0.75 * 8e-3**2 + 0.25 * RADIUS**2), rtol=1e-12)


def test_march_from_a_plane_follows_the_axis():
    z = np.array([50e-3, 80e-3, 110e-3, RADIUS**2 * WAVENUMBER / (2.0 * np.pi)])
    pressure = marched(series(Piston(RADIUS), plane=10e-3), z - 10e-3, np.zeros(1))[0]
    np.testing.assert_allclose(pressure, axial_pressure(z, radius=RADIUS, wavenumber=WAVENUMBER), rtol=0, atol=0.02)


def test_sound_steepens_from_the_disc_on_as_fubinis_plane_wave():
    """Far before a shock the second harmonic has p g z / 2 of the first's amplitude.

    Three quarters of the way lie before the march. Waves from the rim, whose share falls as 1 / radius, make 2 %.
    """
    water, pressure, z = AcousticMedium(DENSITY, SOUND_SPEED, 0.0, 2.0, 5.0), 1e4, 20e-3
    settings = MarchSettings(n_harmonics=5, n_radial=96, domain_radius=40e-3, axial_step=0.5e-3, start_plane=15e-3)
    basis = hankel_basis(settings.n_radial, settings.domain_radius)
    clean = basis.nodes < settings.sponge_start * settings.domain_radius
    where = {"r": basis.nodes[clean], "z": np.array([z]), "settings": settings}

    @jax.jit
    def harmonics():
        layers = [AcousticLayer(water, 2.0 * z)]
        return solve_field(Piston(RADIUS), PressureDrive(FREQUENCY, pressure), layers, **where).pressure[:2, :, 0]

    first, second = np.sqrt(np.abs(harmonics()) ** 2 @ basis.weights[clean])
    rate = 2.0 * np.pi * FREQUENCY * 3.5 / (DENSITY * SOUND_SPEED**3)
    np.testing.assert_allclose(second / first, 0.5 * pressure * rate * z, rtol=0.03)


def test_power_is_that_of_the_area():
    source, drive = Piston(RADIUS, HOLE), Drive(FREQUENCY, 10.0)
    amplitude = drive.source_pressure(source, IMPEDANCE) * series(source, plane=4e-3)
    frequency = jnp.asarray([FREQUENCY])
    power = power_through_plane(amplitude[None], axial_wavenumber(), BASIS, DENSITY, frequency)
    np.testing.assert_allclose(source.area, np.pi * (RADIUS**2 - HOLE**2), rtol=1e-12)
    np.testing.assert_allclose(power, 10.0, rtol=0.01)


def test_gradient_in_radii_and_wavenumber():
    # Forward mode only: what reverse mode goes through is the bowl's too.
    def radiated(parameters):
        radius, hole, wavenumber = parameters
        pressure = Piston(radius, hole).pressure_on_plane(1.0, wavenumber - 2j, np.array([0.0, 7e-3, 20e-3]), 6e-3)
        return jnp.sum(jnp.abs(pressure) ** 2)

    at = jnp.array([RADIUS, HOLE, WAVENUMBER])
    both = jax.jit(lambda x, direction: jax.jvp(radiated, (tuple(x),), (tuple(direction),)))
    for direction in jnp.diag(at):
        value = [float(both(at + length * direction, direction)[0]) for length in (-6e-6, -3e-6, 3e-6, 6e-6)]
        central = (value[0] - 8.0 * value[1] + 8.0 * value[2] - value[3]) / 36e-6
        np.testing.assert_allclose(both(at, direction)[1], central, rtol=1e-6)


@pytest.mark.parametrize(("radius", "hole"), [(15e-3, 16e-3), (15e-3, -1e-3), (-1e-3, 0.0)])
def test_dimensions_that_are_no_piston_are_refused(radius, hole):
    with pytest.raises(InputError, match="a piston needs"):
        Piston(radius, hole).check()


def test_an_apodisation_that_ends_early_is_refused():
    with pytest.raises(InputError, match="does not cover"):
        Piston(RADIUS, 0.0, Apodisation([0.0, 10e-3], np.ones(2), np.zeros(2))).check()
