"""Power through a plane: of the true bowl, along a march, and of one component in closed form."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from arfjax.acoustics.power import plane_wave_power, power_budget, power_through_plane
from arfjax.acoustics.sources.radiating_bowl import RadiatingBowl
from arfjax.transducer import Drive
from tests.acoustics.sources.problems import (
    BASIS,
    BOWL,
    DENSITY,
    FREQUENCY,
    IMPEDANCE,
    SOUND_SPEED,
    WAVENUMBER,
    axial_wavenumber,
    series,
)
from tests.acoustics.test_waveform import field_of


def test_the_bowl_sends_out_what_its_drive_says():
    # 1.1 per mille less on a disc of 62 mm, 12 mm from the apex; 0.9 on one of 200 mm.
    amplitude = Drive(FREQUENCY, 50.0).source_pressure(RadiatingBowl(BOWL), IMPEDANCE) * series(RadiatingBowl(BOWL))
    power = power_through_plane(amplitude[None], axial_wavenumber(), BASIS, DENSITY, jnp.asarray([FREQUENCY]))
    np.testing.assert_allclose(power, 50.0, rtol=3e-3)


def test_one_component_carries_its_cosine():
    # Intensity of a plane wave times the cosine, over the disc's mean of J0 squared.
    mode = 60
    amplitude = np.zeros((2, len(BASIS.norms)), complex)
    amplitude[:, mode] = 3.0j
    frequency = jnp.asarray([FREQUENCY, 2.0 * FREQUENCY])
    wavenumber = 2.0 * np.pi * frequency / SOUND_SPEED
    axial = jnp.sqrt(wavenumber[:, None] ** 2 - BASIS.wavenumbers[None, :] ** 2 + 0j)
    power = power_through_plane(jnp.asarray(amplitude), axial, BASIS, DENSITY, frequency)
    cosine = np.sqrt(1.0 - (BASIS.wavenumbers[mode] / np.asarray(wavenumber)) ** 2)
    upright = plane_wave_power(jnp.asarray(amplitude), BASIS, IMPEDANCE)
    np.testing.assert_allclose(upright, 9.0 / (2.0 * IMPEDANCE) * 2.0 * np.pi * BASIS.norms[mode], rtol=1e-12)
    np.testing.assert_allclose(power, upright * cosine, rtol=1e-12)


def test_components_beyond_grazing_carry_nothing():
    amplitude = np.where(BASIS.wavenumbers > 1.001 * WAVENUMBER, 1.0 + 0j, 0.0)[None, :]
    frequency = jnp.asarray([FREQUENCY])
    power = power_through_plane(jnp.asarray(amplitude), axial_wavenumber(), BASIS, DENSITY, frequency)
    assert power[0] < 1e-8 * plane_wave_power(jnp.asarray(amplitude), BASIS, IMPEDANCE)[0]


def test_every_watt_is_accounted_for():
    field = dataclasses.replace(
        field_of(np.ones((1, 1, 1))), layer_power=jnp.asarray([[50.0, 48.0], [47.5, 40.0], [39.0, 12.0]])
    )
    budget = power_budget(field)
    np.testing.assert_allclose(budget.entering, [50.0, 47.5, 39.0])
    np.testing.assert_allclose(budget.leaving, [48.0, 40.0, 12.0])
    np.testing.assert_allclose(budget.reflected, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(budget.lost, [2.0, 7.5, 27.0])
