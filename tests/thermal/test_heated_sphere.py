"""The bioheat solver against a source with an edge, at which the heat jumps within cells."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.exact.heated_sphere import heated_sphere_rise
from arfjax.grid import AxisymmetricGrid
from arfjax.media import ThermalMedium
from arfjax.thermal.bioheat import Phase, solve_bioheat, uniform_field
from tests.checks import assert_order

RADIUS, HEAT = 2e-3, 1e7
HEATED, COOLED, STEPS_PER_SECOND = 6.0, 2.0, 8
REACH = 1.2e-2
"""Where the walls are: no heat arrives there in so short a time."""


def grid_of(n: int) -> AxisymmetricGrid:
    """Square cells; the edge cuts the axis in the middle of a cell for n = 15, 21, 33, 45."""
    return AxisymmetricGrid(REACH * np.linspace(0.0, 1.0, n + 1), REACH * np.linspace(-1.0, 1.0, 2 * n + 1))


def part_inside(grid: AxisymmetricGrid, n: int = 64) -> np.ndarray:
    """Part of each cell's volume that is inside the sphere: in r exact, in z by the midpoints of `n` slices."""
    slices = (np.arange(n) + 0.5) / n
    z = grid.z_faces[:-1, None] + np.diff(grid.z_faces)[:, None] * slices[None, :]
    inside = np.clip(np.maximum(RADIUS**2 - z**2, 0.0)[None], grid.r_faces[:-1, None, None] ** 2, None)
    inside = np.minimum(inside, grid.r_faces[1:, None, None] ** 2) - grid.r_faces[:-1, None, None] ** 2
    return np.mean(inside, axis=-1) / np.diff(grid.r_faces**2)[:, None]


def rises(medium: ThermalMedium, grid: AxisymmetricGrid) -> tuple[np.ndarray, np.ndarray]:
    """At the end of heating and after cooling [K]."""
    heating = Phase(HEATED, round(HEATED * STEPS_PER_SECOND))
    cooling = Phase(COOLED, round(COOLED * STEPS_PER_SECOND), power=0.0)
    history = solve_bioheat(
        uniform_field(medium, grid),
        jnp.asarray(HEAT * part_inside(grid)),
        grid,
        phases=[heating, cooling],
        initial_temperature=0.0,
        arterial_temperature=0.0,
    )
    return np.asarray(history.temperature[heating.n_steps]), np.asarray(history.temperature[-1])


def test_the_parts_add_up_to_the_sphere():
    grid = grid_of(15)
    volume = np.sum(part_inside(grid) * grid.volumes)
    np.testing.assert_allclose(volume, 4.0 / 3.0 * np.pi * RADIUS**3, rtol=1e-4)


@pytest.mark.parametrize("perfusion", [0.0, 1e5])
def test_second_order_for_heat_with_an_edge(perfusion):
    """In the mean square over the volume, and after cooling in the largest error too.

    While the heat is on, the cells that the edge cuts know their mean and not their centre, so that the largest error
    falls more slowly.
    """
    medium = ThermalMedium(0.51, 3.8e6, perfusion)
    cells = [15, 21, 33, 45]
    errors = []
    for n in cells:
        grid = grid_of(n)
        distance = np.hypot(grid.r[:, None], grid.z[None, :])
        sphere = {"heat": HEAT, "radius": RADIUS, "heating_duration": HEATED}
        hot = heated_sphere_rise(distance, HEATED, medium, **sphere)
        cool = heated_sphere_rise(distance, HEATED + COOLED, medium, **sphere)
        got_hot, got_cool = rises(medium, grid)
        errors.append(
            [
                np.sqrt(np.sum((got_hot - hot) ** 2 * grid.volumes) / np.sum(hot**2 * grid.volumes)),
                np.sqrt(np.sum((got_cool - cool) ** 2 * grid.volumes) / np.sum(cool**2 * grid.volumes)),
                np.abs(got_cool - cool).max() / cool.max(),
            ]
        )
    for one in np.transpose(errors):
        assert_order(1.0 / np.array(cells), one, order=2.0, slack=0.1)
    assert np.max(errors[-1]) < 4e-3
