"""The drive for a peak that was measured in water: it makes that peak, and its derivative is that of the march."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.amplitude import _top, drive_for_peak_pressure
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.waveform import peak_pressures
from arfjax.errors import InputError
from arfjax.exact.oneil import axial_pressure
from arfjax.media import AcousticMedium
from arfjax.transducer import FocusedBowl, PressureDrive
from tests.checks import assert_gradient

BOWL = FocusedBowl(aperture_radius=32e-3, hole_radius=10e-3, focal_length=62.6e-3)
WATER = AcousticMedium(1000.0, 1482.0, 0.025, 2.0, 5.0)
NEAR_FOCUS = np.linspace(59e-3, 65e-3, 25)
STEEP = MarchSettings(n_harmonics=8, n_radial=160, axial_step=0.6e-3)


def test_linear_sound_is_scaled_by_oneils_gain():
    lossless = AcousticMedium(1000.0, 1482.0, 0.0, 2.0, 5.0)
    linear = MarchSettings(n_radial=144)
    drive = drive_for_peak_pressure(
        BOWL, frequency=1.1e6, peak_pressure=5e6, medium=lossless, z=NEAR_FOCUS, settings=linear
    )
    z = np.linspace(61e-3, 63e-3, 201)
    gain = np.abs(axial_pressure(BOWL, z, wavenumber=2.0 * np.pi * 1.1e6 / 1482.0, source_pressure=1.0)).max()
    np.testing.assert_allclose(drive.pressure, 5e6 / gain, rtol=2e-4)


@eqx.filter_jit
def driven(peak, speed):
    medium = AcousticMedium(1000.0, speed, 0.025, 2.0, 5.0)
    return drive_for_peak_pressure(
        BOWL, frequency=1.1e6, peak_pressure=peak, medium=medium, z=NEAR_FOCUS, settings=STEEP
    ).pressure


def test_steepened_sound_has_the_peak_that_was_asked_for():
    pressure = driven(8e6, 1482.0)
    z = np.linspace(60e-3, 64e-3, 81)
    solve = eqx.filter_jit(
        lambda drive: solve_field(BOWL, drive, [AcousticLayer(WATER, 0.07)], r=np.zeros(1), z=z, settings=STEEP)
    )
    highest = np.max(peak_pressures(solve(PressureDrive(1.1e6, pressure)))[0])
    np.testing.assert_allclose(highest, 8e6, rtol=1e-3)  # of which the parabola over 0.25 mm is a part
    assert pressure < 0.95 * 8e6 / 37.4  # steepening raises the crest


@pytest.mark.slow
def test_gradient_of_the_drive():
    assert_gradient(lambda values: 1e-5 * driven(values["peak"], values["speed"]), {"peak": 8e6, "speed": 1482.0})


def test_a_peak_that_cannot_be_found_is_not_a_number():
    assert jnp.isnan(driven(jnp.nan, 1482.0))


@pytest.mark.parametrize("z", [np.array([60e-3, 62e-3]), np.array([60e-3, 61e-3, 63e-3])])
def test_positions_that_make_no_parabola_are_refused(z):
    with pytest.raises(InputError, match="three or more evenly spaced"):
        drive_for_peak_pressure(BOWL, frequency=1.1e6, peak_pressure=5e6, medium=WATER, z=z)


@pytest.mark.parametrize("top", [2.0, 2.3, 1.6])
def test_between_positions_the_peak_is_that_of_the_parabola(top):
    parabola = 5.0 - 0.7 * (jnp.arange(5.0) - top) ** 2
    np.testing.assert_allclose(_top(parabola), 5.0, rtol=1e-14)


def test_a_peak_at_the_end_of_the_positions_is_no_peak():
    np.testing.assert_allclose(_top(jnp.asarray([1.0, 3.0, 3.5, 3.0])), 3.5)
    assert jnp.isnan(_top(jnp.asarray([1.0, 2.0, 4.0, 9.0]))) and jnp.isnan(_top(jnp.asarray([9.0, 4.0, 1.0])))
