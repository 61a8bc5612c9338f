"""Shapes of motion from pushes of the full solid, and the points at which to look at an inclusion.

Shapes are the principal ones of displacements on the way (proper orthogonal decomposition) in the norm of the matrix
that a step solves with. Points come from the Gauss points of the mesh by empirical cubature, so that the force of the
inclusion in the motions seen is right.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from arfjax.errors import InputError
from arfjax.mechanics.elements.axisymmetric import load
from arfjax.mechanics.elements.gauss_points import (
    Nodal,
    at_points,
    kinematics,
    volumes,
    volumetric,
)
from arfjax.mechanics.elements.mesh import Mesh, interpolation_weights
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.mechanics.reduced.solid import ReducedSolid, pairs
from arfjax.mechanics.transient.march import Loads, Scheme, acceleration, factor_of_a_step, march, prepare
from arfjax.mechanics.transient.push import PushSettings
from arfjax.numerics.cubature import few_points


def push_snapshots(
    mesh: Mesh,
    material: ViscoelasticField,
    force: Float[Array, "rq zq"],
    settings: PushSettings,
    moments: Int[np.ndarray, " moment"],
) -> Float[Array, "moment 2 row column"]:
    """Displacement of all nodes [m] in a push by an axial force density [N/m^3] after some numbers of steps."""
    nodal = jnp.asarray(mesh.free, dtype=float) * load(
        mesh, mesh.element_values(force), mesh.element_values(jnp.zeros_like(force))
    )
    nodal = nodal.transpose(2, 0, 1)
    scheme = Scheme(settings.time_step, settings.spectral_radius)
    solid = prepare(mesh, material, settings.time_step)
    balance = settings.course[:, None, None, None] * nodal[None]
    factor = factor_of_a_step(mesh, scheme, material, backend=settings.backend)
    loads = Loads(balance, settings.jumps, acceleration(mesh, solid, nodal))
    changes = march(mesh, scheme, solid, factor, loads)
    return jnp.cumsum(changes, axis=0)[moments - 1]


class Shapes(eqx.Module):
    """Shapes of motion of a mesh, and their strains at the Gauss points.

    Attributes:
        nodal: Displacement of the nodes.
        solid: What a uniform solid makes of them; with no points.
        shape: Change of shape, times what makes its square the energy's integrand.
        dilatation: Linear part of the dilatation in each element, weighted likewise.
    """

    nodal: Float[np.ndarray, "mode 2 row column"]
    solid: ReducedSolid
    shape: Float[np.ndarray, "3 point mode"]
    dilatation: Float[np.ndarray, "point mode"]


def principal_shapes(
    mesh: Mesh,
    snapshots: Float[np.ndarray, "snapshot 2 row column"],
    *,
    shear_modulus: float,
    bulk_modulus: float,
    inertia: float,
    n_modes: int,
    focus: float,
) -> Shapes:
    """The leading principal shapes of displacements, of unit energy, the most frequent first.

    Args:
        mesh: Elements and walls.
        snapshots: Displacements, of comparable size.
        shear_modulus: Of the solid whose energy is the norm [Pa].
        bulk_modulus: Of that solid [Pa].
        inertia: Of that norm: density over the square of a time [kg/(m^3 s^2)].
        n_modes: How many are wanted.
        focus: Axial position on the axis where the displacement is wanted [m].

    Raises:
        InputError: if the displacements span fewer shapes than are wanted, to the rounding of their energies.
    """
    motion, shape, dilatation = (np.asarray(part) for part in _strains(mesh, snapshots))
    weights = (np.sqrt(inertia), np.sqrt(2.0 * shear_modulus), np.sqrt(bulk_modulus))
    gram = sum(
        weight**2 * (part.reshape(len(snapshots), -1) @ part.reshape(len(snapshots), -1).T)
        for weight, part in zip(weights, (motion, shape, dilatation), strict=True)
    )
    energy, vectors = np.linalg.eigh(gram)
    # An energy is a square: its rounding is already half of the digits of a displacement.
    spanned = int(np.sum(energy > len(energy) * np.finfo(energy.dtype).eps * energy[-1]))
    if n_modes > spanned:
        raise InputError(
            f"{n_modes} shapes of motion were asked for, but the {len(snapshots)} displacements span {spanned}: ask "
            "for fewer, or push at more places or in more materials."
        )
    mixing = vectors[:, ::-1][:, :n_modes] / np.sqrt(energy[::-1][:n_modes])
    nodal, motion, shape, dilatation = (
        np.tensordot(mixing, part, axes=(0, 0)) for part in (snapshots, motion, shape, dilatation)
    )
    flat = [part.reshape(n_modes, -1) for part in (motion, shape, dilatation)]
    at_axis = np.asarray(interpolation_weights(mesh.z_edges, [focus]))[0]
    mass, deviatoric, volumetric_stiffness = (jnp.asarray(part @ part.T) for part in flat)
    solid = ReducedSolid(
        mass=mass,
        deviatoric=deviatoric,
        beside_points=deviatoric,
        volumetric=volumetric_stiffness,
        shape=jnp.zeros((3, 0, n_modes)),
        shape_pairs=jnp.zeros((0, n_modes * (n_modes + 1) // 2)),
        dilatation_pairs=jnp.zeros((0, n_modes * (n_modes + 1) // 2)),
        at_focus=jnp.asarray(nodal[:, 1, :, 0] @ at_axis),
        r=jnp.zeros(0),
        z=jnp.zeros(0),
    )
    return Shapes(nodal, solid, np.moveaxis(shape, 0, -1), dilatation.T)


class Sample(eqx.Module):
    """A motion and the solid in which it was seen, for the choice of points.

    Attributes:
        displacement: Of the nodes.
        shear_excess: Shear modulus above that of the surroundings at the Gauss points [Pa].
        bulk_excess: Bulk modulus likewise [Pa].
    """

    displacement: Float[np.ndarray, "2 row column"]
    shear_excess: Float[np.ndarray, "rq zq"]
    bulk_excess: Float[np.ndarray, "rq zq"]


def with_points(
    mesh: Mesh,
    shapes: Shapes,
    samples: Sequence[Sample],
    *,
    tolerance: float,
    n_combinations: int = 600,
    seed: int = 0,
) -> ReducedSolid:
    """The shapes with the points at which the inclusion's force in all samples is right to a tolerance.

    Random combinations of the forces on all shapes in all samples are integrated: more of them than there will be
    points stand for all.

    Raises:
        InputError: if the inclusion is nowhere in any sample.
    """
    excess = [
        np.stack([np.asarray(at_points(mesh, field)).ravel() for field in (each.shear_excess, each.bulk_excess)])
        for each in samples
    ]
    candidates = np.flatnonzero(np.any([_felt(each) for each in excess], axis=0))
    if not candidates.size:
        raise InputError("no draw has a lesion in any state: there is nothing to choose points by.")
    rng = np.random.default_rng(seed)
    shape, dilatation = shapes.shape[:, candidates], shapes.dilatation[candidates]
    total = np.zeros((n_combinations, len(candidates)))
    _, *strains = (np.asarray(part) for part in _strains(mesh, np.stack([each.displacement for each in samples])))
    for number, moduli in enumerate(excess):
        seen = [part[number][..., candidates] for part in strains]
        combined = rng.normal(size=(2, n_combinations, shape.shape[-1]))
        for component in range(3):
            of_modes = shape[component] * (2.0 * moduli[0, candidates] * seen[0][component])[:, None]
            total += combined[0] @ of_modes.T
        total += combined[1] @ (dilatation * (moduli[1, candidates] * seen[1])[:, None]).T
    chosen, weights = few_points(total, tolerance=tolerance)
    root = np.sqrt(weights)[:, None]
    r, z = _places(mesh)
    places = candidates[chosen]
    at_points_chosen = shape[:, chosen] * root[None]
    return dataclasses.replace(
        shapes.solid,
        beside_points=shapes.solid.deviatoric - np.einsum("cpm,cpn->mn", at_points_chosen, at_points_chosen),
        shape=jnp.asarray(at_points_chosen),
        shape_pairs=jnp.asarray(pairs(at_points_chosen)),
        dilatation_pairs=jnp.asarray(pairs((dilatation[chosen] * root)[None])),
        r=jnp.asarray(r[places]),
        z=jnp.asarray(z[places]),
    )


def _felt(excess: Float[np.ndarray, "modulus point"]) -> Bool[np.ndarray, " point"]:
    """Where an inclusion is more than rounding: a damaged tissue's share fades without an end."""
    largest = np.max(np.abs(excess), axis=1, keepdims=True)
    return np.any(np.abs(excess) > 1e-6 * largest, axis=0)


def reduced_force(mesh: Mesh, shapes: Shapes, force: Float[Array, "rq zq"]) -> Float[Array, " mode"]:
    """Work [N] of an axial force density [N/m^3] on a unit of each shape."""
    nodal = load(mesh, mesh.element_values(force), mesh.element_values(jnp.zeros_like(force)))
    return jnp.einsum("mzr,zr->m", jnp.asarray(shapes.nodal[:, 1]), nodal[..., 1])


def _places(mesh: Mesh) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
    """Radius and axial position of all Gauss points, in the order of the strains."""
    grid = np.meshgrid(mesh.gauss_r, mesh.gauss_z, indexing="ij")
    r, z = (np.asarray(at_points(mesh, each)).ravel() for each in grid)
    return r, z


def _strains(mesh: Mesh, displacements: Float[np.ndarray, "snapshot 2 row column"]) -> tuple[Array, Array, Array]:
    """Motion, change of shape and dilatation at all Gauss points, times the roots of the volumes."""
    volume = volumes(mesh)
    root = jnp.sqrt(volume)

    def weighted(nodal: Nodal) -> tuple[Array, Array, Array]:
        moved = kinematics(mesh, nodal)
        rr, zz, shear = moved.shape
        # Orthogonal components: the sum of their squares is rr^2 + zz^2 + tt^2 + shear^2 / 2.
        shape = jnp.stack([np.sqrt(2.0) * (rr + 0.5 * zz), np.sqrt(1.5) * zz, np.sqrt(0.5) * shear])
        answer = volumetric(mesh, jnp.ones_like(volume))
        dilatation = answer.pressure(answer.of(moved.dilatation)) / volume
        parts = (root[None] * jnp.moveaxis(moved.motion, 1, 0), root[None] * shape, root * dilatation)
        motion, change, volumetric_part = (part.reshape(*part.shape[:-3], -1) for part in parts)
        return motion, change, volumetric_part

    return jax.jit(lambda many: jax.lax.map(weighted, many))(jnp.asarray(displacements))
