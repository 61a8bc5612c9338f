"""Pushes of the full solid from which a `FastCurve` learns in which shapes the liver moves."""

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.mechanics.reduced.basis import Sample, Shapes, principal_shapes, push_snapshots
from arfjax.model import Model
from arfjax.protocols.discretisation import Discretisation
from arfjax.protocols.fast_curve import FastCurve
from arfjax.protocols.heated_tissue import push_material
from arfjax.protocols.sound_table import SoundTable
from arfjax.protocols.stepwise import StepwiseProtocol, lesion_at, lesion_share


class Pushed(eqx.Module):
    """A push of the full solid.

    Attributes:
        displacement: Of the nodes at some moments [m].
        shear_excess: Shear modulus of the lesion above liver's half-way through the push [Pa]; zero outside it.
        bulk_excess: Bulk modulus likewise [Pa].
        liver: Shear modulus [Pa], bulk modulus [Pa] and density [kg/m^3].
    """

    displacement: Float[Array, "moment 2 row column"]
    shear_excess: Float[Array, "rq zq"]
    bulk_excess: Float[Array, "rq zq"]
    liver: Float[Array, "3"]


@dataclasses.dataclass(frozen=True)
class Seen:
    """A push, its displacements scaled to a largest of 1 at the end.

    Attributes:
        displacement: Of the nodes at some moments.
        samples: Motions at half time and at the end with the lesion; none without one.
        liver: As in `Pushed`.
    """

    displacement: Float[np.ndarray, "moment 2 row column"]
    samples: list[Sample]
    liver: Float[np.ndarray, "3"]


def push_of(
    fast: FastCurve, protocol: StepwiseProtocol, forces: SoundTable, mesh: Mesh, n_moments: int
) -> Callable[[Model, Array], Pushed]:
    """The push of the full solid that a model gives at a temperature [degC], compiled.

    Args:
        fast: Whose sonication and lesion.
        protocol: What is done to the tissue.
        forces: Force density [N/m^3] at the Gauss points of the mesh, in the place of the heat.
        mesh: Of the solid.
        n_moments: How many displacements are kept.
    """
    steps = protocol.push_steps(fast.settings)
    moments = np.unique(np.ceil(np.linspace(0.0, 1.0, n_moments + 1)[1:] * steps.n_steps).astype(int))

    def half_way(material: ViscoelasticField) -> Array:
        kept = jnp.exp(-0.5 * protocol.push_duration / material.relaxation_times)
        return material.relaxed_shear_modulus + jnp.sum(material.branch_shear_moduli * kept, axis=0)

    def run(model: Model, temperature: Array) -> Pushed:
        heating = fast.heating(model, protocol)
        size = lesion_at(model, heating, temperature, fast.settings)
        share = lesion_share(model, heating, temperature, size, fast.settings, mesh)
        material, liver = (push_material(model, temperature, each) for each in (share, jnp.zeros((1, 1))))
        around = jnp.stack([each[0, 0] for each in (half_way(liver), liver.bulk_modulus, liver.density)])
        return Pushed(
            push_snapshots(mesh, material, forces.heat_at(model, temperature), steps, moments),
            jnp.where(share > 0.0, half_way(material) - around[0], 0.0),
            jnp.where(share > 0.0, material.bulk_modulus - around[1], 0.0),
            around,
        )

    return jax.jit(run)


def seen(push: Pushed) -> Seen:
    """What is learnt from a push."""
    moved = np.asarray(push.displacement)
    moved = moved / np.max(np.abs(moved[-1]))
    shear, bulk = np.asarray(push.shear_excess), np.asarray(push.bulk_excess)
    times = sorted({len(moved) // 2, len(moved) - 1}) if np.any(shear != 0.0) else []
    return Seen(moved, [Sample(moved[time], shear, bulk) for time in times], np.asarray(push.liver))


def shapes_of(pushes: Sequence[Seen], settings: Discretisation, *, duration: float, n_modes: int) -> Shapes:
    """Shapes of motion from pushes of that length [s], in the norm of the median liver."""
    shear, bulk, density = np.median([push.liver for push in pushes], axis=0)
    return principal_shapes(
        settings.mesh,
        np.concatenate([push.displacement for push in pushes]),
        shear_modulus=float(shear),
        bulk_modulus=float(bulk),
        inertia=float(density) / (duration / 4.0) ** 2,
        n_modes=n_modes,
        focus=settings.focus,
    )
