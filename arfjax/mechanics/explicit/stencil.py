r"""One step of the explicit scheme, on the flat arrays of `explicit.grid.Layout`.

Stress and strain are those in the middle of a cell; arrays of cells hold stress times volume. The axial strain weighs
inner and outer nodes by the volume that is theirs, as the mass does: on the axis 1/4 and 3/4. Else a wave along z would
push the nodes on the axis with twice the force for their mass. Each branch keeps

$$ m = 2 V \Delta G \, (q - g \, \mathrm{dev}\, \varepsilon), \qquad
   m^{n+1} = d \, m^n - 2 V \Delta G \, g (1 - d) \, \mathrm{dev}\, \varepsilon^n, $$

with the strain q that the branch remembers, its decay d = exp(-dt / tau) and g = (1 - d) tau / dt. This is the
recursion $q^{n+1} = d q^n + g (\varepsilon^{n+1} - \varepsilon^n)$ without the new strain in it.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.mechanics.elements.mesh import Walls
from arfjax.mechanics.explicit.grid import DampingLayer, Layout
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.numerics.decay import mean_decay


class LatticeSolid(eqx.Module):
    """Constants of the stencil.

    Attributes:
        row: Number of axial nodes: the stride between radii.
        across_r: Half of one over the radial size of each cell [1/m].
        across_ring: One over the sum of its nodes' radii, halved [1/m].
        across_z: Half of one over its axial size [1/m].
        tilted: The same times what the outer nodes' share of a disc exceeds the inner nodes' by [1/m].
        lame: Lame's first constant when nothing has relaxed yet, times volume [J].
        twice_shear: Twice the shear modulus that acts against a change within a step, times volume [J].
        hourglass: Stiffness of the two hourglass motions, r and z [N/m].
        decay: Of each branch in a step [1].
        uptake: What each branch takes up, of `m` per strain in a step [J].
        mass: Of the nodes [kg].
        free: One for each component that may move.
        damping: Half of the damping layer's rate times the time step [1]; None without a layer.
        time_step: [s].
    """

    row: int = eqx.field(static=True)
    across_r: Float[Array, " cell"]
    across_ring: Float[Array, " cell"]
    across_z: Float[Array, " cell"]
    tilted: Float[Array, " cell"]
    lame: Float[Array, " cell"]
    twice_shear: Float[Array, " cell"]
    hourglass: Float[Array, "2 cell"]
    decay: Float[Array, "branch cell"]
    uptake: Float[Array, "branch cell"]
    mass: Float[Array, " node"]
    free: Float[Array, "2 node"]
    damping: Float[Array, " node"] | None
    time_step: float = eqx.field(static=True)


class State(eqx.Module):
    """Displacement [m] with a margin of a row and a node at both ends, velocity [m/s] half a step before, memory [J].

    The memory holds the components rr, zz and rz (of the tensor) of each branch.
    """

    displacement: tuple[Float[Array, " margin_node"], Float[Array, " margin_node"]]
    velocity: tuple[Float[Array, " node"], Float[Array, " node"]]
    memory: Float[Array, "3 branch cell"]

    def nodal_displacement(self, row: int) -> Float[Array, "2 node"]:
        """Displacement r, z [m] without the margins."""
        return jnp.stack([component[row + 1 : -(row + 1)] for component in self.displacement])


def solid_of(
    layout: Layout, material: ViscoelasticField, time_step: float, walls: Walls, layer: DampingLayer | None
) -> LatticeSolid:
    """The constants of the stencil for a material at the centres of the cells."""
    dtype = material.density.dtype
    volume, r_size, z_size, ring = (
        jnp.asarray(jnp.broadcast_to(x, layout.grid.shape), dtype)
        for x in (layout.grid.volumes, layout.r_size, layout.z_size, layout.inner + layout.outer)
    )
    decrement = time_step / material.relaxation_times
    lost = -jnp.expm1(-decrement)
    gained = material.branch_shear_moduli * mean_decay(decrement)
    shear = material.relaxed_shear_modulus + jnp.sum(gained, axis=0)
    unrelaxed = material.relaxed_shear_modulus + jnp.sum(material.branch_shear_moduli, axis=0)
    rate = None if layer is None else jnp.asarray(0.5 * time_step * layout.damping_rate(layer, walls).ravel(), dtype)
    return LatticeSolid(
        row=layout.row,
        across_r=layout.cells(0.5 / r_size),
        across_ring=layout.cells(0.5 / ring),
        across_z=layout.cells(0.5 / z_size),
        tilted=layout.cells((2.0 * jnp.asarray(layout.outer_share, dtype) - 1.0) * 0.5 / z_size),
        lame=layout.cells(volume * (material.bulk_modulus - 2.0 / 3.0 * shear)),
        twice_shear=layout.cells(2.0 * volume * shear),
        hourglass=layout.cells((volume * unrelaxed)[None] * jnp.asarray(layout.hourglass, dtype)),
        decay=layout.cells(jnp.exp(-decrement)),
        uptake=layout.cells(2.0 * volume[None] * gained * lost),
        mass=layout.sum_at_nodes(material.density * volume).ravel(),
        free=jnp.asarray(layout.free(walls).reshape(2, -1), dtype),
        damping=rate,
        time_step=time_step,
    )


def at_rest(solid: LatticeSolid) -> State:
    """No displacement, velocity or memory."""
    n_nodes, n_branches, dtype = solid.mass.shape[0], solid.decay.shape[0], solid.mass.dtype
    padded, plain = jnp.zeros(n_nodes + 2 * (solid.row + 1), dtype), jnp.zeros(n_nodes, dtype)
    return State((padded, padded), (plain, plain), jnp.zeros((3, n_branches, solid.lame.shape[0]), dtype))


class Strain(eqx.Module):
    """Strains in the middle of each cell (shear of the tensor, not the engineer's), and the hourglass."""

    rr: Float[Array, " cell"]
    tt: Float[Array, " cell"]
    zz: Float[Array, " cell"]
    rz: Float[Array, " cell"]
    hourglass_r: Float[Array, " cell"]
    hourglass_z: Float[Array, " cell"]

    @property
    def dilatation(self) -> Float[Array, " cell"]:
        """Relative change of volume [1]."""
        return self.rr + self.tt + self.zz

    def deviator(self) -> Float[Array, "3 cell"]:
        """Components rr, zz, rz of the strain without its volumetric part; tt is minus the sum of the first two."""
        third = self.dilatation / 3.0
        return jnp.stack([self.rr - third, self.zz - third, self.rz])


def strain_of(solid: LatticeSolid, displacement: tuple[Array, Array]) -> Strain:
    """Strains of a displacement with margins."""
    mean, along_r, along_z, hourglass_r = _patterns(solid, displacement[0])
    _, axial_along_r, axial_along_z, hourglass_z = _patterns(solid, displacement[1])
    return Strain(
        rr=solid.across_r * along_r,
        tt=solid.across_ring * mean,
        zz=solid.across_z * axial_along_z + solid.tilted * hourglass_z,
        rz=0.5 * (solid.across_z * along_z + solid.across_r * axial_along_r),
        hourglass_r=hourglass_r,
        hourglass_z=hourglass_z,
    )


def _patterns(solid: LatticeSolid, values: Float[Array, " margin_node"]) -> tuple[Array, Array, Array, Array]:
    # Of the four nodes of a cell: sum, outer less inner, upper less lower, diagonal less the other diagonal.
    n_cells, row = solid.lame.shape[0], solid.row
    inner, outer, inner_up, outer_up = (values[first : first + n_cells] for first in (0, row, 1, row + 1))
    rising, falling = outer_up - inner, outer - inner_up
    level, other = outer_up + inner, outer + inner_up
    return level + other, rising + falling, rising - falling, level - other


def internal_force(solid: LatticeSolid, strain: Strain, memory: Float[Array, "3 branch cell"]) -> tuple[Array, Array]:
    """Nodal force [N] with which the solid opposes its strain: the transpose of `strain_of` times the stress."""
    remembered = jnp.sum(memory, axis=1)
    pressure = solid.lame * strain.dilatation
    rr = pressure + solid.twice_shear * strain.rr + remembered[0]
    zz = pressure + solid.twice_shear * strain.zz + remembered[1]
    tt = pressure + solid.twice_shear * strain.tt - remembered[0] - remembered[1]
    rz = solid.twice_shear * strain.rz + remembered[2]
    radial = _at_nodes(
        solid,
        solid.across_ring * tt,
        solid.across_r * rr,
        solid.across_z * rz,
        solid.hourglass[0] * strain.hourglass_r,
    )
    axial = _at_nodes(
        solid,
        jnp.zeros_like(rz),
        solid.across_r * rz,
        solid.across_z * zz,
        solid.hourglass[1] * strain.hourglass_z + solid.tilted * zz,
    )
    return radial, axial


def _at_nodes(
    solid: LatticeSolid, mean: Array, along_r: Array, along_z: Array, hourglass: Array
) -> Float[Array, " node"]:
    # The transpose of `_patterns`, without the margins.
    n_nodes, row = solid.mass.shape[0], solid.row
    even, odd = mean + hourglass, mean - hourglass
    both, difference = along_r + along_z, along_r - along_z
    corners = ((even - both, row + 1), (odd + difference, 1), (odd - difference, row), (even + both, 0))
    first, second, third, fourth = (part[start : start + n_nodes] for part, start in corners)
    return (first + second) + (third + fourth)


def advance(solid: LatticeSolid, state: State, force: tuple[Array, Array]) -> State:
    """The state a step later under a nodal force [N], the mean of the true one over two steps with a hat's weights."""
    strain = strain_of(solid, state.displacement)
    opposed = internal_force(solid, strain, state.memory)
    memory = solid.decay[None] * state.memory - solid.uptake[None] * strain.deviator()[:, None]
    keep, take = 1.0, solid.time_step / solid.mass
    if solid.damping is not None:
        keep, take = (1.0 - solid.damping) / (1.0 + solid.damping), take / (1.0 + solid.damping)
    velocity = tuple(
        keep * old + (free * take) * (pushed - back)
        for old, free, pushed, back in zip(state.velocity, solid.free, force, opposed, strict=True)
    )
    inside = slice(solid.row + 1, -(solid.row + 1))
    displacement = tuple(
        old.at[inside].add(solid.time_step * speed) for old, speed in zip(state.displacement, velocity, strict=True)
    )
    return State((displacement[0], displacement[1]), (velocity[0], velocity[1]), memory)
