"""Pennes' bioheat equation on an axisymmetric grid: how tissue warms, conducts and is cooled by blood.

Conservative finite volumes in space (`arfjax.thermal.conduction`). In time, the two-stage diagonally implicit
Runge-Kutta method of second order that is L-stable; both stages and all steps share one factorisation.

The unknown is the temperature rise above the uniform initial temperature, which keeps the small rises of a weak
sonication exact in single precision.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.media import Scalar
from arfjax.numerics.block_tridiagonal import BlockCholesky, BlockTridiagonal, factorise, solve
from arfjax.thermal.conduction import CellValues, Conductances, Geometry, cell_conductances, cell_geometry
from arfjax.thermal.conduction import FixedTemperature as FixedTemperature
from arfjax.thermal.conduction import Insulated as Insulated
from arfjax.thermal.conduction import ThermalField as ThermalField
from arfjax.thermal.conduction import Walls as Walls
from arfjax.thermal.conduction import uniform_field as uniform_field

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
"""Diagonal of the Runge-Kutta method: Alexander, SIAM J. Numer. Anal. 14 (1977) 1006, the L-stable two-stage one."""

POSITIVITY_LIMIT = 1.0 + math.sqrt(2.0)
"""Longest step, in units of the shortest time constant of a cell, that keeps every rise non-negative: the step within
which the method's stability function is absolutely monotonic (Bolley & Crouzeix, RAIRO Anal. Numer. 12 (1978) 237)."""

ALIGNMENT = 1e-6
"""How far, in steps, `heating_duration` may be from a whole number of steps."""


class TemperatureHistory(eqx.Module):
    """Temperature at the cell centres over time.

    Attributes:
        time: [s], from 0.
        temperature: [degC]; the first entry is the initial state.
    """

    time: Float[Array, " time"]
    temperature: Float[Array, "time r z"]


class BioheatStepper(eqx.Module):
    """One time step of the bioheat equation, ready to be taken many times.

    Linear in the temperature rise and the heat. Made by `bioheat_stepper`, used by `solve_bioheat` and by whoever
    lets the heat change from step to step.
    """

    conductances: Conductances
    capacity: Float[Array, "r z"]
    volumes: Float[Array, "r z"]
    inflow: Float[Array, "r z"]
    time_step: Scalar
    matrix: BlockTridiagonal
    factor: BlockCholesky

    def advance(self, rise: Float[Array, "r z"], heat: CellValues) -> Float[Array, "r z"]:
        """Temperature rise [K] one step later under a heat [W/m^3] that is constant in the step."""
        power = jnp.asarray(heat) * self.volumes + self.inflow
        first = self._rate(rise, power)
        second = self._rate(rise + (1.0 - GAMMA) * self.time_step * first, power)
        return rise + self.time_step * ((1.0 - GAMMA) * first + GAMMA * second)

    def _rate(self, rise: Float[Array, "r z"], power: Float[Array, "r z"]) -> Float[Array, "r z"]:
        """Rate of temperature at the end of an implicit stage [K/s].

        The derivative comes from the five-point `_multiply`, not from the dense blocks: it is as cheap as a step.
        """
        return jax.lax.custom_linear_solve(
            self._multiply,
            power - self.conductances.leaving(rise),
            solve=lambda _, right_side: self._substitute(right_side),
            symmetric=True,
        )

    def _multiply(self, rate: Float[Array, "r z"]) -> Float[Array, "r z"]:
        return self.capacity * rate + GAMMA * self.time_step * self.conductances.leaving(rate)

    def _substitute(self, right_side: Float[Array, "r z"]) -> Float[Array, "r z"]:
        if _blocks_are_columns(right_side.shape):
            return solve(self.matrix, self.factor, right_side.T).T
        return solve(self.matrix, self.factor, right_side)


def bioheat_stepper(
    field: ThermalField,
    grid: AxisymmetricGrid,
    *,
    initial_temperature: Scalar,
    arterial_temperature: Scalar,
    time_step: Scalar,
    walls: Walls | None = None,
) -> BioheatStepper:
    """The step of `solve_bioheat` on its own; call it under `jax.jit`, once for all steps.

    Args:
        field: Thermal constants at the cell centres of `grid`.
        grid: Where the cells lie.
        initial_temperature: From which rises are counted [degC].
        arterial_temperature: Of the blood that enters [degC].
        time_step: [s].
        walls: All at the initial temperature when None.
    """
    _require_shape("field", field.conductivity, grid)
    excess = jnp.asarray(initial_temperature) - arterial_temperature
    return _stepper(field, cell_geometry(grid), Walls() if walls is None else walls, excess, time_step)


def solve_bioheat(
    field: ThermalField,
    heat: CellValues,
    grid: AxisymmetricGrid,
    *,
    initial_temperature: Scalar,
    arterial_temperature: Scalar,
    time_step: float,
    n_steps: int,
    heating_duration: float | None = None,
    walls: Walls | None = None,
) -> TemperatureHistory:
    r"""Temperature of perfused tissue that is heated from a uniform temperature.

    $$ \rho c \, \partial_t T = \nabla \cdot (k \nabla T) - W (T - T_a) + Q $$

    Args:
        field: Thermal constants at the cell centres of `grid`.
        heat: Heat deposition Q at the cell centres, constant while it is on [W/m^3].
        grid: Where the cells lie.
        initial_temperature: Of all cells at time 0 [degC].
        arterial_temperature: Of the blood that enters, T_a [degC].
        time_step: [s].
        n_steps: Number of steps.
        heating_duration: When the heat is switched off, a whole number of steps [s]; never when None.
        walls: All at the initial temperature when None.

    Returns:
        Temperature at times 0, `time_step`, ..., `n_steps * time_step`.

    Raises:
        InputError: if shapes disagree with the grid, or the time settings make no sense.

    Accuracy: second order in `time_step` and in the cell size; heat is conserved to rounding. L-stable: no step is
    too long to be stable. A non-negative rise is guaranteed for `time_step` up to `positive_time_step`; beyond it a
    jump of the heat from one cell to the next can undershoot slightly, smooth heat does not.
    Differentiability: forward and reverse, in every leaf of `field`, `heat`, the temperatures and the walls.
    Source: Pennes, J. Appl. Physiol. 1 (1948) 93, eq. for tissue heat balance.
    """
    for name, values in (("field", field.conductivity), ("heat", heat)):
        _require_shape(name, values, grid)
    n_heated = _heated_steps(time_step, n_steps, heating_duration)
    initial_temperature = jnp.asarray(initial_temperature, dtype=float)
    rise = _march(
        field,
        jnp.asarray(heat),
        cell_geometry(grid),
        Walls() if walls is None else walls,
        initial_temperature - arterial_temperature,
        time_step,
        np.arange(n_steps) < n_heated,
    )
    return TemperatureHistory(time_step * jnp.arange(n_steps + 1, dtype=float), initial_temperature + rise)


def positive_time_step(field: ThermalField, grid: AxisymmetricGrid, *, walls: Walls | None = None) -> Float[Array, ""]:
    """Longest step [s] for which no heat, however rough, can push any cell below the initial temperature.

    It holds for walls and blood not colder than that. Smooth heat allows steps many times longer.
    """
    _require_shape("field", field.conductivity, grid)
    walls = Walls() if walls is None else walls
    conductances, _ = cell_conductances(field, cell_geometry(grid), walls)
    return POSITIVITY_LIMIT * jnp.min(field.heat_capacity * grid.volumes / conductances.diagonal())


def focal_temperature(history: TemperatureHistory, grid: AxisymmetricGrid, z: Scalar) -> Float[Array, " time"]:
    """Temperature on the axis at axial position `z` [m] over time [degC].

    Accuracy: fourth order in the cell size, on top of the error of `history`: even in r through the first two cell
    centres, cubic in z through the four nearest cell centres (as far as there are four).
    Differentiability: also in `z`, with a jump of slope of third order at cell centres.

    Raises:
        InputError: if `z` is a number outside the grid; a traced `z` outside it stops the run.
    """
    position = _position_inside(z, grid)
    n_points = min(4, grid.shape[1])
    first = jnp.clip(jnp.searchsorted(grid.z, position) - n_points // 2, 0, grid.shape[1] - n_points)
    positions = jax.lax.dynamic_slice_in_dim(jnp.asarray(grid.z), first, n_points)
    values = jax.lax.dynamic_slice_in_dim(on_axis(history.temperature, grid), first, n_points, axis=1)
    return values @ _lagrange_weights(positions, position)


def on_axis(values: Float[Array, "*batch r z"], grid: AxisymmetricGrid) -> Float[Array, "*batch z"]:
    """Values at r = 0 of the parabolas a + b r^2 through the first two cell centres; fourth order in their radii."""
    if grid.shape[0] == 1:
        return values[..., 0, :]
    first, second = grid.r[:2] ** 2
    return (second * values[..., 0, :] - first * values[..., 1, :]) / (second - first)


def _position_inside(z: Scalar, grid: AxisymmetricGrid) -> Float[Array, ""]:
    near, far = grid.z_faces[0], grid.z_faces[-1]
    message = f"`z` is outside the grid's {near} to {far} m. Millimetres? Pass metres."
    if not isinstance(z, float):
        return eqx.error_if(z, (z < near) | (z > far), message)
    if not near <= z <= far:
        raise InputError(f"{message} Got {z}.")
    return jnp.asarray(z)


def _lagrange_weights(positions: Float[Array, " n"], z: Float[Array, ""]) -> Float[Array, " n"]:
    same = np.eye(positions.shape[0], dtype=bool)
    spacings = jnp.where(same, 1.0, positions[:, None] - positions[None, :])
    return jnp.prod(jnp.where(same, 1.0, (z - positions)[None, :] / spacings), axis=1)


def _require_shape(name: str, values: CellValues, grid: AxisymmetricGrid) -> None:
    if values.shape != grid.shape:
        raise InputError(f"`{name}` has shape {values.shape}, the grid has {grid.shape} cells (r, z).")


def _heated_steps(time_step: float, n_steps: int, heating_duration: float | None) -> int:
    if time_step <= 0.0 or n_steps < 1:
        raise InputError(f"need `time_step` > 0 s and `n_steps` >= 1, got {time_step} s and {n_steps}.")
    if heating_duration is None:
        return n_steps
    n_heated = round(heating_duration / time_step)
    if heating_duration < 0.0 or abs(heating_duration / time_step - n_heated) > ALIGNMENT:
        raise InputError(
            f"`heating_duration` {heating_duration} s must be a whole number of steps of {time_step} s. "
            f"Change `time_step` so that it divides the duration."
        )
    return n_heated


@jax.jit
def _march(
    field: ThermalField,
    heat: Float[Array, "r z"],
    geometry: Geometry,
    walls: Walls,
    excess: Float[Array, ""],
    time_step: Scalar,
    heated: Array,
) -> Float[Array, "time r z"]:
    stepper = _stepper(field, geometry, walls, excess, time_step)

    def step(rise: Array, on: Array) -> tuple[Array, Array]:
        rise = stepper.advance(rise, jnp.where(on, heat, 0.0))
        return rise, rise

    start = jnp.zeros_like(stepper.capacity)
    _, rises = jax.lax.scan(step, start, heated)
    return jnp.concatenate([start[None], rises])


def _stepper(
    field: ThermalField, geometry: Geometry, walls: Walls, excess: Float[Array, ""], time_step: Scalar
) -> BioheatStepper:
    conductances, inflow = cell_conductances(field, geometry, walls)
    capacity = jnp.asarray(field.heat_capacity * geometry.volumes)
    matrix = jax.lax.stop_gradient(_matrix(capacity, conductances, GAMMA * time_step))
    return BioheatStepper(
        conductances=conductances,
        capacity=capacity,
        volumes=geometry.volumes,
        inflow=inflow - excess * field.perfusion_conductance * geometry.volumes,
        time_step=time_step,
        matrix=matrix,
        factor=factorise(matrix),
    )


def _blocks_are_columns(shape: tuple[int, ...]) -> bool:
    """Whether a block holds the cells of one z (as it should when there are fewer along r than along z)."""
    return shape[0] <= shape[1]


def _matrix(capacity: Float[Array, "r z"], conductances: Conductances, weight: Scalar) -> BlockTridiagonal:
    """Heat capacity plus `weight` [s] times conduction."""
    diagonal, within, across = capacity + weight * conductances.diagonal(), conductances.radial, conductances.axial
    if _blocks_are_columns(capacity.shape):
        diagonal, within, across = diagonal.T, within.T, across.T
    else:
        within, across = across, within
    within, across = -weight * within, jnp.pad(-weight * across, ((1, 0), (0, 0)))
    beside = jax.vmap(lambda values: jnp.diag(values, 1) + jnp.diag(values, -1))(within)
    return BlockTridiagonal(jax.vmap(jnp.diag)(diagonal) + beside, jax.vmap(jnp.diag)(across))
