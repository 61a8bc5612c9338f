r"""Motion under radiation force by an explicit scheme: one small stencil, many short steps, no matrix.

Quadrilaterals with a bilinear displacement, mass lumped at the nodes, strains taken at the middle of a cell, where the
dilatation is the mean one: $\nabla \cdot u$ is the flux through the rings and discs of a cell over its volume (through
a disc with the nodes' shares of the mass as weights), so that a nearly incompressible solid does not lock. What the
middle of a cell does not see (the hourglass) is held by the stiffness that exact integration of the deviator would give
it with the instantaneous shear modulus; it does not relax. Central differences in time; each
branch of the relaxation is advanced by the exact exponential for a strain that is linear within a step.

A step must not be longer than a pressure wave takes across the smallest cell, so that a large bulk modulus costs steps
(`capped_bulk_modulus`). Pure elementwise JAX: for sweeps, posteriors and accelerators, in float64 and in float32.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.elements.mesh import Walls
from arfjax.mechanics.explicit.grid import (
    DampingLayer,
    Layout,
    coarsened,
    coarsened_cells,
)
from arfjax.mechanics.explicit.result import ExplicitResult, estimate, no_estimate
from arfjax.mechanics.explicit.settings import ExplicitSettings, longest_stable_step
from arfjax.mechanics.explicit.stencil import LatticeSolid, State, advance, at_rest, internal_force, solid_of, strain_of
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.media import Scalar
from arfjax.numerics.interpolation import stencil_weights

_NO_POINTS = np.zeros((0, 2))
_FIXED = Walls()

Amplitude = Float[Array, " time"] | Float[np.ndarray, " time"] | None
NodalField = Float[Array, "r_node z_node"] | Float[np.ndarray, "r_node z_node"]


def solve_push_explicitly(
    grid: AxisymmetricGrid,
    material: ViscoelasticField,
    axial_force: NodalField,
    *,
    settings: ExplicitSettings,
    radial_force: NodalField | None = None,
    amplitude: Amplitude | Callable[[Float[Array, " time"]], Float[Array, " time"]] = None,
    walls: Walls = _FIXED,
    damping: DampingLayer | None = None,
    points: Float[np.ndarray, "point 2"] = _NO_POINTS,
    estimate_error: bool = True,
) -> ExplicitResult:
    """Displacement of a solid, at rest at first, that a force pushes.

    The force is given at the nodes, since there a push short against the waves moves each node exactly by its own
    force (cell values would be smeared: an error of (h/a)^2 / 2 on the axis of a beam of width a); the material in the
    cells, since there the strains are. Both are arrays, so that they can be traced and batched; functions of r and z
    go in as `force(*node_positions(grid))` and `modulus(*cell_positions(grid))`.

    Args:
        grid: Cells; sizes may grow away from the focus (`graded_positions`, and `refined` for even numbers of cells).
        material: The solid at the centres of the cells, `grid.r` and `grid.z`. Its type (float32 or float64) is that
            of the run. Branches may be negative, as in the pair that stands for a viscosity.
        axial_force: Force density along z at the nodes `grid.r_faces`, `grid.z_faces` [N/m^3].
        settings: Steps, duration of the push, maps.
        radial_force: Force density along r at the nodes [N/m^3]; none if not given.
        amplitude: What the force is multiplied with: a function of the times `settings.times`, or its values there [1],
            linear in between, in place of the
            rectangular push (whose duration then does nothing).
        walls: Conditions on the outer walls.
        damping: A layer along the walls that keeps waves from coming back.
        points: Positions r, z [m] at which to give the whole history.
        estimate_error: Whether to run once more with twice the cell sizes and the step (an eighth of the work).

    Raises:
        InputError: if an array has the wrong shape, the steps are unstable for a concrete material, or the estimate is
            asked for with odd numbers of cells or steps.

    Accuracy: second order in cell size and time step; `convergence` estimates the error. Measured at 0.5 ms against the
        exact solutions in an infinite medium (elastic, Zener, fractional Zener with 18 branches; beam 0.6 mm wide and
        3.8 mm long at 1/e; walls at 12 and 14 mm, cells growing by 1.3 every four), as a share of the peak:

        | cells at the focus [mm] | cells | steps | error | `extrapolated` |
        | --- | --- | --- | --- | --- |
        | 0.15 x 0.4 | 32 x 48 | 96 | 1.4, 1.6, 1.7 % | 0.22, 0.18, 0.04 % |
        | 0.1 x 0.4 | 36 x 48 | 130 | 1.0, 1.1, 1.1 % | 0.11, 0.06, 0.04 % |
        | 0.05 x 0.2 | 48 x 64 | 290 | 0.35, 0.40, 0.43 % | 0.02 % |

        For 1 % take cells of a quarter of the beam's width and a tenth of its length, and `extrapolated`. For a traced
        material look at `convergence.courant_number` too.
    Differentiability: in the material, the forces and the amplitude, forward and reverse. Memory in reverse mode is the
        state (4 numbers a node, 3 a cell and branch) times the number of stretches between checkpoints and the steps in
        one of them.
    Source: Belytschko, Liu & Moran, Nonlinear Finite Elements for Continua and Structures (2000), chapters 6 and 8
        (central differences, mean dilatation, hourglass); Taylor, Pister & Goudreau, Int. J. Numer. Meth. Engng 2
        (1970) 45 (recursion for the memory).
    """
    material = jax.tree.map(lambda leaf: jnp.asarray(leaf, material.density.dtype), material)
    axial, radial = _checked_forces(grid, material, axial_force, radial_force)
    _refuse_points_outside(grid, points)
    amplitude = course_of(amplitude, settings, material.density.dtype)
    coarse_grid, coarse_settings = (coarsened(grid), settings.doubled) if estimate_error else (None, None)
    courant_number = _checked_courant_number(grid, material, settings)
    others = {"walls": walls, "damping": damping}
    result = _run(grid, material, axial, points, settings, radial_force=radial, amplitude=amplitude, **others)
    if coarse_grid is None or coarse_settings is None:
        return ExplicitResult(**result, convergence=no_estimate(result, courant_number))
    coarse = _run(
        coarse_grid,
        jax.tree.map(lambda field: coarsened_cells(grid, field), material),
        axial[::2, ::2],
        points,
        coarse_settings,
        radial_force=radial[::2, ::2],
        amplitude=None if amplitude is None else amplitude[::2],
        **others,
    )
    return ExplicitResult(**result, convergence=estimate(result, coarse, courant_number))


def capped_bulk_modulus(material: ViscoelasticField, largest: float) -> ViscoelasticField:
    """The material with a bulk modulus of at most `largest` [Pa]: steps grow with the root of what it is lowered by.

    The pressure wave must leave the beam well before the push ends. Measured for a push of 0.5 ms, a beam 0.6 mm wide
    and 3.8 mm long (1/e) and the Zener solid of the reference (G from 1 to 5 kPa), as a share of the peak, against
    32 MPa on the same 40 x 48 cells:

    | bulk modulus [kPa] | 8000 | 2000 | 500 | 250 | 125 | 50 | 20 |
    | --- | --- | --- | --- | --- | --- | --- | --- |
    | steps of 0.1 x 0.4 mm cells for 1 ms | 972 | 490 | 248 | 174 | 126 | 84 | 60 |
    | largest of focus and points, 0.5 ms | 0.03 % | 0.09 % | 0.33 % | 0.65 % | 1.2 % | 2.4 % | 3.8 % |
    | all points, 1 ms | 0.02 % | 0.04 % | 0.04 % | 0.12 % | 0.42 % | 1.0 % | 2.6 % |

    It is part of the model, not of the discretisation: `convergence` does not see it.
    """
    return dataclasses.replace(material, bulk_modulus=jnp.minimum(material.bulk_modulus, largest))


def _checked_forces(
    grid: AxisymmetricGrid, material: ViscoelasticField, axial: NodalField, radial: NodalField | None
) -> tuple[Array, Array]:
    n_r, n_z = grid.shape
    if material.density.shape != (n_r, n_z):
        raise InputError(
            f"the material has shape {material.density.shape}, the grid {n_r} x {n_z} cells: give it at the centres of "
            "the cells, `cell_positions(grid)`."
        )
    dtype, expected = material.density.dtype, (n_r + 1, n_z + 1)
    for name, force in (("axial_force", axial), ("radial_force", radial)):
        if force is not None and force.shape != expected:
            raise InputError(
                f"`{name}` has shape {force.shape}, the grid {expected[0]} x {expected[1]} nodes: give it at the "
                "nodes, `node_positions(grid)`."
            )
    axial = jnp.asarray(axial, dtype)
    return axial, jnp.zeros_like(axial) if radial is None else jnp.asarray(radial, dtype)


def _refuse_points_outside(grid: AxisymmetricGrid, points: Float[np.ndarray, "point 2"]) -> None:
    lowest, highest = [0.0, grid.z_faces[0]], [grid.r_faces[-1], grid.z_faces[-1]]
    outside = ~np.all((points >= np.array(lowest) - 1e-12) & (points <= np.array(highest) + 1e-12), axis=1)
    if np.any(outside):
        r, z = points[np.flatnonzero(outside)[0]]
        raise InputError(
            f"the point r = {r:g} m, z = {z:g} m lies outside the grid, r up to {highest[0]:g} m and z from "
            f"{lowest[1]:g} to {highest[1]:g} m. Millimetres, or another origin? Pass metres."
        )


def _checked_courant_number(
    grid: AxisymmetricGrid, material: ViscoelasticField, settings: ExplicitSettings
) -> Float[Array, ""]:
    longest = longest_stable_step(grid, jax.lax.stop_gradient(material))
    if not isinstance(longest, Tracer) and not settings.time_step <= float(longest) * (1.0 + 1e-6):
        raise InputError(
            f"`time_step` {settings.time_step:.3g} s is longer than {float(longest):.3g} s, the longest that is stable "
            "for this grid and material: let `explicit_settings` choose it, take larger cells, or cap the bulk modulus."
        )
    return settings.time_step / longest


def _time_weights(settings: ExplicitSettings, amplitude: Amplitude, dtype: jnp.dtype) -> Float[Array, " step"]:
    """Means of the amplitude with the weights of a hat two steps wide about the start of each step.

    With them, and at rest at first, a body that nothing holds back is exactly where it should be at every step.
    """
    if amplitude is None:
        step, duration = settings.time_step, settings.push_duration
        since_start = np.maximum(step * np.arange(-1, settings.n_steps + 1), 0.0)
        twice_integrated = 0.5 * (since_start**2 - np.maximum(since_start - duration, 0.0) ** 2) / step**2
        return jnp.asarray(np.diff(twice_integrated, n=2), dtype)
    if amplitude.shape != (settings.n_steps + 1,):
        raise InputError(
            f"`amplitude` has shape {amplitude.shape}: give one value for each of the {settings.n_steps + 1} times "
            "`settings.times`."
        )
    amplitude = jnp.asarray(amplitude, dtype)
    first = (2.0 * amplitude[:1] + amplitude[1:2]) / 6.0
    return jnp.concatenate([first, (amplitude[:-2] + 4.0 * amplitude[1:-1] + amplitude[2:]) / 6.0])


def course_of(amplitude: Amplitude | Callable[[Array], Array], settings: ExplicitSettings, dtype: Any) -> Amplitude:
    """Values of an amplitude that may be a function of time [s]."""
    return amplitude(jnp.asarray(settings.times, dtype)) if callable(amplitude) else amplitude


def assemble_push(
    grid: AxisymmetricGrid,
    material: ViscoelasticField,
    axial_force: NodalField,
    *,
    settings: ExplicitSettings,
    radial_force: NodalField | None = None,
    amplitude: Amplitude = None,
    walls: Walls = _FIXED,
    damping: DampingLayer | None = None,
) -> tuple[LatticeSolid, tuple[Array, Array], Float[Array, " step"]]:
    """The stencil's constants, the nodal force r, z [N] and its weight in each step; see `solve_push_explicitly`."""
    layout, dtype = Layout(grid), material.density.dtype
    axial, radial = _checked_forces(grid, material, axial_force, radial_force)
    volumes = layout.sum_at_nodes(jnp.asarray(grid.volumes, dtype))
    force = (radial * volumes).ravel(), (axial * volumes).ravel()
    solid = solid_of(layout, material, settings.time_step, walls, damping)
    return solid, force, _time_weights(settings, amplitude, dtype)


def _run(
    grid: AxisymmetricGrid,
    material: ViscoelasticField,
    axial_force: NodalField,
    points: Float[np.ndarray, "point 2"],
    settings: ExplicitSettings,
    **others: Any,
) -> dict[str, Array]:
    # Everything that an `ExplicitResult` holds but its convergence.
    layout, dtype = Layout(grid), material.density.dtype
    solid, force, weights = assemble_push(grid, material, axial_force, settings=settings, **others)
    observe = _observer(layout, points, dtype)

    def step(state: State, weight: Float[Array, ""]) -> tuple[State, tuple[Array, Array]]:
        state = advance(solid, state, (weight * force[0], weight * force[1]))
        return state, observe(state)

    def stretch(state: State, some: Float[Array, " step"]) -> tuple[State, tuple[Array, Array]]:
        return jax.lax.scan(step, state, some)

    def to_map(state: State, some: Float[Array, "stretch step"]) -> tuple[State, tuple[Array, Array, Array]]:
        state, (axis, at_points) = jax.lax.scan(jax.checkpoint(stretch), state, some)
        return state, (axis, at_points, _as_map(layout, state.nodal_displacement(layout.row)))

    start = at_rest(solid)
    parts = weights.reshape(settings.n_maps, -1, settings.steps_per_checkpoint)
    final, (axis, at_points, maps) = jax.lax.scan(to_map, start, parts)
    histories = [
        jnp.concatenate([first[None], later.reshape(settings.n_steps, *first.shape)])
        for first, later in zip(observe(start), (axis, at_points), strict=True)
    ]
    at_end = _weight_at_end(settings, others["amplitude"])
    velocity = _velocity_at_end(solid, final, (at_end * force[0], at_end * force[1]))
    return {
        "time": jnp.asarray(settings.times, dtype),
        "r": jnp.asarray(grid.r_faces, dtype),
        "z": jnp.asarray(grid.z_faces, dtype),
        "axial_displacement_on_axis": histories[0],
        "displacement_at_points": histories[1],
        "map_time": jnp.asarray(settings.map_times, dtype),
        "maps": maps,
        "velocity": _as_map(layout, velocity),
    }


def _weight_at_end(settings: ExplicitSettings, amplitude: Amplitude) -> Scalar:
    if amplitude is not None:
        values = jnp.asarray(amplitude)
        return (2.0 * values[-1] + values[-2]) / 3.0  # from the mean velocity of the last step to that at its end
    # Of a push that ends within the last step: what its mean force of a hat lacks of the velocity at the end.
    end, step = settings.times[-1], settings.time_step
    return float(np.clip((settings.push_duration - (end - step)) / step, 0.0, 1.0)) ** 2


def _observer(layout: Layout, points: Float[np.ndarray, "point 2"], dtype: jnp.dtype):
    """What is kept of every step: axial displacement on the axis, displacement at the points."""
    row, start = layout.row, layout.row + 1
    first_r, weights_r = stencil_weights(points[:, 0], layout.grid.r_faces)
    first_z, weights_z = stencil_weights(points[:, 1], layout.grid.z_faces)
    rows = (first_r[:, None] + jnp.arange(weights_r.shape[1])[None, :])[:, :, None]
    columns = (first_z[:, None] + jnp.arange(weights_z.shape[1])[None, :])[:, None, :]
    places = start + rows * row + columns
    weights = jnp.asarray(weights_r[:, :, None] * weights_z[:, None, :], dtype)

    def observe(state: State) -> tuple[Float[Array, " z"], Float[Array, "point 2"]]:
        radial, axial = state.displacement
        if len(points) == 0:
            at_points = jnp.zeros((0, 2), dtype)
        else:
            at_points = jnp.stack([jnp.sum(weights * u[places], axis=(1, 2)) for u in (radial, axial)], axis=-1)
        return axial[start : start + row], at_points

    return observe


def _velocity_at_end(solid: LatticeSolid, state: State, force: tuple[Array, Array]) -> Float[Array, "2 node"]:
    # Half a step on from the last velocity, with the forces at the end.
    opposed = internal_force(solid, strain_of(solid, state.displacement), state.memory)
    slowed = 0.0 if solid.damping is None else solid.damping
    return jnp.stack(
        [
            (1.0 - slowed) * speed + 0.5 * solid.time_step * free * (pushed - back) / solid.mass
            for speed, free, pushed, back in zip(state.velocity, solid.free, force, opposed, strict=True)
        ]
    )


def _as_map(layout: Layout, flat: Float[Array, "2 node"]) -> Float[Array, "r z 2"]:
    return jnp.moveaxis(layout.nodes(flat), 0, -1)
