"""Pennes' bioheat equation on an axisymmetric grid: how tissue warms, conducts and is cooled by blood.

Conservative finite volumes in space (`arfjax.thermal.conduction`), implicit along r and z in turn in time
(`arfjax.thermal.splitting`). Here all constants stay as they are; `arfjax.thermal.feedback` lets them change.

The unknown is the temperature rise above the uniform initial temperature, which keeps the small rises of a weak
sonication exact in single precision.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.errors import InputError, lies_within
from arfjax.grid import AxisymmetricGrid
from arfjax.media import Scalar
from arfjax.numerics.interpolation import interpolation_weights
from arfjax.thermal.conduction import CellValues, Geometry, cell_conductances, cell_geometry
from arfjax.thermal.conduction import Convective as Convective
from arfjax.thermal.conduction import FixedTemperature as FixedTemperature
from arfjax.thermal.conduction import Insulated as Insulated
from arfjax.thermal.conduction import ThermalField as ThermalField
from arfjax.thermal.conduction import Walls as Walls
from arfjax.thermal.conduction import uniform_field as uniform_field
from arfjax.thermal.history import require_times
from arfjax.thermal.splitting import march, split_operator


class Phase(eqx.Module):
    """A stretch of time during which the heat stays the same.

    Attributes:
        duration: [s]; derivatives flow to it.
        n_steps: Steps of equal length that it is taken in.
        power: Factor on the heat: 1 heats, 0 lets cool.
    """

    duration: Scalar
    n_steps: int = eqx.field(static=True)
    power: Scalar = 1.0

    def __check_init__(self) -> None:
        """Refuse phases without duration or steps, and negative power."""
        duration, power = _known(self.duration, 1.0), _known(self.power, 0.0)
        if not (0.0 < duration < np.inf and self.n_steps >= 1):
            raise InputError(f"a phase needs `duration` > 0 s and `n_steps` >= 1, got {duration} s and {self.n_steps}.")
        if not 0.0 <= power < np.inf:
            raise InputError(f"a phase needs a finite `power` of at least 0, got {power}.")

    @property
    def time_step(self) -> Scalar:
        """[s]."""
        return self.duration / self.n_steps


def phase_times(phases: Sequence[Phase]) -> Float[Array, " time"]:
    """Start of the first phase, 0, and the end of every step [s]."""
    times, end = [jnp.zeros(1)], jnp.asarray(0.0)
    for phase in phases:
        times.append(end + jnp.arange(1, phase.n_steps + 1) * phase.time_step)
        end = end + phase.duration
    return jnp.concatenate(times)


class TemperatureHistory(eqx.Module):
    """Temperature at the cell centres over time.

    Attributes:
        time: [s], from 0, ascending.
        temperature: [degC]; the first entry is the initial state.
    """

    time: Float[Array, " time"]
    temperature: Float[Array, "time r z"]

    def __check_init__(self) -> None:
        """Refuse times that do not ascend, or are not one for each map of temperature."""
        require_times(self.time, jnp.shape(self.temperature)[0])


def solve_bioheat(
    field: ThermalField,
    heat: CellValues,
    grid: AxisymmetricGrid,
    *,
    phases: Sequence[Phase],
    initial_temperature: Scalar,
    arterial_temperature: Scalar,
    walls: Walls | None = None,
) -> TemperatureHistory:
    r"""Temperature of perfused tissue that is heated from a uniform temperature.

    $$ \rho c \, \partial_t T = \nabla \cdot (k \nabla T) - W (T - T_a) + Q_m + Q $$

    Args:
        field: Thermal constants at the cell centres of `grid`.
        heat: Heat deposition Q at the cell centres [W/m^3].
        grid: Where the cells lie.
        phases: Stretches of time, one after the other, each with its share of the heat.
        initial_temperature: Of all cells at time 0 [degC].
        arterial_temperature: Of the blood that enters, T_a [degC].
        walls: All at the initial temperature when None.

    Returns:
        Temperature at time 0 and after every step of every phase.

    Raises:
        InputError: if shapes disagree with the grid, or there is no phase.

    Called again with other numbers and the same shapes and steps, it is not compiled anew.

    Accuracy: second order in the time step and in the cell size; what the heat delivers is stored or lost to rounding.
    No step is too long to be stable. Steps far longer than a cell's own time constants damp what varies from cell to
    cell along r and z at once slowly, so a jump of the heat needs short steps, smooth heat does not.
    Cost: proportional to cells times steps; a phase factorises once. The gradient costs about two more runs and
    memory for all rates.
    Differentiability: forward and reverse, in every leaf of `field`, `heat`, the durations and powers of the phases,
    the temperatures and the walls.
    Source: Pennes, J. Appl. Physiol. 1 (1948) 93, eq. for tissue heat balance.
    """
    names = ("conductivity", "heat_capacity", "perfusion_conductance")
    require_shapes(grid, {name: getattr(field, name) for name in names} | {"heat": heat})
    if not phases:
        raise InputError("`phases` is empty; give at least one `Phase`.")
    initial_temperature = jnp.asarray(initial_temperature, dtype=float)
    # As arrays, because every other Python number would be another program.
    walls = Walls() if walls is None else walls
    of_field, of_walls, of_phases = jax.tree.map(jnp.asarray, (field, walls, tuple(phases)))
    excess = initial_temperature - arterial_temperature
    rise = _run(of_field, jnp.asarray(heat), cell_geometry(grid), of_walls, excess, of_phases)
    return TemperatureHistory(phase_times(phases), initial_temperature + rise)


@eqx.filter_jit
def _run(
    field: ThermalField,
    heat: Float[Array, "r z"],
    geometry: Geometry,
    walls: Walls,
    excess: Float[Array, ""],
    phases: tuple[Phase, ...],
) -> Float[Array, "time r z"]:
    conductances, inflow = cell_conductances(field, geometry, walls)
    capacity = jnp.asarray(field.heat_capacity * geometry.volumes)
    always = inflow + (field.metabolic_heat - excess * field.perfusion_conductance) * geometry.volumes
    rises = [jnp.zeros_like(capacity)[None]]
    for phase in phases:
        operator = split_operator(capacity, conductances, phase.time_step)
        power = phase.power * heat * geometry.volumes + always
        rises.append(march(operator, power, rises[-1][-1], phase.time_step, phase.n_steps))
    return jnp.concatenate(rises)


def focal_temperature(history: TemperatureHistory, grid: AxisymmetricGrid, z: Scalar) -> Float[Array, " time"]:
    """Temperature on the axis at axial position `z` [m] over time [degC].

    Accuracy: fourth order in the cell size, on top of the error of `history`: even in r through the first two cell
    centres, cubic in z through the four nearest cell centres (as far as there are four).
    Differentiability: also in `z`, with a jump of slope of third order at cell centres.

    Raises:
        InputError: if `z` is a number outside the grid; a traced `z` outside it stops the run.
    """
    position = _position_inside(z, grid)
    return on_axis(history.temperature, grid) @ interpolation_weights(position[None], grid.z)[0]


BOILING_TEMPERATURE = 100.0
"""Temperature [degC] from which water in tissue boils, which nothing here models."""


def boiling_time(history: TemperatureHistory, grid: AxisymmetricGrid) -> Float[Array, ""]:
    """First time of `history` at which 100 degC are reached in a cell or on the axis [s], NaN if never.

    From there on temperatures are not to be trusted. Infinite ones, of a run that did not come to its end, do not boil.
    """
    axis = jnp.max(on_axis(history.temperature, grid), axis=1)
    hottest = jnp.maximum(jnp.max(history.temperature, axis=(1, 2)), axis)
    boils = (hottest >= BOILING_TEMPERATURE) & jnp.isfinite(hottest)
    return jnp.where(jnp.any(boils), history.time[jnp.argmax(boils)], jnp.nan)


def border_rise(temperature: Float[Array, "time r z"] | Float[np.ndarray, "time r z"]) -> Float[Array, ""]:
    """Largest change of temperature since the start in the cells beside the outer walls [K].

    Walls that are held at the start temperature cool the focus once their heat has come there.
    """
    change = jnp.abs(temperature - temperature[:1])
    return jnp.max(jnp.stack([jnp.max(edge) for edge in (change[:, -1], change[:, :, 0], change[:, :, -1])]))


def on_axis(values: Float[Array, "*batch r z"], grid: AxisymmetricGrid) -> Float[Array, "*batch z"]:
    """Values at r = 0 of the parabolas a + b r^2 through the first two cell centres; fourth order in their radii."""
    if grid.shape[0] == 1:
        return values[..., 0, :]
    first, second = grid.r[:2] ** 2
    return (second * values[..., 0, :] - first * values[..., 1, :]) / (second - first)


def _position_inside(z: Scalar, grid: AxisymmetricGrid) -> Float[Array, ""]:
    near, far = grid.z_faces[0], grid.z_faces[-1]
    message = f"`z` is outside the grid's {near} to {far} m. Millimetres? Pass metres."
    if isinstance(z, Tracer):
        return eqx.error_if(z, (z < near) | (z > far), message)
    if not lies_within(z, near, far):
        raise InputError(f"{message} Got {z}.")
    return jnp.asarray(z)


def require_shapes(grid: AxisymmetricGrid, values: dict[str, CellValues]) -> None:
    """Refuse named values that do not have one number for every cell of the grid."""
    for name, each in values.items():
        if jnp.shape(each) != grid.shape:
            raise InputError(f"`{name}` has shape {jnp.shape(each)}, the grid has {grid.shape} cells (r, z).")


def _known(value: Any, otherwise: float) -> float:
    """The value as a number, or what passes every check where it is traced or a batch."""
    kinds = float | int | np.number | np.ndarray | jax.Array
    if isinstance(value, Tracer) or not isinstance(value, kinds) or jnp.ndim(value):
        return otherwise
    return float(value)
