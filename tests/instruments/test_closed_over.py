"""Axes and settings that are not traced are looked at under transformations too, arrays of jax among them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.instruments.heating_curve import normalised_covariance, normalised_curve
from arfjax.instruments.mr_thermometry import MagneticResonanceThermometer
from arfjax.instruments.speckle_tracking import SpeckleTracker
from arfjax.instruments.thermocouple import Thermocouple
from arfjax.thermal.bioheat import TemperatureHistory

R, Z = jnp.linspace(0.0, 12e-3, 60), jnp.linspace(0.04, 0.08, 100)
MAP = jnp.exp(-((R[:, None] / 3e-3) ** 2) - ((Z[None, :] - 0.06) / 5e-3) ** 2)
TEMPERATURE, CURVE = jnp.asarray([30.0, 40.0, 50.0, 60.0]), jnp.asarray([2.0, 3.0, 4.0, 3.5])
GRID = AxisymmetricGrid(np.linspace(0.0, 10e-3, 41), np.linspace(0.05, 0.07, 81))
TIME = jnp.linspace(0.0, 10.0, 11)
RISE = TIME[:, None, None] * jnp.exp(-((jnp.asarray(GRID.r)[None, :, None] / 3e-3) ** 2)) * jnp.ones((1, 1, 80))
FRAMES, LATE = jnp.asarray([5.0]), jnp.asarray([5.0, 30.0])
FOCUS, WIDE, WARM, HOT = (jnp.asarray(value) for value in (0.06, 30e-3, 44.0, 70.0))
FALLING = Z[::-1]


def tracked(motion, **settings):
    return SpeckleTracker(**({"lateral_width": 0.5e-3} | settings))(motion, R, Z, z=FOCUS)


def by_mr(rise, frames=FRAMES, **settings):
    sides = {"width": 3e-3, "height": 3e-3, "length": 3e-3} | settings
    history = TemperatureHistory(TIME, 37.0 + rise)
    return MagneticResonanceThermometer(**sides)(history, GRID, z=FOCUS, frame_times=frames)


def by_wire(rise, **settings):
    return Thermocouple(**settings)(TemperatureHistory(TIME, 37.0 + rise), GRID, z=FOCUS)


READ = {
    "tracking": (tracked, MAP),
    "curve": (lambda curve: normalised_curve(TEMPERATURE, curve, reference_temperature=WARM), CURVE),
    "covariance": (
        lambda curve: normalised_covariance(TEMPERATURE, curve, jnp.eye(4), reference_temperature=44.0), CURVE
    ),
    "magnetic resonance": (by_mr, RISE),
    "thermocouple": (by_wire, RISE),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_what_is_read_is_the_same_under_transformations(name):
    reader, values = READ[name]
    alone = reader(values)
    np.testing.assert_allclose(jax.jit(reader)(values), alone, rtol=1e-12)
    np.testing.assert_allclose(jax.lax.map(reader, values[None])[0], alone, rtol=1e-12)


WRONG = {
    "a beam beside the map": (lambda motion: tracked(motion, lateral_width=WIDE), MAP),
    "an axis that falls": (lambda motion: SpeckleTracker()(motion, R, FALLING, z=0.06), MAP),
    "a reference beside the curve": (
        lambda curve: normalised_curve(TEMPERATURE, curve, reference_temperature=HOT), CURVE
    ),
    "a voxel larger than the grid": (lambda rise: by_mr(rise, width=WIDE, height=30e-3), RISE),
    "a frame after the end": (lambda rise: by_mr(rise, frames=LATE, acquisition_time=4.0), RISE),
    "a bead beside the grid": (lambda rise: by_wire(rise, radial_offset=WIDE), RISE),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_read_is_refused_under_transformations(name):
    reader, values = WRONG[name]
    for transformed in (reader, jax.jit(reader)):
        with pytest.raises(InputError):
            transformed(values)


@pytest.mark.parametrize(("power", "said"), [(np.ones(11), "shape"), (-1.0, "not below 0")])
def test_power_of_a_thermocouple_is_one_or_one_an_interval(power, said):
    couple = Thermocouple(viscous_fraction=0.5, viscous_time_constant=1.0)
    history = TemperatureHistory(TIME, 37.0 + RISE)
    with pytest.raises(InputError, match=f"`power`.* {said}"):
        couple(history, GRID, z=0.06, heat=RISE[0], power=power, heat_capacity=4e6)
