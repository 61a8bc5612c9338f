r"""Strains and forces without matrices: from nodes to Gauss points and back, all elements in one matrix product.

Fields of nodes have the order component, row (z), column (r); fields of Gauss points have the point of the element
first and then the elements, axial and radial. A change of shape has two independent normal deviators and a shear,
$d = (d_{rr}, d_{zz}, \gamma_{rz})$, since $d_{tt} = -d_{rr} - d_{zz}$.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.mechanics.elements.axisymmetric import volume_weights
from arfjax.mechanics.elements.mesh import N_GAUSS, Mesh
from arfjax.numerics.elements import linear_pressure, product, quadratic, quadratic_slope
from arfjax.numerics.quadrature import gauss_legendre
from arfjax.numerics.small_matrices import inverse_of_symmetric

Nodal = Float[Array, "2 row column"]
AtPoints = Float[Array, "9 ez er"]

_POINTS, _ = gauss_legendre(N_GAUSS)


class Kinematics(eqx.Module):
    """Motion at the Gauss points.

    Attributes:
        shape: Change of shape.
        dilatation: Relative change of volume.
        motion: The components of the motion itself.
    """

    shape: Float[Array, "3 9 ez er"]
    dilatation: AtPoints
    motion: Float[Array, "9 2 ez er"]


def kinematics(mesh: Mesh, nodal: Nodal) -> Kinematics:
    """Strains and motion at the Gauss points of a field of displacement at the nodes."""
    elements = _gather(nodal)
    found = jnp.dot(_table(), elements.reshape(9, -1)).reshape(3, 9, *elements.shape[1:])
    over_r, over_z, radius = _lengths(mesh)
    along_r, along_z, motion = found
    rr, zz, tt = along_r[:, 0] * over_r, along_z[:, 1] * over_z, motion[:, 0] / radius
    dilatation = rr + zz + tt
    shear = along_z[:, 0] * over_z + along_r[:, 1] * over_r
    shape = jnp.stack([rr - dilatation / 3.0, zz - dilatation / 3.0, shear])
    return Kinematics(shape, dilatation, motion)


def nodal_force(
    mesh: Mesh, stress: Float[Array, "3 9 ez er"], pressure: AtPoints, momentum: Float[Array, "9 2 ez er"]
) -> Nodal:
    """Forces at the nodes, the transpose of `kinematics`.

    Args:
        mesh: Elements.
        stress: What does work on the change of shape, times the volume of the point [N m].
        pressure: What does work on the dilatation (positive in tension), times the volume of the point [N m].
        momentum: What does work on the motion, times the volume of the point [N].
    """
    over_r, over_z, radius = _lengths(mesh)
    mean = pressure - (stress[0] + stress[1]) / 3.0
    along_r = jnp.stack([(stress[0] + mean) * over_r, stress[2] * over_r], axis=1)
    along_z = jnp.stack([stress[2] * over_z, (stress[1] + mean) * over_z], axis=1)
    hoop = jnp.stack([mean / radius, jnp.zeros_like(mean)], axis=1)
    found = jnp.concatenate([along_r, along_z, momentum + hoop])
    return _scatter(jnp.dot(_table().T, found.reshape(27, -1)).reshape(9, *found.shape[1:]))


def deviatoric_stress(weighted: Float[Array, "3 9 ez er"]) -> Float[Array, "3 9 ez er"]:
    """What does work on the change of shape, from 2 G d: the deviator tt, which is not independent, included."""
    rr, zz, shear = weighted
    return jnp.stack([2.0 * rr + zz, rr + 2.0 * zz, 0.5 * shear])


class Volumetric(eqx.Module):
    """Elastic answer to a change of volume, with a pressure that is linear in each element and condensed there.

    Attributes:
        moments: Of a field at the Gauss points with the functions 1, r, z of the element [m^3].
        stiffness: Moments of the dilatation to coefficients of the pressure [Pa/m^3].
    """

    moments: Float[Array, "3 9 ez er"]
    stiffness: Float[Array, "3 3 ez er"]

    def of(self, dilatation: AtPoints) -> Float[Array, "3 ez er"]:
        """Moments of a dilatation [m^3]."""
        return jnp.sum(self.moments * dilatation[None], axis=1)

    def pressure(self, moments: Float[Array, "3 ez er"]) -> AtPoints:
        """Pressure (positive in tension) times the volume of the points [N m], from moments of the dilatation."""
        coefficients = jnp.sum(self.stiffness * moments[None], axis=1)
        return jnp.sum(self.moments * coefficients[:, None], axis=0)


def volumetric(mesh: Mesh, bulk_modulus: AtPoints) -> Volumetric:
    """The answer to a change of volume of a solid with that bulk modulus [Pa]."""
    functions = linear_pressure(_POINTS, _POINTS).T
    moments = functions[:, :, None, None] * volumes(mesh)[None]
    compliance = jnp.einsum("pgzr,qg,gzr->pqzr", moments, functions, 1.0 / bulk_modulus)
    return Volumetric(moments, inverse_of_symmetric(compliance))


def volumes(mesh: Mesh) -> AtPoints:
    """Volume [m^3] that each Gauss point stands for."""
    return jnp.moveaxis(volume_weights(mesh), -1, 0)


def at_points(mesh: Mesh, field: Float[Array, "rq zq"] | Float[np.ndarray, "rq zq"]) -> AtPoints:
    """A field on the tensor grid of Gauss points, sorted by points and elements."""
    return jnp.moveaxis(mesh.element_values(field), -1, 0)


def nodal_mass(mesh: Mesh, inertia: AtPoints) -> Nodal:
    """Diagonal of the mass matrix [kg], the same for both components, from the mass at each Gauss point [kg]."""
    values = _table()[18:]
    elements = jnp.dot((values**2).T, inertia.reshape(9, -1)).reshape(inertia.shape)
    return _scatter(jnp.stack([elements, elements], axis=1))


def _table() -> Float[Array, "27 9"]:
    # Slopes along r and z, and values, of the functions of the nodes at the Gauss points.
    value, slope = quadratic(_POINTS), quadratic_slope(_POINTS)
    return jnp.concatenate([product(slope, value), product(value, slope), product(value, value)])


def _lengths(mesh: Mesh) -> tuple[Float[Array, "1 1 er"], Float[Array, "1 ez 1"], Float[Array, "9 1 er"]]:
    # What slopes are multiplied by, and the radius of the Gauss points.
    radius = np.tile(mesh.gauss_r.reshape(-1, N_GAUSS).T, (N_GAUSS, 1))
    over_r, over_z = 2.0 / np.diff(mesh.r_edges), 2.0 / np.diff(mesh.z_edges)
    return (
        jnp.asarray(over_r, float)[None, None, :],
        jnp.asarray(over_z, float)[None, :, None],
        jnp.asarray(radius, float)[:, None, :],
    )


def _gather(nodal: Nodal) -> Float[Array, "9 2 ez er"]:
    n_z, n_r = nodal.shape[1] // 2, nodal.shape[2] // 2
    return jnp.stack([nodal[:, i : i + 2 * n_z - 1 : 2, j : j + 2 * n_r - 1 : 2] for i in range(3) for j in range(3)])


def _scatter(elements: Float[Array, "9 2 ez er"]) -> Nodal:
    rows = elements.reshape(3, 3, *elements.shape[1:])
    return _join([_join([rows[i, j] for j in range(3)], 2) for i in range(3)], 1)


def _join(parts: list[Array], axis: int) -> Array:
    # Sums first, middle and last node of a line of elements along an axis; neighbours share the last and the first.
    first, middle, last = parts
    n = first.shape[axis]

    def pad(part: Array, before: int, after: int) -> Array:
        return jnp.pad(part, [(before, after) if k == axis else (0, 0) for k in range(part.ndim)])

    pairs = jnp.stack([pad(first, 0, 1) + pad(last, 1, 0), pad(middle, 0, 1)], axis=axis + 1)
    line = pairs.reshape(*first.shape[:axis], 2 * n + 2, *first.shape[axis + 1 :])
    return line[(slice(None),) * axis + (slice(0, 2 * n + 1),)]
