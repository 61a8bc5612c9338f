r"""Weak form of axisymmetric elasticity: strains, element matrices and loads.

Displacement is biquadratic. Strains are in the order rr, zz, tt, rz with engineering shear. The pressure
$p = K \nabla \cdot u$ is linear and discontinuous in each element and condensed there, so that a nearly incompressible
solid does not lock:

$$ \int q \, (\nabla \cdot u - p / K) \, dV = 0 \quad \text{for } q = 1, r, z . $$

Integrals go all the way round the axis. Arrays are sorted by elements (axial first, Gauss point and node last); the
functions that users meet take and give fields in the order r, z.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Inexact

from arfjax.mechanics.elements.matrices import deviatoric_stiffness_of, mass_of, metric_of, volumetric_stiffness_of
from arfjax.mechanics.elements.mesh import N_GAUSS, Mesh
from arfjax.numerics.assembly import apply_elements, scatter
from arfjax.numerics.elements import product, quadratic, quadratic_slope
from arfjax.numerics.quadrature import gauss_legendre

_POINTS, _WEIGHTS = gauss_legendre(N_GAUSS)
STRESS_OVER_STRAIN = np.array([2.0, 2.0, 2.0, 1.0])
"""Deviatoric stress over shear modulus and deviatoric strain: two, and one for engineering shear."""


def volume_weights(mesh: Mesh) -> Float[Array, "ez er 9"]:
    """Volume [m^3] that each Gauss point stands for."""
    r_sizes, z_sizes = mesh.r_edges[1:] - mesh.r_edges[:-1], mesh.z_edges[1:] - mesh.z_edges[:-1]
    rings = jnp.pi * r_sizes[:, None] * _WEIGHTS[None, :] * _element_radii(mesh)
    heights = 0.5 * z_sizes[:, None] * _WEIGHTS[None, :]
    return jnp.asarray(heights[:, None, :, None] * rings[None, :, None, :]).reshape(len(z_sizes), len(r_sizes), -1)


def _element_radii(mesh: Mesh) -> Float[np.ndarray, "er 3"]:
    return mesh.gauss_r.reshape(-1, N_GAUSS)


def _shape_values() -> Float[Array, "9 9"]:
    return product(quadratic(_POINTS), quadratic(_POINTS))


def strains(mesh: Mesh, displacement: Inexact[Array, "ez er 9 2"]) -> Inexact[Array, "ez er 9 4"]:
    """Strains rr, zz, tt, rz at the Gauss points from the displacement at the nodes of each element."""
    r_sizes = jnp.asarray(mesh.r_edges[1:] - mesh.r_edges[:-1], dtype=float)
    z_sizes = jnp.asarray(mesh.z_edges[1:] - mesh.z_edges[:-1], dtype=float)
    radii = jnp.tile(jnp.asarray(_element_radii(mesh), dtype=float), (1, N_GAUSS))
    slope_r = product(quadratic_slope(_POINTS), quadratic(_POINTS))
    slope_z = product(quadratic(_POINTS), quadratic_slope(_POINTS))
    along_r = jnp.einsum("gn,zrnc->zrgc", slope_r, displacement) * (2.0 / r_sizes)[None, :, None, None]
    along_z = jnp.einsum("gn,zrnc->zrgc", slope_z, displacement) * (2.0 / z_sizes)[:, None, None, None]
    hoop = jnp.einsum("gn,zrn->zrg", _shape_values(), displacement[..., 0]) / radii[None, :, :]
    return jnp.stack([along_r[..., 0], along_z[..., 1], hoop, along_z[..., 0] + along_r[..., 1]], axis=-1)


def deviator(strain: Inexact[Array, "*point 4"]) -> Inexact[Array, "*point 4"]:
    """The strain without its volumetric part."""
    third = jnp.sum(strain[..., :3], axis=-1, keepdims=True) / 3.0
    return strain - jnp.concatenate([third, third, third, jnp.zeros_like(third)], axis=-1)


def mass_matrices(mesh: Mesh, density: Float[Array, "ez er 9"]) -> Float[Array, "ez er 9 9"]:
    """Consistent mass of each element [kg], the same for both components."""
    return mass_of(density * volume_weights(mesh))


def deviatoric_stiffness(mesh: Mesh, shear_modulus: Float[Array, "ez er 9"]) -> Float[Array, "ez er 18 18"]:
    """Element stiffness [N/m] against change of shape."""
    return deviatoric_stiffness_of(metric_of(mesh), shear_modulus * volume_weights(mesh))


def volumetric_stiffness(mesh: Mesh, bulk_modulus: Float[Array, "ez er 9"]) -> Float[Array, "ez er 18 18"]:
    """Element stiffness [N/m] against change of volume, the linear pressure condensed."""
    return volumetric_stiffness_of(metric_of(mesh), volume_weights(mesh), bulk_modulus)


def load(
    mesh: Mesh, axial_force: Float[Array, "ez er 9"], radial_force: Float[Array, "ez er 9"]
) -> Float[Array, "row column 2"]:
    """Nodal force [N] of a force density [N/m^3] at the Gauss points."""
    density = jnp.stack([radial_force, axial_force], axis=-1) * volume_weights(mesh)[..., None]
    return scatter(jnp.einsum("gn,zrgc->zrnc", _shape_values(), density))


def kinetic_energy(mesh: Mesh, density: Float[Array, "rq zq"], velocity: Float[Array, "r z 2"]) -> Float[Array, ""]:
    """Kinetic energy [J] of a nodal velocity [m/s]."""
    nodal = velocity.transpose(1, 0, 2)
    return 0.5 * jnp.sum(nodal * apply_elements(mass_matrices(mesh, mesh.element_values(density)), nodal))


def strain_energy(
    mesh: Mesh,
    shear_modulus: Float[Array, "rq zq"],
    bulk_modulus: Float[Array, "rq zq"],
    displacement: Float[Array, "r z 2"],
) -> Float[Array, ""]:
    """Energy [J] that an elastic solid stores in a nodal displacement [m]."""
    nodal = displacement.transpose(1, 0, 2)
    stiffness = deviatoric_stiffness(mesh, mesh.element_values(shear_modulus)) + volumetric_stiffness(
        mesh, mesh.element_values(bulk_modulus)
    )
    return 0.5 * jnp.sum(nodal * apply_elements(stiffness, nodal))
