"""Where the work of a push goes in the explicit path: an audit, not part of a run."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.explicit.grid import Layout
from arfjax.mechanics.explicit.settings import ExplicitSettings
from arfjax.mechanics.explicit.solver import assemble_push, course_of
from arfjax.mechanics.explicit.stencil import LatticeSolid, State, Strain, advance, at_rest, internal_force, strain_of
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.numerics.decay import mean_decay


class EnergyBalance(eqx.Module):
    """Energies [J] half a step after each of `settings.times` but the last, sums since the start where they flow.

    Attributes:
        work: Done by the force.
        kinetic: Of the nodes.
        taken_up: Work done on the solid: stored or dissipated. Work is kinetic energy plus this plus what the layer
            took, to rounding, for every material and step.
        stored: In the solid: change of volume and shape, branches, hourglass. A product of strains at both ends of the
            step, with which an elastic solid stores what it takes up to rounding.
        dissipated: By the branches. What is taken up is stored or dissipated to second order in the step.
        damped: By the damping layer.
    """

    work: Float[Array, "*step"]
    kinetic: Float[Array, "*step"]
    taken_up: Float[Array, "*step"]
    stored: Float[Array, "*step"]
    dissipated: Float[Array, "*step"]
    damped: Float[Array, "*step"]


def energy_balance(
    grid: AxisymmetricGrid,
    material: ViscoelasticField,
    axial_force: Float[Array, "r_node z_node"],
    *,
    settings: ExplicitSettings,
    **others: Any,
) -> EnergyBalance:
    """Energies over the run that `solve_push_explicitly` makes with the same arguments.

    Args:
        grid: As there.
        material: As there.
        axial_force: As there.
        settings: As there; maps and checkpoints do nothing.
        others: `radial_force`, `amplitude`, `walls`, `damping`, as there.
    """
    amplitude = course_of(others.pop("amplitude", None), settings, material.density.dtype)
    solid, force, weights = assemble_push(grid, material, axial_force, settings=settings, amplitude=amplitude, **others)
    branches = _Branches(Layout(grid), material, settings.time_step)
    bulk = Layout(grid).cells(material.bulk_modulus * jnp.asarray(grid.volumes, material.density.dtype))
    relaxed = Layout(grid).cells(material.relaxed_shear_modulus * jnp.asarray(grid.volumes, material.density.dtype))

    def step(before: State, weight: Float[Array, ""]) -> tuple[State, EnergyBalance]:
        after = advance(solid, before, (weight * force[0], weight * force[1]))
        old, new = strain_of(solid, before.displacement), strain_of(solid, after.displacement)
        opposed = internal_force(solid, old, before.memory)
        path = [0.5 * solid.time_step * (a + b) for a, b in zip(before.velocity, after.velocity, strict=True)]
        old_branches = branches.stress(before.memory, old)
        elastic = jnp.sum(bulk * old.dilatation * new.dilatation) + 2.0 * jnp.sum(relaxed * _contract(old, new))
        hourglass = jnp.sum(solid.hourglass[0] * old.hourglass_r * new.hourglass_r) + jnp.sum(
            solid.hourglass[1] * old.hourglass_z * new.hourglass_z
        )
        stored = 0.5 * (elastic + hourglass) + branches.stored(old_branches, branches.stress(after.memory, new))
        return after, EnergyBalance(
            work=weight * jnp.sum(jnp.stack(force) * jnp.stack(path)),
            kinetic=0.5 * jnp.sum(solid.mass[None] * jnp.stack(after.velocity) ** 2),
            taken_up=jnp.sum(jnp.stack(opposed) * jnp.stack(path)),
            stored=stored,
            dissipated=settings.time_step * branches.dissipated(old_branches),
            damped=_damped(solid, path),
        )

    _, flows = jax.lax.scan(step, at_rest(solid), weights)
    return EnergyBalance(
        work=jnp.cumsum(flows.work),
        kinetic=flows.kinetic,
        taken_up=jnp.cumsum(flows.taken_up),
        stored=flows.stored,
        dissipated=jnp.cumsum(flows.dissipated),
        damped=jnp.cumsum(flows.damped),
    )


def _contract(old: Strain, new: Strain) -> Float[Array, " cell"]:
    return _double(old.deviator(), new.deviator())


def _double(one: Float[Array, "3 *any cell"], other: Float[Array, "3 *any cell"]) -> Float[Array, "*any cell"]:
    # Double contraction of two deviators given by rr, zz, rz.
    hoop = (one[0] + one[1]) * (other[0] + other[1])
    return one[0] * other[0] + one[1] * other[1] + hoop + 2.0 * one[2] * other[2]


def _damped(solid: LatticeSolid, path: list[Array]) -> Float[Array, ""]:
    if solid.damping is None:
        return jnp.zeros((), solid.mass.dtype)
    weight = 2.0 * solid.damping * solid.mass / solid.time_step**2
    return jnp.sum(weight[None] * jnp.stack(path) ** 2)


class _Branches:
    """Energies of the branches from the stress times volume that each remembers."""

    def __init__(self, layout: Layout, material: ViscoelasticField, time_step: float):
        volumes = jnp.asarray(layout.grid.volumes, material.density.dtype)[None]
        decrement = time_step / material.relaxation_times
        self.gain = layout.cells(2.0 * volumes * material.branch_shear_moduli * mean_decay(decrement))
        stiffness = 2.0 * volumes * material.branch_shear_moduli
        exists = stiffness != 0.0
        self.compliance = layout.cells(jnp.where(exists, 1.0 / jnp.where(exists, stiffness, 1.0), 0.0))
        self.rate = layout.cells(1.0 / material.relaxation_times)

    def stress(self, memory: Float[Array, "3 branch cell"], strain: Strain) -> Float[Array, "3 branch cell"]:
        return memory + self.gain[None] * strain.deviator()[:, None]

    def stored(self, old: Float[Array, "3 branch cell"], new: Float[Array, "3 branch cell"]) -> Float[Array, ""]:
        return 0.5 * jnp.sum(self.compliance * _double(old, new))

    def dissipated(self, stress: Float[Array, "3 branch cell"]) -> Float[Array, ""]:
        return jnp.sum(self.rate * self.compliance * _double(stress, stress))
