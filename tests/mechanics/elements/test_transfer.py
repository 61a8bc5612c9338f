"""Weights that carry fields to the Gauss points: what they keep, what they reproduce, and how fast they converge."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import lagrange
from scipy.special import erf

from arfjax.errors import InputError
from arfjax.mechanics.elements.axisymmetric import load, volume_weights
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.elements.transfer import interpolation, projected
from arfjax.mechanics.force import force_map, total_force
from tests.checks import assert_order
from tests.mechanics.problems import small_mesh

RADII = 1e-3 * np.array([0.1, 0.35, 0.6, 0.9, 1.3, 1.8, 2.2, 2.9, 3.3])
HEIGHTS = 1e-3 * np.array([-2.6, -2.2, -1.5, -1.0, -0.6, 0.1, 0.5, 1.1, 1.7, 2.4, 2.9])


def cubic_through_nearest(nodes: np.ndarray, values: np.ndarray, x: float) -> float:
    """The interpolant as its definition says, by SciPy's polynomial."""
    first = int(np.clip(np.searchsorted(nodes, x) - 2, 0, len(nodes) - 4))
    return float(lagrange(nodes[first : first + 4] * 1e3, values[first : first + 4])(1e3 * x))


def integral_of_interpolant(nodes, values, start, stop, power, moment=0) -> float:
    inner = nodes[(nodes > start) & (nodes < stop)]
    breaks = [start, *inner, stop]
    pieces = [
        quad(lambda x: cubic_through_nearest(nodes, values, x) * x ** (power + moment), a, b, epsabs=0.0)[0]
        for a, b in zip(breaks[:-1], breaks[1:], strict=True)
    ]
    return sum(pieces)


def test_total_force_is_that_of_the_interpolated_field():
    mesh = small_mesh()
    rng = np.random.default_rng(3)
    along_r, along_z = rng.normal(size=len(RADII)), rng.normal(size=len(HEIGHTS))
    mapped = force_map(mesh, RADII, HEIGHTS)(along_r[:, None] * along_z[None, :])
    mirrored = np.concatenate([-RADII[::-1], RADII]), np.concatenate([along_r[::-1], along_r])
    in_r = integral_of_interpolant(*mirrored, 0.0, RADII[-1], 1)  # the mesh reaches further: no force there
    in_z = integral_of_interpolant(HEIGHTS, along_z, HEIGHTS[0], 2.2e-3, 0)
    np.testing.assert_allclose(total_force(mesh, mapped), 2.0 * np.pi * in_r * in_z, rtol=1e-11)


def test_first_and_second_moment_in_one_element_are_kept():
    mesh = small_mesh()
    values = np.random.default_rng(4).normal(size=len(HEIGHTS))
    mapped = projected(HEIGHTS, mesh.z_edges, ring=False) @ values
    weights = mesh.gauss_weights[1]
    own = slice(3, 6)  # the second element, -1.8 to -0.9 mm
    for moment in (0, 1, 2):
        exact = integral_of_interpolant(HEIGHTS, values, -1.8e-3, -0.9e-3, 0, moment)
        np.testing.assert_allclose(np.sum((weights * mapped * mesh.gauss_z**moment)[own]), exact, rtol=1e-10)


def test_gauss_weights_are_those_of_the_volume():
    mesh = small_mesh()
    rings, heights = mesh.gauss_weights
    np.testing.assert_allclose(mesh.element_values(rings[:, None] * heights[None, :]), volume_weights(mesh), rtol=1e-13)


def test_polynomials_are_reproduced():
    mesh = Mesh(1e-3 * np.array([0.0, 0.5, 1.2, 2.0]), 1e-3 * np.array([-2.0, -0.3, 1.0, 2.5]))
    r, z = mesh.gauss_r[:, None] * 1e3, mesh.gauss_z[None, :] * 1e3
    node_r, node_z = RADII[:, None] * 1e3, HEIGHTS[None, :] * 1e3
    mapped = force_map(mesh, RADII, HEIGHTS)(2.0 + node_r**2 * node_z**2 - node_z)
    np.testing.assert_allclose(mapped, 2.0 + r**2 * z**2 - z, rtol=1e-12, atol=1e-12)
    odd = force_map(mesh, RADII, HEIGHTS, radial_component=True)(node_r * node_z)
    np.testing.assert_allclose(odd, r * z, rtol=1e-12, atol=1e-12)


def test_a_node_on_the_axis_counts_once():
    nodes = np.concatenate([[0.0], RADII])
    weights = interpolation(nodes, np.array([0.0, 0.05e-3, 0.2e-3]), degree=3, ring=True)
    np.testing.assert_allclose(weights @ (1.0 + 1e6 * nodes**2), [1.0, 1.0025, 1.04], rtol=1e-13)
    odd = interpolation(nodes, np.array([0.0, 0.05e-3]), degree=3, ring=True, even=False)
    np.testing.assert_allclose(odd @ nodes, [0.0, 0.05e-3], atol=1e-18)
    # An odd field vanishes on the axis, whatever a sample there says.
    np.testing.assert_array_equal(odd[:, 0], 0.0)


def test_orders_in_the_sound_grid_and_in_the_mesh():
    a, b = 0.6e-3, 3e-3

    def field(r, z):
        return np.exp(-((r[:, None] / a) ** 2) - (z[None, :] / b) ** 2)

    def grid(n):
        return (np.arange(4 * n) + 0.5) * (4e-3 / (4 * n)), np.linspace(-9e-3, 9e-3, 4 * n + 1)

    total = np.pi * a**2 * (1.0 - np.exp(-((4.0 / 0.6) ** 2))) * b * np.sqrt(np.pi) * erf(8.0 / 3.0)
    coarse = Mesh(np.linspace(0.0, 4e-3, 5), np.linspace(-8e-3, 8e-3, 6))
    sizes, errors = [8, 16, 32], []
    for n in sizes:
        errors.append(abs(float(total_force(coarse, force_map(coarse, *grid(n))(field(*grid(n))))) / total - 1.0))
    assert_order(1.0 / np.array(sizes), errors, order=4.0)
    errors = []
    for n in sizes:
        mesh = Mesh(np.linspace(0.0, 4e-3, n + 1), np.linspace(-8e-3, 8e-3, n + 1))
        mapped = force_map(mesh, *grid(64))(field(*grid(64)))
        errors.append(float(jnp.max(jnp.abs(mapped - field(mesh.gauss_r, mesh.gauss_z)))))
    assert_order(1.0 / np.array(sizes), errors, order=3.0, slack=0.3)


def test_the_gradient_is_the_transpose_and_loads_are_exact():
    mesh = small_mesh()
    mapping = force_map(mesh, RADII, HEIGHTS)
    rng = np.random.default_rng(5)
    force, seed = rng.normal(size=(len(RADII), len(HEIGHTS))), rng.normal(size=(12, 15))
    gradient = jax.grad(lambda f: jnp.sum(seed * mapping(f)))(jnp.asarray(force))
    np.testing.assert_allclose(gradient, mapping.along_r.T @ seed @ mapping.along_z, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(jnp.sum(gradient * force), jnp.sum(seed * mapping(force)), rtol=1e-12)
    nodal = load(mesh, mesh.element_values(mapping(force)), jnp.zeros((5, 4, 9)))
    np.testing.assert_allclose(jnp.sum(nodal[..., 1]), total_force(mesh, mapping(force)), rtol=1e-11)


def test_wrong_shapes_and_places_are_refused():
    mesh = small_mesh()
    with pytest.raises(InputError, match=r"shape \(3, 4\)"):
        force_map(mesh, RADII, HEIGHTS)(np.zeros((3, 4)))
    with pytest.raises(InputError, match="misses the mesh"):
        force_map(mesh, RADII, 1e3 * HEIGHTS + 60.0)
    with pytest.raises(InputError, match="ascend"):
        force_map(mesh, RADII[::-1], HEIGHTS)
