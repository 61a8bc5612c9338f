"""Steps of the explicit path: how long they may be, and how many."""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.elements.mesh import Wall, Walls
from arfjax.mechanics.explicit.grid import Layout
from arfjax.mechanics.explicit.stencil import LatticeSolid, at_rest, internal_force, solid_of, strain_of
from arfjax.mechanics.material.viscoelastic import ViscoelasticField


class ExplicitSettings(eqx.Module):
    """Steps in time, and what is kept of them. `explicit_settings` chooses them for a material.

    Attributes:
        time_step: [s].
        n_steps: Number of steps; the run ends at `n_steps * time_step`.
        push_duration: The force is on from 0 to here [s]; it need not fall on a step.
        n_maps: Displacement of all nodes is kept this many times, evenly spaced, the last at the end.
        steps_per_checkpoint: The reverse mode keeps the state (displacement, velocity, memory of the branches) at every
            so many steps, and within the stretch that it is at at every step: least memory at the root of the steps.
    """

    time_step: float = eqx.field(static=True)
    n_steps: int = eqx.field(static=True)
    push_duration: float = eqx.field(static=True)
    n_maps: int = eqx.field(static=True, default=1)
    steps_per_checkpoint: int = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        """Refuse what is not positive, and numbers of steps that do not divide evenly."""
        if not (self.time_step > 0.0 and self.n_steps >= 1 and self.push_duration > 0.0):
            raise InputError(
                "`time_step`, `n_steps` and `push_duration` must be positive, got "
                f"{self.time_step} s, {self.n_steps}, {self.push_duration} s."
            )
        if self.n_maps < 1 or self.steps_per_checkpoint < 1 or self.n_steps % (self.n_maps * self.steps_per_checkpoint):
            raise InputError(
                f"`n_steps` {self.n_steps} must be a multiple of `n_maps` {self.n_maps} times `steps_per_checkpoint` "
                f"{self.steps_per_checkpoint}: let `explicit_settings` choose them."
            )

    @property
    def times(self) -> Float[np.ndarray, " time"]:
        """Times [s] of the histories, from 0."""
        return self.time_step * np.arange(self.n_steps + 1)

    @property
    def map_times(self) -> Float[np.ndarray, " map"]:
        """Times [s] of the maps."""
        return self.times[:: self.n_steps // self.n_maps][1:]

    @property
    def doubled(self) -> "ExplicitSettings":
        """The same run in half as many steps."""
        if self.n_steps % (2 * self.n_maps):
            raise InputError(
                f"the estimate of the error halves the steps: `n_steps` {self.n_steps} must be a multiple of twice "
                f"`n_maps` {self.n_maps}; let `explicit_settings` choose them, or give `estimate_error=False`."
            )
        n_steps = self.n_steps // 2
        stretch = math.gcd(n_steps // self.n_maps, self.steps_per_checkpoint)
        return ExplicitSettings(2.0 * self.time_step, n_steps, self.push_duration, self.n_maps, stretch)


def explicit_settings(
    grid: AxisymmetricGrid,
    material: ViscoelasticField,
    *,
    end: float,
    push_duration: float,
    courant_number: float = 0.9,
    n_maps: int = 1,
) -> ExplicitSettings:
    """Steps for a material of concrete numbers (a batch along leading axes too), the largest that are safe.

    Args:
        grid: Cells.
        material: At the centres of the cells.
        end: End of the run [s].
        push_duration: The force is on from 0 to here [s].
        courant_number: Share of the longest stable step to take, up to 1.
        n_maps: How many maps to keep, evenly spaced in time.

    Raises:
        InputError: if the material is traced, makes no wave speed, or a number makes no sense.
    """
    if not (end > 0.0 and 0.0 < courant_number <= 1.0 and n_maps >= 1):
        raise InputError(
            "`end` and `n_maps` must be positive and `courant_number` between 0 and 1, got "
            f"{end} s, {n_maps}, {courant_number}."
        )
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(material)):
        raise InputError(
            "the number of steps cannot depend on a traced material: choose the settings outside of `jit`, for the "
            "stiffest material to come."
        )
    longest = float(jnp.min(longest_stable_step(grid, material)))
    if not (0.0 < longest < math.inf):
        raise InputError(f"the material gives a longest stable step of {longest} s: check moduli and density.")
    fewest = math.ceil(end / (courant_number * longest) / n_maps * (1.0 - 1e-12))
    stretch, n_steps = _even_stretches(fewest)
    return ExplicitSettings(float(end) / (n_maps * n_steps), n_maps * n_steps, float(push_duration), n_maps, stretch)


def _even_stretches(fewest: int) -> tuple[int, int]:
    """Length of a stretch between checkpoints, near the root of the steps, and steps that are a whole number of them.

    Both are even, so that half as many steps divide in the same way.
    """
    root = math.isqrt(fewest)
    lengths = [n for n in range(max(2, root // 2), max(2, 2 * root) + 1) if n % 2 == 0]
    return min(((n, n * math.ceil(fewest / n)) for n in lengths), key=lambda pair: (pair[1], abs(pair[0] - root)))


def longest_stable_step(grid: AxisymmetricGrid, material: ViscoelasticField) -> Float[Array, "*any"]:
    r"""Longest stable time step [s], from below, for any walls; of each material along leading axes.

    It is 2 over the root of a bound of the largest eigenvalue of stiffness over mass: the largest sum of the absolute
    values of a row (Gershgorin), radial and axial motion weighed against each other as is best. About $h / c_p$ for
    the smaller side h of the smallest cell and the speed $c_p = \sqrt{(K + 4 G / 3) / \rho}$ of the pressure wave when
    nothing has relaxed yet. Branches count with their sign: the pair that stands for a viscosity $\eta$ adds
    $1.5 \eta$ over its shorter time.

    Accuracy: the true limit is 1 to 10 % longer with cells four times as long as wide and up to 32 % longer with square
        ones, for bulk moduli above the shear modulus.
        NaN if a density is not positive or an instantaneous modulus is negative.
    """
    if material.density.ndim > 2:
        return jax.vmap(functools.partial(longest_stable_step, grid))(material)
    unrelaxed = material.relaxed_shear_modulus + jnp.sum(material.branch_shear_moduli, axis=0)
    no_branch = unrelaxed[None][:0]
    elastic = ViscoelasticField(material.density, material.bulk_modulus, unrelaxed, no_branch, no_branch)
    free = Walls(Wall.FREE, Wall.FREE, Wall.FREE)
    longest = 2.0 / jnp.sqrt(_bound_of_squared_frequency(solid_of(Layout(grid), elastic, 1.0, free, None)))
    sound = jnp.all(material.density > 0.0) & jnp.all(material.bulk_modulus >= 0.0) & jnp.all(unrelaxed >= 0.0)
    return jnp.where(sound, longest, jnp.nan)


@jax.jit
def _bound_of_squared_frequency(solid: LatticeSolid) -> Float[Array, ""]:
    # A node acts on those a row or a column away and no further. So a push on every third node of every third row shows
    # each its own entry of the matrix, and nine such pushes in two directions show all of them.
    memory = at_rest(solid).memory
    places = jnp.arange(solid.mass.shape[0])
    colours = 3 * (places // solid.row % 3) + places % solid.row % 3
    margin = solid.row + 1

    def entries(push: Int[Array, ""]) -> Float[Array, "2 node"]:
        pushed = jnp.where((colours == push % 9)[None] & (jnp.arange(2) == push // 9)[:, None], solid.free, 0.0)
        moved = jnp.pad(pushed, ((0, 0), (margin, margin)))
        force = internal_force(solid, strain_of(solid, (moved[0], moved[1])), memory)
        return jnp.abs(solid.free * jnp.stack(force) / solid.mass[None])

    by_radial, by_axial = jnp.sum(jax.lax.map(entries, jnp.arange(18)).reshape(2, 9, 2, -1), axis=1)
    # For every weight this is a bound.
    weight = 2.0 ** jnp.linspace(-4.0, 4.0, 33, dtype=solid.mass.dtype)[:, None]
    radial_rows = jnp.max(by_radial[0][None] + weight * by_axial[0][None], axis=1)
    axial_rows = jnp.max(by_radial[1][None] / weight + by_axial[1][None], axis=1)
    return jnp.min(jnp.maximum(radial_rows, axial_rows))
