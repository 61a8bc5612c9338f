"""Lesion size of doses whose contour is known, and at the edges: nothing, everything, cut by a wall."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.thermal.damage import coagulated_fraction
from arfjax.thermal.lesion import lesion_growth, lesion_size, smoothed_lesion_size
from tests.checks import assert_gradient, assert_order, observed_order

RADIUS, HALF_LENGTH, CENTRE = 1.7e-3, 6.1e-3, 0.1003


def grid_of(n: int, near: float = 0.09, far: float = 0.112) -> AxisymmetricGrid:
    return AxisymmetricGrid(4e-3 * np.linspace(0.0, 1.0, n + 1) ** 1.2, np.linspace(near, far, 2 * n + 1))


def ellipsoid_dose(grid: AxisymmetricGrid, *, sharpness=3.0, centre=CENTRE, quartic=0.2, threshold=240.0):
    """A dose that is the threshold on an ellipsoid; not a parabola in any direction, so that no rule is exact."""
    distance = (grid.r[:, None] / RADIUS) ** 2 + ((grid.z[None, :] - centre) / HALF_LENGTH) ** 2
    return jnp.asarray(threshold) * jnp.exp(sharpness * (1.0 - distance) + quartic * (1.0 - distance**2))


def measured(dose, grid, size_of=lesion_size, **settings):
    """Compiled as one, because each small operation on a new shape would be compiled on its own."""
    return jax.jit(lambda dose: size_of(dose, grid, **settings))(dose)


def mean_errors(size_of, exact, cells, **shape) -> list:
    """Averaged over where the contour lies between centres, which makes the error of a single lesion wander."""
    errors = []
    for n in cells:
        grid = grid_of(n)
        centres = CENTRE + (grid.z[1] - grid.z[0]) * jnp.linspace(0.0, 1.0, 16, endpoint=False)
        of_centre = jax.vmap(lambda centre, grid=grid: size_of(ellipsoid_dose(grid, centre=centre, **shape), grid))
        size = jax.jit(of_centre)(centres)
        got = (size.length, size.diameter, size.volume, size.centre - centres)
        errors.append([np.mean(np.abs(one - want)) for one, want in zip(got, exact, strict=True)])
    return list(np.transpose(errors))


ELLIPSOID = (2.0 * HALF_LENGTH, 2.0 * RADIUS, 4.0 / 3.0 * np.pi * RADIUS**2 * HALF_LENGTH, 0.0)


@pytest.mark.parametrize("quartic", [0.0, 0.2])
def test_second_order_in_cell_size(quartic):
    """Length, diameter, volume and centre of an ellipsoid, from a Gaussian dose and from one of no simple shape."""
    cells = [8, 16, 32, 64]
    for one in mean_errors(lesion_size, ELLIPSOID, cells, quartic=quartic):
        assert_order(1.0 / np.array(cells), one, order=2.0, slack=0.3)


def logistic_mean(function) -> float:
    """Mean of a function of the level under the logistic density, the derivative of the coagulated fraction."""
    return quad(lambda s: function(s) * 0.25 / np.cosh(0.5 * s) ** 2, -60.0, 60.0, points=[0.0, 10.0], limit=400)[0]


def exact_smoothed(sharpness: float, width: float) -> tuple[float, float, float]:
    """Of a Gaussian dose: the mean over thresholds of the exact ellipsoid's length, diameter and volume."""
    root = logistic_mean(lambda s: max(0.0, 1.0 - width * s / sharpness) ** 0.5)
    cube = logistic_mean(lambda s: max(0.0, 1.0 - width * s / sharpness) ** 1.5)
    return ELLIPSOID[0] * root, ELLIPSOID[1] * root, ELLIPSOID[2] * cube


def test_smoothed_size_is_of_second_order():
    cells, width, sharpness = [8, 16, 32, 64], 0.25, 3.4
    exact = (*exact_smoothed(sharpness, width), 0.0)
    errors = mean_errors(
        lambda dose, grid: smoothed_lesion_size(dose, grid, width=width), exact, cells, sharpness=sharpness, quartic=0.0
    )
    for one in errors[:3]:
        assert_order(1.0 / np.array(cells), one, order=2.0, slack=0.2)
    assert errors[3].max() < 1e-9  # the centre of a symmetric lesion is exact


def test_smoothed_size_differs_from_the_sharp_one_as_stated():
    grid, sharpness = grid_of(96), 3.4  # 30 times the threshold
    dose = ellipsoid_dose(grid, sharpness=sharpness, quartic=0.0)
    sharp = measured(dose, grid)
    widths = [0.125, 0.25, 0.5]
    smoothed = jax.jit(jax.vmap(lambda width: smoothed_lesion_size(dose, grid, width=width)))(jnp.asarray(widths))
    for name, factor in (("length", -1.0 / 24.0), ("diameter", -1.0 / 24.0), ("volume", 1.0 / 8.0)):
        bias = np.asarray(getattr(smoothed, name) / getattr(sharp, name)) - 1.0
        np.testing.assert_allclose(bias, factor * (np.pi * np.array(widths) / sharpness) ** 2, rtol=0.15)
        np.testing.assert_allclose(observed_order(widths, np.abs(bias)), 2.0, atol=0.15)


def test_smoothed_size_becomes_the_sharp_one_on_any_grid():
    """Also where cells are far wider than the transition, and where a wall cuts."""
    for grid in (grid_of(6), grid_of(15, near=CENTRE - 0.5 * HALF_LENGTH)):
        dose = ellipsoid_dose(grid)
        smoothed = measured(dose, grid, smoothed_lesion_size, width=1e-7)
        sharp = measured(dose, grid)
        for name in ("length", "diameter", "volume"):
            np.testing.assert_allclose(getattr(smoothed, name), getattr(sharp, name), rtol=1e-6)


def test_a_smoothed_line_is_integrated_exactly():
    """One column of two cells: the length is the mean of the logistic on straight lines."""
    grid = AxisymmetricGrid(np.array([0.0, 1e-3]), np.array([0.0, 1.0, 3.0]))
    for change in (1e-9, 0.3, 0.49, 0.51, 3.0, 40.0):
        level = np.array([1.0, 1.0 + change])
        size = measured(np.exp(level)[None, :], grid, smoothed_lesion_size, threshold=1.0, width=1.0)
        slope = change / 1.5  # a straight line through both centres, 0.5 and 2
        ends = 1.0 + slope * (np.array([0.0, 3.0]) - 0.5)
        exact = quad(lambda z, a=ends[0], b=slope: 1.0 / (1.0 + np.exp(-a - b * z)), 0.0, 3.0, epsrel=1e-13)[0]
        np.testing.assert_allclose(size.length, exact, rtol=2e-10)


def test_smoothed_volume_is_the_integral_of_the_fraction():
    grid, width = grid_of(80), 0.5
    dose = ellipsoid_dose(grid)
    volume = np.sum(coagulated_fraction(dose, 240.0, width=width) * grid.volumes)
    size = measured(dose, grid, smoothed_lesion_size, width=width)
    np.testing.assert_allclose(size.volume, volume, rtol=2e-3)


def test_smoothed_size_pulls_where_nothing_is_lethal_yet():
    """Slopes of all three sizes towards more dose, from half a threshold and from a hundredth."""
    grid = grid_of(12)

    @jax.jit
    @jax.vmap
    def value_and_slope(part):
        def sizes(gain):
            size = smoothed_lesion_size(gain * part * ellipsoid_dose(grid) * np.exp(-3.2), grid, width=0.5)
            return jnp.stack([size.length, size.diameter, size.volume])

        return jax.jvp(sizes, (jnp.ones(()),), (jnp.ones(()),))

    for value, slope in zip(*value_and_slope(jnp.asarray([0.5, 0.01])), strict=True):
        assert np.all(value > 0.0)
        assert np.all(slope / value > 0.5) and np.all(slope / value < 2.1)  # at most 1 / width, far below


def test_a_damage_that_is_nowhere_and_one_that_is_everywhere_have_finite_slopes():
    grid = grid_of(6)
    slope = jax.jit(jax.grad(lambda damage: weighted(smoothed_lesion_size(damage, grid, width=0.3))))
    for damage in (0.0, 1e30):
        for dtype in (jnp.float32, jnp.float64):
            assert np.all(np.isfinite(slope(jnp.full(grid.shape, damage, dtype))))
    everything = measured(jnp.full(grid.shape, 1e30), grid, smoothed_lesion_size, threshold=1.0, width=0.3)
    np.testing.assert_allclose(everything.volume, np.sum(grid.volumes), rtol=1e-12)
    np.testing.assert_allclose(everything.length, grid.z_faces[-1] - grid.z_faces[0], rtol=1e-12)


def test_growth_is_the_size_at_each_time():
    grid = grid_of(12)
    history = jnp.stack([jnp.zeros(grid.shape), *(gain * ellipsoid_dose(grid) for gain in (0.01, 0.5, 4.0))])
    growth = jax.jit(lambda history: lesion_growth(history, grid, threshold=100.0))(history)
    assert growth.length.shape == (4,) and float(growth.volume[0]) == 0.0 and float(growth.volume[1]) == 0.0
    for step in (2, 3):
        single = measured(history[step], grid, threshold=100.0)
        for name in ("length", "diameter", "volume", "centre"):
            np.testing.assert_allclose(getattr(growth, name)[step], getattr(single, name), rtol=1e-14)
        assert growth.volume[step] > growth.volume[step - 1] and growth.length[step] > growth.length[step - 1]


@pytest.mark.parametrize("dose", [0.0, 1e-300, 239.9])
def test_nothing_lethal_has_no_size_and_no_slope(dose):
    grid = grid_of(6)

    def sizes(values):
        size = lesion_size(values, grid)
        return size.length + size.diameter + size.volume + size.centre

    values = jnp.full(grid.shape, dose)
    size = measured(values, grid)
    assert float(size.length) == 0.0 and float(size.diameter) == 0.0 and float(size.volume) == 0.0
    assert grid.z_faces[0] <= float(size.centre) <= grid.z_faces[-1]
    slope = jax.jit(jax.grad(sizes))(values)
    assert np.all(np.asarray(slope) == 0.0)


def test_a_lethal_grid_is_cut_at_its_walls():
    grid = grid_of(6)
    size = measured(np.full(grid.shape, 1e4), grid)
    np.testing.assert_allclose(size.length, grid.z_faces[-1] - grid.z_faces[0], rtol=1e-13)
    np.testing.assert_allclose(size.diameter, 2.0 * grid.r_faces[-1], rtol=1e-13)
    np.testing.assert_allclose(size.volume, np.sum(grid.volumes), rtol=1e-13)
    np.testing.assert_allclose(size.centre, 0.5 * (grid.z_faces[-1] + grid.z_faces[0]), rtol=1e-13)


def test_a_lesion_that_leaves_the_grid_is_cut_there():
    grid = grid_of(60, near=CENTRE - 0.5 * HALF_LENGTH)
    size = measured(ellipsoid_dose(grid), grid)
    np.testing.assert_allclose(size.length, 1.5 * HALF_LENGTH, rtol=1e-3)
    np.testing.assert_allclose(size.diameter, 2.0 * RADIUS, rtol=1e-3)
    np.testing.assert_allclose(size.volume, (0.5 + 11.0 / 32.0) * ELLIPSOID[2], rtol=1e-3)


def test_an_edge_between_the_last_centre_and_the_wall_is_where_its_straight_line_has_it():
    grid = AxisymmetricGrid(np.linspace(0.0, 4e-3, 5), np.linspace(0.0, 0.01, 6))
    radius, half_length = 3.8e-3, 4.7e-3  # the last centres are at 3.5 mm, and 4 mm from the middle
    across = 8.0 * (1.0 - grid.r[:, None] / radius) + 0.0 * grid.z
    along = 8.0 * (1.0 - np.abs(grid.z - 5e-3) / half_length) + 0.0 * grid.r[:, None]
    np.testing.assert_allclose(measured(240.0 * np.exp(across), grid).diameter, 2.0 * radius, rtol=1e-12)
    np.testing.assert_allclose(measured(240.0 * np.exp(along), grid).length, 2.0 * half_length, rtol=1e-12)


def test_size_grows_without_jumps_as_the_threshold_falls():
    grid = grid_of(20)
    dose = ellipsoid_dose(grid)
    thresholds = np.exp(np.linspace(np.log(1.0), np.log(1e4), 4001))
    sizes = jax.vmap(lambda threshold: lesion_size(dose, grid, threshold=threshold))(jnp.asarray(thresholds))
    for values, largest in (
        (sizes.length, 0.022),
        (sizes.diameter, 8e-3),
        (sizes.volume, np.sum(grid.volumes)),
    ):
        changes = np.diff(values)
        assert np.all(changes <= 1e-15)
        assert np.abs(changes).max() < 0.02 * largest


def test_two_lesions_add_their_lengths():
    grid = AxisymmetricGrid(np.linspace(0.0, 4e-3, 11), np.linspace(0.0, 0.06, 241))
    two = [
        240.0 * np.exp(6.0 * (1.0 - (grid.r[:, None] / 1e-3) ** 2 - ((grid.z[None, :] - at) / 4e-3) ** 2))
        for at in (0.015, 0.045)
    ]
    size = measured(two[0] + two[1], grid)
    np.testing.assert_allclose(size.length, 16e-3, rtol=1e-3)
    np.testing.assert_allclose(size.volume, 2.0 * 4.0 / 3.0 * np.pi * 1e-3**2 * 4e-3, rtol=3e-3)
    np.testing.assert_allclose(size.centre, 0.03, rtol=1e-6)


def test_a_batch_matches_single_lesions():
    grid = grid_of(15)
    doses = jnp.stack([ellipsoid_dose(grid, sharpness=s) for s in (1.0, 3.0, 8.0)])
    batch = jax.jit(jax.vmap(lambda dose: lesion_size(dose, grid)))(doses)
    for i, dose in enumerate(doses):
        single = measured(dose, grid)
        np.testing.assert_allclose(batch.length[i], single.length, rtol=1e-14)
        np.testing.assert_allclose(batch.diameter[i], single.diameter, rtol=1e-14)
        np.testing.assert_allclose(batch.centre[i], single.centre, rtol=1e-14)


def weighted(size):
    return size.length + 3.0 * size.diameter + 5.0 * size.centre + 1e6 * size.volume


def test_gradient_in_dose_and_threshold():
    grid = grid_of(15)

    def size(arguments):
        sharpness, threshold = arguments
        return weighted(lesion_size(ellipsoid_dose(grid, sharpness=sharpness), grid, threshold=threshold))

    assert_gradient(size, (jnp.asarray(3.0), jnp.asarray(200.0)))


def test_gradient_of_the_smoothed_size():
    """In every cell's damage, threshold and width, a width for which both forms of the mean are used."""
    grid = grid_of(7)

    def size(arguments):
        gain, threshold, width = arguments
        damage = jnp.exp(gain) * ellipsoid_dose(grid)
        return weighted(smoothed_lesion_size(damage, grid, threshold=threshold, width=width))

    gains = 0.1 * np.random.default_rng(0).normal(size=grid.shape)
    assert_gradient(size, (gains, jnp.asarray(200.0), jnp.asarray(1.0)))


def test_a_dose_of_another_grid_is_refused():
    with pytest.raises(InputError, match="`dose` has shape"):
        lesion_size(np.zeros((3, 4)), grid_of(6))
    with pytest.raises(InputError, match="`dose` has shape"):
        smoothed_lesion_size(np.zeros((3, 4)), grid_of(6), width=0.5)


def test_a_smoothed_size_needs_a_transition():
    grid = grid_of(6)
    for wrong in ({"width": -0.5}, {"width": 0.5, "threshold": -240.0}):
        with pytest.raises(InputError, match="of coagulation must be positive"):
            smoothed_lesion_size(np.ones(grid.shape), grid, **wrong)
