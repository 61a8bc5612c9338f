"""The mesh: positions, walls, interpolation, and messages about wrong shapes."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.mechanics.elements.mesh import Mesh, Wall, Walls, interpolation_weights
from tests.mechanics.problems import small_mesh


def test_nodes_and_gauss_points_lie_where_the_edges_say():
    mesh = Mesh(np.array([0.0, 1.0, 3.0]), np.array([-1.0, 1.0]))
    np.testing.assert_allclose(mesh.node_r, [0.0, 0.5, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(mesh.gauss_z, [-np.sqrt(0.6), 0.0, np.sqrt(0.6)], atol=1e-15)
    np.testing.assert_allclose(mesh.gauss_r[3:], [2.0 - np.sqrt(0.6), 2.0, 2.0 + np.sqrt(0.6)])
    assert mesh.n_unknowns == 2 * 5 * 3


def test_fields_are_sorted_by_elements():
    mesh = small_mesh()
    field = mesh.gauss_r[:, None] + 10.0 * mesh.gauss_z[None, :]
    values = mesh.element_values(field)
    element_z, element_r, point = 3, 1, 7  # point 7 is the last along z, the middle one along r
    expected = mesh.gauss_r[3 * element_r + 1] + 10.0 * mesh.gauss_z[3 * element_z + 2]
    np.testing.assert_allclose(values[element_z, element_r, point], expected, rtol=1e-14)


def test_walls_hold_what_they_should():
    free = small_mesh(Walls(outer=Wall.FREE, top=Wall.FREE)).free
    assert np.all(free[0] == 0.0) and np.all(free[1:, 0, 0] == 0.0)
    assert np.all(free[1:, 0, 1] == 1.0) and np.all(free[1:, 1:] == 1.0)
    assert np.all(small_mesh().free[:, -1] == 0.0) and np.all(small_mesh().free[-1] == 0.0)


def test_interpolation_is_exact_for_a_parabola_and_at_the_edges():
    mesh = small_mesh()
    positions = np.concatenate([mesh.z_edges, [-2.95e-3, 0.13e-3, 2.1e-3]])
    values = interpolation_weights(mesh.z_edges, positions) @ jnp.asarray(1.0 + mesh.node_z + 500.0 * mesh.node_z**2)
    np.testing.assert_allclose(values, 1.0 + positions + 500.0 * positions**2, rtol=1e-14)


def test_wrong_edges_and_shapes_are_refused():
    with pytest.raises(ValueError, match="start on the axis"):
        Mesh(np.array([0.1, 1.0]), np.array([0.0, 1.0]))
    with pytest.raises(ValueError, match="ascending"):
        Mesh(np.array([0.0, 1.0]), np.array([1.0, 0.0]))
    with pytest.raises(ValueError, match=r"has shape \(12, 15\)"):
        small_mesh().element_values(np.zeros((15, 12)))


def test_walls_have_names():
    walls = Walls(outer="free", bottom="sliding", top=True)
    assert (walls.outer, walls.bottom, walls.top) == (Wall.FREE, Wall.SLIDING, Wall.FIXED)
    with pytest.raises(InputError, match='one of "fixed", "free", "sliding".* got \'loose\''):
        Walls(outer="loose")


def test_outside_the_mesh_there_is_nothing():
    mesh = small_mesh()
    values = interpolation_weights(mesh.z_edges, [-3.1e-3, 0.0, 2.3e-3]) @ jnp.ones(len(mesh.node_z))
    np.testing.assert_array_equal(np.isnan(values), [True, False, True])
    mesh.require_inside(np.array([[0.0, -3e-3], [4.2e-3, 2.2e-3]]))
    with pytest.raises(InputError, match="r = 20 m, .* Millimetres"):
        mesh.require_inside(np.array([[0.0, 0.0], [20.0, 0.0]]))


def test_sliding_walls_hold_the_normal_component_alone():
    free = small_mesh(Walls(outer=Wall.SLIDING, bottom=Wall.SLIDING, top=Wall.FREE)).free
    assert np.all(free[:, -1, 0] == 0.0) and np.all(free[1:, -1, 1] == 1.0)
    assert np.all(free[0, :, 1] == 0.0) and np.all(free[0, 1:-1, 0] == 1.0)
    assert np.all(free[-1, :, 1] == 1.0)
