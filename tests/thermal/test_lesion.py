"""Lesion size of doses whose contour is known, and at the edges: nothing, everything, cut by a wall."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.thermal.lesion import lesion_size
from tests.checks import assert_gradient, assert_order

RADIUS, HALF_LENGTH, CENTRE = 1.7e-3, 6.1e-3, 0.1003


def grid_of(n: int, near: float = 0.09, far: float = 0.112) -> AxisymmetricGrid:
    return AxisymmetricGrid(4e-3 * np.linspace(0.0, 1.0, n + 1) ** 1.2, np.linspace(near, far, 2 * n + 1))


def ellipsoid_dose(grid: AxisymmetricGrid, *, sharpness=3.0, centre=CENTRE, quartic=0.2, threshold=240.0):
    """A dose that is the threshold on an ellipsoid; not a parabola in any direction, so that no rule is exact."""
    distance = (grid.r[:, None] / RADIUS) ** 2 + ((grid.z[None, :] - centre) / HALF_LENGTH) ** 2
    return jnp.asarray(threshold) * jnp.exp(sharpness * (1.0 - distance) + quartic * (1.0 - distance**2))


def test_second_order_in_cell_size():
    """Averaged over where the contour lies between centres, which makes the error of a single lesion wander."""
    cells = [8, 16, 32, 64]
    errors = []
    for n in cells:
        grid = grid_of(n)
        centres = CENTRE + (grid.z[1] - grid.z[0]) * jnp.linspace(0.0, 1.0, 16, endpoint=False)
        sizes = jax.jit(jax.vmap(lambda centre, grid=grid: lesion_size(ellipsoid_dose(grid, centre=centre), grid)))(
            centres
        )
        exact = (2.0 * HALF_LENGTH, 2.0 * RADIUS, centres)
        errors.append([np.mean(np.abs(got - want)) for got, want in zip(jax.tree.leaves(sizes), exact, strict=True)])
    for one in np.transpose(errors):
        assert_order(1.0 / np.array(cells), one, order=2.0, slack=0.3)


@pytest.mark.parametrize("dose", [0.0, 1e-300, 239.9])
def test_nothing_lethal_has_no_size_and_no_slope(dose):
    grid = grid_of(6)

    def sizes(values):
        size = lesion_size(values, grid)
        return size.length + size.diameter + size.centre

    values = jnp.full(grid.shape, dose)
    size = lesion_size(values, grid)
    assert float(size.length) == 0.0 and float(size.diameter) == 0.0
    assert grid.z_faces[0] <= float(size.centre) <= grid.z_faces[-1]
    slope = jax.jit(jax.grad(sizes))(values)
    assert np.all(np.asarray(slope) == 0.0)


def test_a_lethal_grid_is_cut_at_its_walls():
    grid = grid_of(6)
    size = lesion_size(np.full(grid.shape, 1e4), grid)
    np.testing.assert_allclose(size.length, grid.z_faces[-1] - grid.z_faces[0], rtol=1e-13)
    np.testing.assert_allclose(size.diameter, 2.0 * grid.r_faces[-1], rtol=1e-13)
    np.testing.assert_allclose(size.centre, 0.5 * (grid.z_faces[-1] + grid.z_faces[0]), rtol=1e-13)


def test_a_lesion_that_leaves_the_grid_is_cut_there():
    grid = grid_of(60, near=CENTRE - 0.5 * HALF_LENGTH)
    size = lesion_size(ellipsoid_dose(grid), grid)
    np.testing.assert_allclose(size.length, 1.5 * HALF_LENGTH, rtol=1e-3)
    np.testing.assert_allclose(size.diameter, 2.0 * RADIUS, rtol=1e-3)


def test_size_grows_without_jumps_as_the_threshold_falls():
    grid = grid_of(20)
    dose = ellipsoid_dose(grid)
    thresholds = np.exp(np.linspace(np.log(1.0), np.log(1e4), 4001))
    sizes = jax.vmap(lambda threshold: lesion_size(dose, grid, threshold=threshold))(jnp.asarray(thresholds))
    for values, largest in ((sizes.length, 0.022), (sizes.diameter, 8e-3)):
        changes = np.diff(values)
        assert np.all(changes <= 1e-15)
        assert np.abs(changes).max() < 0.02 * largest


def test_two_lesions_add_their_lengths():
    grid = AxisymmetricGrid(np.linspace(0.0, 4e-3, 11), np.linspace(0.0, 0.06, 241))
    two = [
        240.0 * np.exp(6.0 * (1.0 - (grid.r[:, None] / 1e-3) ** 2 - ((grid.z[None, :] - at) / 4e-3) ** 2))
        for at in (0.015, 0.045)
    ]
    size = lesion_size(two[0] + two[1], grid)
    np.testing.assert_allclose(size.length, 16e-3, rtol=1e-3)
    np.testing.assert_allclose(size.centre, 0.03, rtol=1e-6)


def test_a_batch_matches_single_lesions():
    grid = grid_of(15)
    doses = jnp.stack([ellipsoid_dose(grid, sharpness=s) for s in (1.0, 3.0, 8.0)])
    batch = jax.jit(jax.vmap(lambda dose: lesion_size(dose, grid)))(doses)
    for i, dose in enumerate(doses):
        single = lesion_size(dose, grid)
        np.testing.assert_allclose(batch.length[i], single.length, rtol=1e-14)
        np.testing.assert_allclose(batch.diameter[i], single.diameter, rtol=1e-14)
        np.testing.assert_allclose(batch.centre[i], single.centre, rtol=1e-14)


def test_gradient_in_dose_and_threshold():
    grid = grid_of(15)

    def size(arguments):
        sharpness, threshold = arguments
        size = lesion_size(ellipsoid_dose(grid, sharpness=sharpness), grid, threshold=threshold)
        return size.length + 3.0 * size.diameter + 5.0 * size.centre

    assert_gradient(size, (jnp.asarray(3.0), jnp.asarray(200.0)))


def test_a_dose_of_another_grid_is_refused():
    with pytest.raises(InputError, match="`dose` has shape"):
        lesion_size(np.zeros((3, 4)), grid_of(6))
