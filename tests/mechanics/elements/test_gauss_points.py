"""Strains and forces without matrices against the element matrices."""

import jax
import jax.numpy as jnp
import numpy as np

from arfjax.mechanics.elements import gauss_points
from arfjax.mechanics.elements.axisymmetric import (
    deviator,
    deviatoric_stiffness,
    load,
    mass_matrices,
    strains,
    volumetric_stiffness,
)
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.numerics.assembly import apply_elements, gather
from tests.mechanics.problems import small_mesh, uneven_material

MESH = small_mesh()
MATERIAL = uneven_material(MESH)


def random_field(mesh: Mesh, seed: int = 0) -> jnp.ndarray:
    return jnp.asarray(np.random.default_rng(seed).normal(size=(2, len(mesh.node_z), len(mesh.node_r))))


def by_rows(nodal: jnp.ndarray) -> jnp.ndarray:
    return nodal.transpose(1, 2, 0)


def by_elements(at_points: jnp.ndarray) -> jnp.ndarray:
    return jnp.moveaxis(at_points, -3, -1)


def assert_close(ours, expected):
    np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-13 * float(jnp.max(jnp.abs(expected))))


def test_strains_are_those_of_the_weak_form():
    field = random_field(MESH)
    ours = gauss_points.kinematics(MESH, field)
    expected = strains(MESH, gather(by_rows(field)))
    assert_close(by_elements(ours.dilatation), jnp.sum(expected[..., :3], axis=-1))
    shape = jnp.stack([by_elements(component) for component in ours.shape], axis=-1)
    assert_close(shape, deviator(expected)[..., np.array([0, 1, 3])])


def test_forces_are_the_transpose_of_strains():
    field, rng = random_field(MESH), np.random.default_rng(1)
    moved = gauss_points.kinematics(MESH, field)
    stress, pressure, momentum = (jnp.asarray(rng.normal(size=part.shape)) for part in jax.tree.leaves(moved))
    work = jnp.sum(stress * moved.shape) + jnp.sum(pressure * moved.dilatation) + jnp.sum(momentum * moved.motion)
    force = gauss_points.nodal_force(MESH, stress, pressure, momentum)
    np.testing.assert_allclose(jnp.sum(force * field), work, rtol=1e-12)


def test_stiffness_and_mass_act_like_the_element_matrices():
    field = random_field(MESH)
    moved = gauss_points.kinematics(MESH, field)
    at_points = lambda values: gauss_points.at_points(MESH, values)  # noqa: E731
    none = {
        "stress": jnp.zeros_like(moved.shape),
        "pressure": jnp.zeros_like(moved.dilatation),
        "momentum": jnp.zeros_like(moved.motion),
    }
    volume = gauss_points.volumes(MESH)
    shear = 2.0 * volume * at_points(MATERIAL.relaxed_shear_modulus)
    stress = gauss_points.deviatoric_stress(shear[None] * moved.shape)
    elastic = gauss_points.volumetric(MESH, at_points(MATERIAL.bulk_modulus))
    momentum = (volume * at_points(MATERIAL.density))[:, None] * moved.motion
    cases = [
        ({"stress": stress}, deviatoric_stiffness(MESH, MESH.element_values(MATERIAL.relaxed_shear_modulus))),
        (
            {"pressure": elastic.pressure(elastic.of(moved.dilatation))},
            volumetric_stiffness(MESH, MESH.element_values(MATERIAL.bulk_modulus)),
        ),
        ({"momentum": momentum}, mass_matrices(MESH, MESH.element_values(MATERIAL.density))),
    ]
    for parts, matrices in cases:
        force = gauss_points.nodal_force(MESH, **{**none, **parts})
        assert_close(by_rows(force), apply_elements(matrices, by_rows(field)))


def test_the_diagonal_of_the_mass():
    inertia = gauss_points.volumes(MESH) * gauss_points.at_points(MESH, MATERIAL.density)
    matrices = mass_matrices(MESH, MESH.element_values(MATERIAL.density))
    diagonal = gauss_points.nodal_mass(MESH, inertia)
    single = jnp.zeros_like(diagonal).at[1, 4, 3].set(1.0)
    assert_close(diagonal[1, 4, 3], apply_elements(matrices, by_rows(single))[4, 3, 1])
    axial = load(MESH, MESH.element_values(MATERIAL.density), 0.0 * MESH.element_values(MATERIAL.density))
    assert float(jnp.sum(diagonal[1])) < float(jnp.sum(axial[..., 1]))
