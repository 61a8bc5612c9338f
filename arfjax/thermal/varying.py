"""One time step of the bioheat equation in tissue whose constants change with temperature and dose.

The Rosenbrock-W method of `arfjax.thermal.splitting` needs no Newton iteration: its right-hand sides take the constants
as they are, its matrix those at the start of the step, and it is of second order whatever the matrix. Its first stage
alone is a method of first order, whose distance from the result estimates the error.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.media import Scalar
from arfjax.thermal.conduction import Conductances, Geometry, ThermalField, Walls, cell_conductances
from arfjax.thermal.damage import ThermalDose, damage_increment
from arfjax.thermal.splitting import Cells, advance, split_operator

ThermalProperties = Callable[[Cells, Cells], ThermalField]
"""Thermal constants of every cell from its temperature [degC] and its dose [equivalent min at 43 degC]."""


class Exposure(eqx.Module):
    """What tissue has come to.

    Attributes:
        rise: Of temperature above the initial one [K].
        dose: CEM43 [equivalent min at 43 degC].
    """

    rise: Cells
    dose: Cells


class Tissue(eqx.Module):
    """Everything about heated tissue but its state and the heat."""

    properties: ThermalProperties
    geometry: Geometry
    walls: Walls
    initial_temperature: Float[Array, ""]
    arterial_temperature: Scalar

    def at(self, state: Exposure) -> tuple[Cells, Conductances, Cells]:
        """Heat capacity [J/K], conductances [W/K] and power without any heat at zero rise [W] of the cells."""
        field = self.properties(self.initial_temperature + state.rise, state.dose)
        conductances, inflow = cell_conductances(field, self.geometry, self.walls)
        excess = self.initial_temperature - self.arterial_temperature
        own = (field.metabolic_heat - excess * field.perfusion_conductance) * self.geometry.volumes
        return jnp.asarray(field.heat_capacity * self.geometry.volumes), conductances, inflow + own

    def step(self, state: Exposure, heat: Cells, time_step: Scalar) -> tuple[Exposure, Cells]:
        """The state one step later under `heat` [W/m^3], and an estimate of the error of its rise [K]."""
        power = heat * self.geometry.volumes
        capacity, conductances, own = self.at(state)
        operator = split_operator(capacity, conductances, time_step)
        first = operator.solve(power + own - conductances.leaving(state.rise))
        predicted = self._expose(state, state.rise + time_step * first, time_step)
        later_capacity, conductances, own = self.at(predicted)
        rate = (power + own - conductances.leaving(predicted.rise)) / later_capacity
        second = operator.solve(capacity * (rate - 2.0 * first))
        result = self._expose(state, advance(state.rise, first, second, time_step), time_step)
        return result, 0.5 * time_step * (first + second)

    def _expose(self, state: Exposure, rise: Cells, duration: Scalar) -> Exposure:
        before, after = self.initial_temperature + state.rise, self.initial_temperature + rise
        return Exposure(rise, state.dose + damage_increment(ThermalDose(), before, after, duration))
