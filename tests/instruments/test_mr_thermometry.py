"""Magnetic-resonance thermometry against closed forms: means over boxes and frames, and its noise."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.instruments.mr_thermometry import (
    MagneticResonanceThermometer,
    frame_means,
    slice_across_beam,
    slice_along_beam,
)
from arfjax.instruments.thermocouple import Thermocouple
from arfjax.thermal.bioheat import TemperatureHistory
from tests.checks import assert_gradient, assert_order
from tests.instruments.problems import (
    FOCUS,
    HALF_LENGTH,
    RADIUS,
    gaussian,
    gaussian_mean,
    grid,
    history_of,
    on_cells,
)

GRID = grid(20)
FLAT = jnp.ones(GRID.shape)
TIMES = np.asarray([0.0, 0.1, 0.35, 0.6, 1.5, 1.6, 3.0])
NOW = {"z": FOCUS, "frame_times": np.asarray([1.0])}


def still(shape):
    return history_of([0.0, 2.0], [1.0, 1.0], shape)


def exact_gaussian(voxel):
    across = gaussian_mean(float(voxel.lateral_offset), voxel.width, RADIUS) * gaussian_mean(0.0, voxel.height, RADIUS)
    return across * gaussian_mean(FOCUS + float(voxel.axial_offset) - 0.06, voxel.length, HALF_LENGTH)


@pytest.mark.parametrize(
    "voxel",
    [
        slice_across_beam(lateral=1.0e-3, other_lateral=1.5e-3, thickness=5e-3),
        slice_along_beam(lateral=1.0e-3, axial=1.5e-3, thickness=5e-3, lateral_offset=0.9e-3, axial_offset=-0.3e-3),
        slice_along_beam(lateral=1e-6, axial=1e-6, thickness=1e-6),
    ],
)
def test_gaussian_over_a_box_to_fourth_order(voxel):
    errors, spacings = [], []
    for n in (12, 18, 27, 40):
        where = grid(n)
        got = voxel(still(on_cells(gaussian, where)), where, **NOW)[0] - 37.0
        errors.append(abs(float(got) - exact_gaussian(voxel)))
        spacings.append(1.0 / n)
    assert errors[-1] < 1e-5
    assert_order(spacings, errors, order=4.0, slack=0.6)


def test_quadratic_over_a_box_is_exact():
    voxel = MagneticResonanceThermometer(1.2e-3, 2.0e-3, 3.0e-3, lateral_offset=-0.5e-3, axial_offset=0.25e-3)
    shape = on_cells(lambda r, z: 2e6 * r**2 - 3e6 * (z - FOCUS) ** 2 + 1e3 * (z - FOCUS), GRID)
    across = 2e6 * (0.5e-3**2 + 1.2e-3**2 / 12.0 + 2.0e-3**2 / 12.0)
    exact = across - 3e6 * (0.25e-3**2 + 3.0e-3**2 / 12.0) + 0.25
    np.testing.assert_allclose(voxel(still(shape), GRID, **NOW)[0] - 37.0, exact, rtol=1e-9)


def test_orientation_matters():
    """Thick across the beam averages the narrow focus away, thick along it hardly."""
    shape = still(on_cells(gaussian, GRID))
    along = slice_along_beam(lateral=1e-3, axial=1e-3, thickness=5e-3)(shape, GRID, **NOW)[0] - 37.0
    across = slice_across_beam(lateral=1e-3, other_lateral=1e-3, thickness=5e-3)(shape, GRID, **NOW)[0] - 37.0
    assert along < 0.6 * across


def test_small_voxel_is_a_point():
    shape = still(on_cells(gaussian, GRID))
    voxel = MagneticResonanceThermometer(1e-7, 1e-7, 1e-7, lateral_offset=0.6e-3)
    point = Thermocouple(radial_offset=0.6e-3)(shape, GRID, z=FOCUS)
    np.testing.assert_allclose(voxel(shape, GRID, **NOW), point[:1], rtol=1e-9)


def test_frames_average_straight_lines_exactly():
    values = np.asarray([0.0, 2.0, -1.0, 4.0, 4.0, 10.0, 3.0])
    frames = np.asarray([0.45, 1.0, 1.55, 2.55])
    for duration in (0.9, 0.02, 1e-9):
        exact = []
        for middle in frames:
            ends = middle - 0.5 * duration, middle + 0.5 * duration
            inner = TIMES[(TIMES > ends[0]) & (TIMES < ends[1])]
            knots = np.concatenate([ends[:1], inner, ends[1:]])
            exact.append(np.trapezoid(np.interp(knots, TIMES, values), knots) / (ends[1] - ends[0]))
        got = frame_means(jnp.asarray(TIMES), jnp.asarray(values), jnp.asarray(frames), duration)
        np.testing.assert_allclose(got, exact, rtol=1e-6 if duration < 1e-3 else 1e-12)
    np.testing.assert_allclose(
        frame_means(jnp.asarray(TIMES), jnp.asarray(values), jnp.asarray(frames), 0.0),
        np.interp(frames, TIMES, values),
        rtol=1e-14,
    )


def test_frames_may_cover_the_whole_history_but_for_rounding():
    third = np.asarray([0.0, 0.1, 0.1 + 0.1, 0.1 + 0.1 + 0.1])
    got = frame_means(jnp.asarray(third), jnp.asarray([0.0, 1.0, 2.0, 3.0]), jnp.asarray([0.15]), 0.3 * (1.0 + 1e-14))
    np.testing.assert_allclose(got, [1.5], rtol=1e-12)


def test_noise_has_its_deviation_and_its_seed():
    voxel = MagneticResonanceThermometer(1e-3, 1e-3, 1e-3, noise_sd=0.7)
    times = np.linspace(0.0, 2.0, 4000)
    shown = voxel(still(FLAT), GRID, z=FOCUS, frame_times=times, key=jax.random.key(5))
    noise = np.asarray(shown) - 38.0
    # Four standard errors of a mean and of a standard deviation of 4000 values.
    assert abs(noise.mean()) < 4.0 * 0.7 / np.sqrt(4000) and abs(noise.std() - 0.7) < 4.0 * 0.7 / np.sqrt(8000)
    again = voxel(still(FLAT), GRID, z=FOCUS, frame_times=times, key=jax.random.key(5))
    other = voxel(still(FLAT), GRID, z=FOCUS, frame_times=times, key=jax.random.key(6))
    np.testing.assert_array_equal(shown, again)
    assert abs(np.corrcoef(noise, np.asarray(other))[0, 1]) < 0.07
    np.testing.assert_allclose(voxel(still(FLAT), GRID, z=FOCUS, frame_times=times), 38.0, rtol=1e-14)


def problem():
    history = history_of(TIMES, TIMES**2, 9.0 * on_cells(gaussian, GRID))

    def total(voxel, times=TIMES, z=FOCUS):
        given = TemperatureHistory(jnp.asarray(times), history.temperature)
        frames = jnp.asarray([0.4, 0.77, 1.9, 2.4])
        shown = voxel(given, GRID, z=z, frame_times=frames, key=jax.random.key(1))
        return jnp.sum(shown * jnp.cos(jnp.arange(4.0)))

    return total


def test_gradient_in_every_attribute():
    total = problem()
    voxel = MagneticResonanceThermometer(1.1e-3, 0.9e-3, 2.3e-3, 0.63e-3, 0.31e-3, 0.7, 0.2)
    assert_gradient(total, voxel, rtol=2e-6)
    assert_gradient(lambda values: total(voxel, *values), (jnp.asarray(TIMES), jnp.asarray(FOCUS)), rtol=2e-6)


def test_gradient_at_zero_is_finite():
    gradient = jax.grad(problem())(jax.tree.map(jnp.asarray, MagneticResonanceThermometer(1e-3, 1e-3, 1e-3)))
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(gradient))
    assert abs(float(gradient.lateral_offset)) < 1e-9 and abs(float(gradient.axial_offset)) > 1.0


def test_jit_and_vmap_agree_with_one_by_one():
    total, offsets = problem(), jnp.linspace(0.0, 1e-3, 3)
    voxels = eqx.filter_vmap(lambda x: slice_along_beam(lateral=1e-3, axial=1e-3, thickness=2e-3, lateral_offset=x))
    batched = eqx.filter_jit(eqx.filter_vmap(total))(voxels(offsets))
    single = [
        total(slice_along_beam(lateral=1e-3, axial=1e-3, thickness=2e-3, lateral_offset=float(x))) for x in offsets
    ]
    np.testing.assert_allclose(batched, single, rtol=1e-12)


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        ({"width": 0.0}, "`width` must be a finite number above 0 [m], got 0.0"),
        ({"height": -1e-3}, "`height` must be"),
        ({"length": np.nan}, "`length` must be"),
        ({"lateral_offset": np.nan}, "`lateral_offset` must be a finite number [m]"),
        ({"acquisition_time": -1.0}, "`acquisition_time` must be a finite number not below 0 [s]"),
        ({"noise_sd": -1.0}, "`noise_sd` must be a finite number not below 0 [K]"),
    ],
)
def test_impossible_settings(settings, cause):
    with pytest.raises(InputError) as error:
        MagneticResonanceThermometer(**({"width": 1e-3, "height": 1e-3, "length": 1e-3} | settings))
    assert cause in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("voxel", "settings", "cause"),
    [
        (MagneticResonanceThermometer(1.0, 1.0, 1.0), {}, "the voxel reaches from"),
        (MagneticResonanceThermometer(1.0, 1e-3, 1e-3), {}, "the voxel reaches from"),
        (MagneticResonanceThermometer(1e-3, 1.0, 1e-3), {}, "the voxel reaches from"),
        (MagneticResonanceThermometer(1e-3, 1e-3, 1.0), {}, "the voxel reaches from"),
        (MagneticResonanceThermometer(1e-3, 1e-3, 1e-3), {"z": 61.0}, "Millimetres?"),
        (MagneticResonanceThermometer(1e-3, 1e-3, 1e-3), {"frame_times": np.asarray([1.0, 3.0])}, "from 1 to 3 s"),
        (MagneticResonanceThermometer(1e-3, 1e-3, 1e-3, acquisition_time=3.0), {}, "from -0.5 to 2.5 s"),
    ],
)
def test_impossible_readings(voxel, settings, cause):
    with pytest.raises(InputError) as error:
        voxel(still(FLAT), GRID, **(NOW | settings))
    assert cause in str(error.value) and "\n" not in str(error.value)


def test_another_grid_is_refused():
    with pytest.raises(InputError, match=r"`history.temperature` has shape \(2, 20, 40\)"):
        MagneticResonanceThermometer(1e-3, 1e-3, 1e-3)(still(FLAT), grid(12), **NOW)
