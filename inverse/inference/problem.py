r"""An inference problem: a model, the parameters that are free in it, and what was measured of it.

Several measurements of one model share its constants: DMA and HMI of one liver are one problem with two measurements,
in which the sweeps inform the constants that the curve alone leaves open.

All functions are pure in the flat vector u of unconstrained numbers, so that they can be compiled, batched and
differentiated. Two objectives are kept apart:

- `log_density` is the posterior density of u, with the derivative of the transforms: what samplers explore.
- `cost` is what fits minimise: minus log likelihood plus half the squares of the priors' penalties. Its minimum does
  not depend on the transforms; without priors it is the maximum of the likelihood.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, PRNGKeyArray

from arfjax.errors import InputError
from inverse.inference import places
from inverse.inference.noise import NoiseModel, Series
from inverse.inference.parameter_set import ParameterSet, require_own_places

Predict = Callable[[Any], Float[Array, " n"]]


class Measurement(eqx.Module):
    """What was measured, how a model predicts it, and how it scatters.

    Attributes:
        name: Short, an identifier: noise parameters stand at `noise.<name>.<field>`.
        predict: Prediction of every datum from a model; pure. A pytree whose arrays are leaves is compiled once for all
            data of one shape.
        measured: The data, in `unit`.
        series: Neighbours, coordinate and groups of the data.
        noise: How they scatter.
        unit: Of the data.
        is_long: Whether the prediction is so long a computation that its compilation counts: fits, curvatures and
            profiles then take steps from outside of JAX on one compiled gradient.
    """

    name: str = eqx.field(static=True)
    predict: Predict
    measured: Float[Array, " n"] | Float[np.ndarray, " n"]
    series: Series
    noise: NoiseModel
    unit: str = eqx.field(static=True, default="1")
    is_long: bool = eqx.field(static=True, default=False)

    def __check_init__(self) -> None:
        """Refuse names that no place can hold."""
        if not self.name.isidentifier():
            raise InputError(f"a measurement's name must be an identifier such as `dma`, got `{self.name}`.")


class State(eqx.Module):
    """Everything that parameters can stand in.

    Attributes:
        model: What is simulated: places begin with `model.`.
        noise: Noise of each measurement by its name: places begin with `noise.<name>.`.
    """

    model: Any
    noise: dict[str, NoiseModel]


class Problem(eqx.Module):
    """A model, what is free in it, and what was measured of it.

    Attributes:
        parameters: What is free.
        model: The model, with what is not free at its value.
        measurements: What was measured.
    """

    parameters: ParameterSet
    model: Any
    measurements: tuple[Measurement, ...]

    def __check_init__(self) -> None:
        """Refuse two measurements of one name, parameters without a place, and two in the same."""
        names = [measurement.name for measurement in self.measurements]
        if len(set(names)) < len(names):
            raise InputError(f"measurements need different names, got {', '.join(names)}.")
        state = self.state
        require_own_places(self.parameters.entries, lambda place: places.counted_from_start(state, place))

    @property
    def state(self) -> State:
        """The model and the noise, before any parameter is put in."""
        return State(self.model, {measurement.name: measurement.noise for measurement in self.measurements})

    @property
    def start(self) -> Float[Array, " n"]:
        """Unconstrained numbers of what stands in the model."""
        return self.parameters.start(self.state)

    @property
    def is_long(self) -> bool:
        """Whether any prediction is a long computation."""
        return any(measurement.is_long for measurement in self.measurements)

    @property
    def is_least_squares(self) -> bool:
        """Whether the cost is a sum of squares: normal noise of given size, and priors that are normal or flat."""
        noise_is_free = any(entry.parameter.place.startswith("noise.") for entry in self.parameters.entries)
        normal = all(measurement.noise.is_normal for measurement in self.measurements)
        fixed = all(_is_fixed(measurement.noise) for measurement in self.measurements)
        return normal and fixed and not noise_is_free

    def values(self, u: Float[Array, " n"]) -> Float[Array, " m"]:
        """Values of the parameters, in their units."""
        return self.parameters.values(u)

    def state_of(self, values: Float[Array, " m"]) -> State:
        """Model and noise with the parameters put in."""
        return self.parameters.write(self.state, values)

    def predictions(self, values: Float[Array, " m"]) -> dict[str, Float[Array, " datum"]]:
        """What each measurement should show, by name."""
        model = self.state_of(values).model
        return {measurement.name: measurement.predict(model) for measurement in self.measurements}

    def log_likelihood_of(self, values: Float[Array, " m"]) -> Float[Array, ""]:
        """Logarithm of the density of all data."""
        state = self.state_of(values)
        total = jnp.zeros(())
        for measurement in self.measurements:
            noise, prediction = state.noise[measurement.name], measurement.predict(state.model)
            total = total + noise.log_likelihood(jnp.asarray(measurement.measured), prediction, measurement.series)
        return total

    def log_likelihood(self, u: Float[Array, " n"]) -> Float[Array, ""]:
        """Logarithm of the density of all data."""
        return self.log_likelihood_of(self.values(u))

    def log_prior(self, u: Float[Array, " n"]) -> Float[Array, ""]:
        """Logarithm of the prior density of u."""
        return self.parameters.log_prior(u)

    def log_density(self, u: Float[Array, " n"]) -> Float[Array, ""]:
        """Logarithm of the posterior density of u, but for a constant; minus infinity where it is not a number."""
        total = self.log_prior(u) + self.log_likelihood(u)
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def cost_of(self, values: Float[Array, " m"]) -> Float[Array, ""]:
        """What fits minimise [nats]."""
        return 0.5 * jnp.sum(self.parameters.penalties(values) ** 2) - self.log_likelihood_of(values)

    def cost(self, u: Float[Array, " n"]) -> Float[Array, ""]:
        """What fits minimise [nats]."""
        return self.cost_of(self.values(u))

    def data_residuals_of(self, values: Float[Array, " m"]) -> Float[Array, " residual"]:
        """Independent residuals of all data in standard deviations, of normal noise."""
        state = self.state_of(values)
        return jnp.concatenate(
            [
                state.noise[each.name].residuals(jnp.asarray(each.measured), each.predict(state.model), each.series)
                for each in self.measurements
            ]
        )

    def residuals_of(self, values: Float[Array, " m"]) -> Float[Array, " residual"]:
        """Residuals of the data, then penalties of the priors: half their squares is the cost but for a constant."""
        return jnp.concatenate([self.data_residuals_of(values), self.parameters.penalties(values)])

    def residuals(self, u: Float[Array, " n"]) -> Float[Array, " residual"]:
        """As `residuals_of`."""
        return self.residuals_of(self.values(u))

    def draw_data(self, key: PRNGKeyArray, u: Float[Array, " n"]) -> "Problem":
        """The same problem with data drawn as the parameters u would make them."""
        state = self.state_of(self.values(u))
        drawn = []
        for measurement, each in zip(self.measurements, jax.random.split(key, len(self.measurements)), strict=True):
            noise, prediction = state.noise[measurement.name], measurement.predict(state.model)
            data = noise.draw(each, prediction, measurement.series)
            drawn.append(eqx.tree_at(lambda old: old.measured, measurement, data))
        return eqx.tree_at(lambda problem: problem.measurements, self, tuple(drawn))

    def with_parameters(self, parameters: ParameterSet) -> "Problem":
        """The same model and data with other parameters free."""
        return Problem(parameters, self.model, self.measurements)


def _is_fixed(noise: NoiseModel) -> bool:
    """Whether deviations do not depend on the prediction, so that their logarithms are a constant."""
    return not isinstance(noise.relative, Tracer) and float(noise.relative) == 0.0 and not noise.normalised
