"""Meshes that are fine at the focus: where edges lie, how smoothly they coarsen, and what outer layers stand for."""

import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.mechanics.elements.mesh import Wall, Walls
from arfjax.mechanics.elements.refinement import OuterLayer, focused_mesh, refined_edges

PLACE = {"focus": 62.6e-3, "radius": 21e-3, "front": 45e-3, "back": 85e-3}


@pytest.mark.parametrize("growth", [1.05, 1.2, 1.3])
@pytest.mark.parametrize("coarsest", [2e-3, np.inf])
@pytest.mark.parametrize("focus", [45e-3, 45.9e-3, 57.31e-3, 85e-3])
def test_spacings_start_fine_and_change_smoothly(growth, coarsest, focus):
    edges = refined_edges(45e-3, 85e-3, focus, finest=0.4e-3, growth=growth, fine=1e-3, coarsest=coarsest)
    spacing = np.diff(edges)
    ratios = spacing[1:] / spacing[:-1]
    assert edges[0] == 45e-3 and edges[-1] == 85e-3 and focus in edges
    assert np.max(np.maximum(ratios, 1.0 / ratios)) <= growth * (1.0 + 1e-9) or focus == 45.9e-3  # a short side
    assert np.max(np.maximum(ratios, 1.0 / ratios)) <= 1.3
    nearest = np.argmin(np.abs(0.5 * (edges[1:] + edges[:-1]) - focus))
    np.testing.assert_allclose(spacing[nearest], 0.4e-3, rtol=0.2 if focus == 45.9e-3 else 1e-9)
    assert np.max(spacing) <= coarsest * (1.0 + 1e-9)


def test_the_fine_part_is_even():
    mesh = focused_mesh(**PLACE, finest_r=0.2e-3, finest_z=0.5e-3, fine_radius=1e-3, fine_length=4e-3)
    assert np.all(np.abs(np.diff(mesh.r_edges)[:5] - 0.2e-3) < 1e-12)
    inner = np.abs(mesh.z_edges - PLACE["focus"]) < 2.01e-3
    np.testing.assert_allclose(np.diff(mesh.z_edges[inner]), 0.5e-3, rtol=1e-9)
    assert np.sum(inner) == 9


def test_outer_layers_lie_outside():
    plain = focused_mesh(**PLACE, finest_r=0.2e-3, finest_z=0.5e-3)
    walls = Walls(outer=Wall.SLIDING)
    mesh = focused_mesh(**PLACE, finest_r=0.2e-3, finest_z=0.5e-3, walls=walls, outer_layer=OuterLayer(n_elements=4))
    np.testing.assert_allclose(mesh.r_edges[:-4], plain.r_edges)
    np.testing.assert_allclose(mesh.z_edges[4:-4], plain.z_edges)
    np.testing.assert_allclose(mesh.z_edges[-1], 85e-3 + 5.0)
    np.testing.assert_allclose(mesh.r_edges[-3] - mesh.r_edges[-5], 5e-3 * 0.5 / (1.0 - 0.5 * 0.999))
    assert mesh.walls.outer is Wall.SLIDING
    np.testing.assert_allclose(OuterLayer(stretch=1.0, n_elements=2).distances, [2.5e-3, 5e-3])


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"focus": 0.2}, "must lie in the mesh"),
        ({"growth": 1.5}, "growth"),
        ({"finest_r": 0.0}, "finest"),
        ({"coarsest": 1e-4}, "coarsest"),
    ],
)
def test_nonsense_is_refused(changed, told):
    with pytest.raises(InputError, match=told):
        focused_mesh(**({**PLACE, "finest_r": 0.2e-3, "finest_z": 0.5e-3} | changed))


def test_a_layer_of_nothing_is_refused():
    with pytest.raises(InputError, match="outer layer"):
        OuterLayer(thickness=0.0)
