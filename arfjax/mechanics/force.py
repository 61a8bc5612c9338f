"""Radiation force from the nodes of a sound field to the Gauss points of a mesh, none of it lost."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.elements.transfer import projected


class ForceMap(eqx.Module):
    r"""A linear map from a force density on a grid of positions to the Gauss points of a mesh.

    The force density is interpolated by cubics between its positions (evenly across the axis, zero beyond the outermost
    positions) and projected in each element, in the mean square over the volume, onto biquadratic polynomials. So the
    total in every element,

    $$ F = \int f \, 2 \pi r \, dr \, dz , $$

    and every nodal force, are those of the interpolated field to rounding, however the grids lie: a mesh coarser than
    the sound field loses nothing. Density at single points may overshoot where an element is wider than the beam.

    Attributes:
        along_r: Weights of the radial positions.
        along_z: Weights of the axial positions.

    Accuracy: total and nodal forces against the interpolated field: rounding. That field against the true one: fourth
        order in the spacing of the positions. Density at the Gauss points: third order in the element size.
    Differentiability: linear; reverse mode is the transpose.
    """

    along_r: Float[np.ndarray, "rq r"]
    along_z: Float[np.ndarray, "zq z"]

    def __call__(self, force: Float[Array, "r z"] | Float[np.ndarray, "r z"]) -> Float[Array, "rq zq"]:
        """Force density [N/m^3] at the Gauss points."""
        expected = (self.along_r.shape[1], self.along_z.shape[1])
        if force.shape != expected:
            raise InputError(
                f"the force density has shape {force.shape}, its grid has {expected} positions (radial, axial): "
                "make the map for the positions of this field."
            )
        along_r, along_z = (jnp.asarray(each, dtype=float) for each in (self.along_r, self.along_z))
        return along_r @ jnp.asarray(force, dtype=float) @ along_z.T


def force_map(
    mesh: Mesh, r: Float[np.ndarray, " r"], z: Float[np.ndarray, " z"], *, radial_component: bool = False
) -> ForceMap:
    """The map from positions r, z [m] of a sound field to the Gauss points of a mesh.

    Args:
        mesh: The mesh; it may reach beyond the field (there is no force there) or not as far.
        r: Radial positions, ascending from the axis or from the first cell's centre.
        z: Axial positions, ascending, in the coordinates of the mesh.
        radial_component: Whether it is for the radial component, which is odd across the axis.

    Raises:
        InputError: if the positions do not ascend, or the field lies wholly outside the mesh.
    """
    outside = r[0] >= mesh.r_edges[-1] or z[-1] <= mesh.z_edges[0] or z[0] >= mesh.z_edges[-1]
    if outside:
        raise InputError(
            f"the sound field, z = {z[0]:g} to {z[-1]:g} m, misses the mesh, {mesh.z_edges[0]:g} to "
            f"{mesh.z_edges[-1]:g} m, or lies outside its radius. Millimetres, or another origin? Pass metres from the "
            "bowl's apex for both."
        )
    return ForceMap(
        projected(np.asarray(r, float), mesh.r_edges, ring=True, even=not radial_component),
        projected(np.asarray(z, float), mesh.z_edges, ring=False),
    )


def total_force(mesh: Mesh, force: Float[Array, "rq zq"] | Float[np.ndarray, "rq zq"]) -> Float[Array, ""]:
    """Integral of a force density [N/m^3] at the Gauss points over the mesh [N]."""
    rings, heights = (jnp.asarray(each, dtype=float) for each in mesh.gauss_weights)
    return rings @ jnp.asarray(force) @ heights
