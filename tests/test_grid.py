"""Grids: volumes that add up, and positions that start, stop and thicken where they were told to."""

import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid, graded_positions


def test_volumes_add_up_to_the_cylinder():
    grid = AxisymmetricGrid(np.asarray([0.0, 1.0, 3.0]), np.asarray([2.0, 3.0, 7.0]))
    assert grid.shape == (2, 2)
    assert grid.volumes.sum() == pytest.approx(np.pi * 9.0 * 5.0, rel=1e-14)
    np.testing.assert_allclose(grid.r, [0.5, 2.0])


@pytest.mark.parametrize(
    ("r_faces", "z_faces"),
    [
        ([0.1, 1.0], [0.0, 1.0]),
        ([0.0, 1.0, 1.0], [0.0, 1.0]),
        ([0.0, 1.0], [0.0]),
        ([0.0, np.nan, 1.0], [0.0, 1.0]),
    ],
)
def test_impossible_faces_are_refused(r_faces, z_faces):
    with pytest.raises(InputError, match="must"):
        AxisymmetricGrid(np.asarray(r_faces), np.asarray(z_faces))


@pytest.mark.parametrize("centre", [0.0, 0.3, 1.0])
def test_graded_positions(centre):
    positions = graded_positions(0.0, 1.0, centre, finest=0.01, growth=1.2, coarsest=0.1)
    spacings = np.diff(positions)
    assert positions[0] == 0.0 and positions[-1] == pytest.approx(1.0, abs=1e-15)
    assert centre in positions
    assert spacings.min() > 0.0 and spacings.min() <= 0.01 + 1e-12 and spacings.max() <= 0.1 + 1e-12
    ratios = spacings[1:] / spacings[:-1]
    # Both sides are stretched on their own, so the ratio across the centre may differ from 1 as well.
    assert np.all(ratios < 1.6) and np.all(ratios > 1.0 / 1.6)


def test_graded_positions_refuse_nonsense():
    with pytest.raises(ValueError, match="between"):
        graded_positions(0.0, 1.0, 2.0, finest=0.1, growth=1.1, coarsest=0.2)
    with pytest.raises(ValueError, match="finest"):
        graded_positions(0.0, 1.0, 0.5, finest=0.3, growth=1.1, coarsest=0.2)
