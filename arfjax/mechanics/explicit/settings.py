"""Steps of the explicit path: how long they may be, and how many."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.explicit.grid import Layout
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
    longest = float(longest_stable_step(grid, material))
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


def longest_stable_step(grid: AxisymmetricGrid, material: ViscoelasticField) -> Float[Array, ""]:
    r"""Longest stable time step [s], from below: 2 over a bound of the highest frequency of any cell.

    It is about $h / c_p$ with $1 / h^2 = 1 / \Delta r^2 + 1 / \Delta z^2$ of the smallest cell and the speed
    $c_p = \sqrt{(K + 4 G / 3) / \rho}$ of the pressure wave when nothing has relaxed yet; somewhat less at the axis.
    The bound adds the frequencies (squared) of change of volume and of shape: nearly exact when nearly incompressible.
    Branches count with their sign: the pair that stands for a viscosity $\eta$ adds $1.5 \eta$ over its shorter time.
    """
    return 2.0 / jnp.sqrt(jnp.max(_squared_frequency(grid, material)))


def _squared_frequency(grid: AxisymmetricGrid, material: ViscoelasticField) -> Float[Array, "*any r z"]:
    # No frequency of a mesh is above the highest of its elements, each with its own share of the mass (Irons).
    layout, dtype = Layout(grid), material.density.dtype
    shear = material.relaxed_shear_modulus + jnp.sum(material.branch_shear_moduli, axis=-3)
    dilatation, shape = (jnp.asarray(part, dtype) for part in _trace(layout))
    rank = (1,) * (shear.ndim - 2)
    return (
        material.bulk_modulus * dilatation.reshape(*rank, *grid.shape) + shear * shape.reshape(*rank, *grid.shape)
    ) / material.density


def _trace(layout: Layout) -> tuple[Float[np.ndarray, "r z"], Float[np.ndarray, "r z"]]:
    """Traces of stiffness over mass of each cell, for unit bulk modulus and unit shear modulus and density."""
    across_r, across_ring = 0.5 / layout.r_size, 0.5 / (layout.inner + layout.outer)
    across_z = 0.5 / layout.z_size
    hourglass_r, hourglass_z = layout.hourglass
    dilatation, shape = 0.0, 0.0
    for share, side in ((1.0 - layout.outer_share, -1.0), (layout.outer_share, 1.0)):
        inertia = 4.0 / share  # volume of the cell over that of a node's part, times two nodes
        along_z = 2.0 * share * across_z
        squares = across_r**2 + across_ring**2 + along_z**2
        divergence = (side * across_r + across_ring) ** 2 + along_z**2
        dilatation = dilatation + inertia * divergence
        engineering_shear = across_r**2 + across_z**2
        deviator = 2.0 * (squares - divergence / 3.0) + engineering_shear + hourglass_r + hourglass_z
        shape = shape + inertia * deviator
    return np.broadcast_to(dilatation, layout.grid.shape), np.broadcast_to(shape, layout.grid.shape)
