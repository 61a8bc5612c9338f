r"""Motion that is harmonic in time, of a viscoelastic solid under a radiation force that is.

$$ \left( K(G^*(\omega)) - \omega^2 M \right) u = f , \qquad u(t) = \mathrm{Re} \, u \, e^{+ i \omega t} , $$

on the elements of the transient solver. The matrix is complex symmetric, not Hermitian: one sparse factorisation
serves the solution, its tangent and its adjoint. `periodic.py` sums such motions for a force that is periodic.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Complex, Float

from arfjax.errors import InputError
from arfjax.mechanics.elements.axisymmetric import STRESS_OVER_STRAIN, deviator, load, strains, volume_weights
from arfjax.mechanics.elements.mesh import Mesh, interpolation_weights
from arfjax.mechanics.elements.pattern import displacement_pattern
from arfjax.mechanics.harmonic.absorbing import AbsorbingLayer, StretchedMesh, dynamic_stiffness, stretched
from arfjax.mechanics.material.harmonic import HarmonicMaterial, harmonic_field
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.media import Scalar
from arfjax.numerics.assembly import gather
from arfjax.numerics.sparse_direct import linear_solve

ForceField = Float[Array, "rq zq"] | Float[np.ndarray, "rq zq"]


class HarmonicResult(eqx.Module):
    """Complex amplitudes of a motion: displacement(t) = Re(amplitude exp(+i omega t)).

    Attributes:
        frequency: [Hz].
        displacement: Amplitude r, z [m] at the nodes of the mesh (`mesh.node_r`, `mesh.node_z`), layers left out.
        r_edges: Radial element edges [m].
        z_edges: Axial element edges [m].
    """

    frequency: Float[Array, ""]
    displacement: Complex[Array, "r z 2"]
    r_edges: Float[Array, " n_r_edges"]
    z_edges: Float[Array, " n_z_edges"]

    def at_focus(self, z: Scalar) -> Complex[Array, ""]:
        """Axial amplitude [m] on the axis at `z` [m], interpolated quadratically; NaN outside the mesh."""
        weights = interpolation_weights(self.z_edges, jnp.asarray(z, dtype=float)[None])[0]
        return self.displacement[0, :, 1] @ weights

    def at_points(self, points: Float[np.ndarray, "point 2"] | Float[Array, "point 2"]) -> Complex[Array, "point 2"]:
        """Amplitude r, z [m] at positions r, z [m], interpolated quadratically; NaN outside the mesh."""
        weights_r = interpolation_weights(self.r_edges, points[:, 0])
        weights_z = interpolation_weights(self.z_edges, points[:, 1])
        return jnp.einsum("pr,pz,rzc->pc", weights_r, weights_z, self.displacement)


class PowerBalance(eqx.Module):
    """Mean powers [W] over a period; the first equals the sum of the others.

    Attributes:
        supplied: By the force.
        dissipated: By the viscosity of the tissue.
        radiated: Into the absorbing layer.
    """

    supplied: Float[Array, ""]
    dissipated: Float[Array, ""]
    radiated: Float[Array, ""]


def solve_harmonic(
    mesh: Mesh,
    material: HarmonicMaterial | ViscoelasticField,
    axial_force: ForceField,
    *,
    frequency: Scalar,
    layer: AbsorbingLayer | None = AbsorbingLayer(),  # noqa: B008  (frozen)
    radial_force: ForceField | None = None,
) -> HarmonicResult:
    """Steady motion of a solid under a force that varies as cos(omega t).

    Args:
        mesh: Elements and walls.
        material: The solid at the Gauss points `mesh.gauss_r`, `mesh.gauss_z`: the one of a transient run, or with the
            exact modulus of a fractional solid (`solid_field`).
        axial_force: Amplitude of the force density along z at the Gauss points [N/m^3]. It ends where the mesh ends.
        frequency: Of the motion [Hz], not negative. At 0 the motion is static: it exists where the relaxed shear
            modulus is positive, and the layer is then no more than a wide box, whose relative error is about the
            length of the force region over the thickness of the layer.
        layer: Tissue without end beyond the mesh, as it is at its edge; None for the walls of the mesh itself (at
            50 Hz the paper's box is wrong by 10 to 40 %).
        radial_force: Amplitude of the force density along r at the Gauss points [N/m^3]; none if not given.

    Raises:
        InputError: if a field does not have the shape of the grid of Gauss points, or the frequency is negative.

    Accuracy: third order in the element size (displacement). A force of 0.6 mm by 3.8 mm (1/e radii) at 50 Hz in tissue
        with waves of 40 mm, mesh of 11 mm by 24 mm, in parts of the largest amplitude: 7e-4 with elements of 0.3 mm by
        1.2 mm at the focus (5900 unknowns, layer included), 3e-4 at 0.15 mm by 0.6 mm (9200), 9e-5 at 0.1 mm by 0.4 mm
        (11300). See `AbsorbingLayer` for what the layer adds, and `layer_error` for a check.
    Differentiability: in material, force and frequency, forward and reverse, by one more solve with the same factor.
    """
    problem = _pose(mesh, material, axial_force, radial_force, frequency, layer)
    nodal = problem.solve()
    return HarmonicResult(
        frequency=jnp.asarray(frequency, dtype=float),
        displacement=problem.space.inner(nodal).transpose(1, 0, 2),
        r_edges=jnp.asarray(mesh.r_edges, dtype=float),
        z_edges=jnp.asarray(mesh.z_edges, dtype=float),
    )


def layer_error(
    mesh: Mesh,
    material: HarmonicMaterial | ViscoelasticField,
    axial_force: ForceField,
    *,
    frequency: Scalar,
    layer: AbsorbingLayer,
    radial_force: ForceField | None = None,
) -> Float[Array, ""]:
    """Error that the layer makes, as a share of the largest amplitude: by a second solve with a better layer.

    The motion does not depend on a layer that is good enough, so that the change with a layer four times as thick and
    with finer elements measures its error. Arguments as of `solve_harmonic`.

    Accuracy: within a factor of two of the error measured against exact solutions, where that is above 1e-4.
    """

    def motion(which: AbsorbingLayer) -> Complex[Array, "r z 2"]:
        return solve_harmonic(
            mesh, material, axial_force, frequency=frequency, layer=which, radial_force=radial_force
        ).displacement

    better = motion(layer.refined())
    return jnp.max(jnp.abs(motion(layer) - better)) / jnp.max(jnp.abs(better))


def power_balance(
    mesh: Mesh,
    material: HarmonicMaterial | ViscoelasticField,
    axial_force: ForceField,
    *,
    frequency: Scalar,
    layer: AbsorbingLayer | None = AbsorbingLayer(),  # noqa: B008  (frozen)
    radial_force: ForceField | None = None,
) -> PowerBalance:
    """Where the power of the force goes, each share from its own integral. Arguments as of `solve_harmonic`."""
    problem = _pose(mesh, material, axial_force, radial_force, frequency, layer)
    nodal = problem.solve()
    tissue, elements = problem.space.tissue, problem.of_elements(nodal)
    shape_change = deviator(strains(problem.space.mesh, elements.reshape(*elements.shape[:2], 9, 2))[tissue])
    squared = jnp.einsum("c,zrgc->zrg", STRESS_OVER_STRAIN, jnp.abs(shape_change) ** 2)
    loss = problem.shear_modulus.imag * volume_weights(problem.space.mesh)
    work = jnp.einsum("zri,zrij,zrj->zr", elements.conj(), problem.matrices, elements).imag
    half_omega = jnp.pi * frequency
    return PowerBalance(
        supplied=-half_omega * jnp.sum(problem.force * nodal.imag),
        dissipated=half_omega * jnp.sum(loss[tissue] * squared),
        radiated=half_omega * (jnp.sum(work) - jnp.sum(work[tissue])),
    )


class _Problem(eqx.Module):
    """Matrices and force of the whole mesh, layers included; arrays sorted by elements or nodes."""

    space: StretchedMesh
    shear_modulus: Complex[Array, "ez er 9"]
    matrices: Complex[Array, "ez er 18 18"]
    force: Float[Array, "row column 2"]

    def solve(self) -> Complex[Array, "row column 2"]:
        """Amplitude of the nodes."""
        pattern = displacement_pattern(self.space.mesh)
        values = pattern.assemble(self.matrices.reshape(-1, 18, 18))
        components = self.force.transpose(2, 0, 1)
        solution = linear_solve(pattern, values, components.ravel().astype(values.dtype))
        return solution.reshape(components.shape).transpose(1, 2, 0)

    def of_elements(self, nodal: Complex[Array, "row column 2"]) -> Complex[Array, "ez er 18"]:
        """Nodal values of each element."""
        return gather(nodal).reshape(*self.matrices.shape[:2], 18)


def _pose(
    mesh: Mesh,
    material: HarmonicMaterial | ViscoelasticField,
    axial_force: ForceField,
    radial_force: ForceField | None,
    frequency: Scalar,
    layer: AbsorbingLayer | None,
) -> _Problem:
    radial_force = jnp.zeros_like(axial_force) if radial_force is None else radial_force
    if not isinstance(frequency, Tracer) and not float(frequency) >= 0.0:
        raise InputError(f"`frequency` must not be negative, got {frequency} Hz.")
    omega = 2.0 * jnp.pi * jnp.asarray(frequency, dtype=float)
    field = harmonic_field(material, omega)
    _refuse_other_shapes(mesh, axial_force=axial_force, radial_force=radial_force, **vars(field))
    space = stretched(mesh, layer)
    density, bulk, shear = (
        space.mesh.element_values(space.extend(values))
        for values in (field.density, field.bulk_modulus, field.shear_modulus)
    )
    axial, radial = (
        space.mesh.element_values(space.extend_by_zero(jnp.asarray(part, dtype=float)))
        for part in (axial_force, radial_force)
    )
    return _Problem(
        space=space,
        shear_modulus=shear,
        matrices=dynamic_stiffness(space, density, bulk, shear, omega),
        force=jnp.asarray(space.mesh.free, dtype=float) * load(space.mesh, axial, radial),
    )


def _refuse_other_shapes(mesh: Mesh, **fields: Array | np.ndarray) -> None:
    expected = (len(mesh.gauss_r), len(mesh.gauss_z))
    for name, field in fields.items():
        if field.shape != expected:
            raise InputError(
                f"`{name}` must have shape {expected}, radial and axial Gauss points of the mesh, got {field.shape}. "
                "Evaluate it at `mesh.gauss_r` and `mesh.gauss_z`; layers are added to it here."
            )
