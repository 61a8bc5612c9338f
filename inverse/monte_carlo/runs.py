"""A protocol run for many draws of its constants, one compiled program for all of them."""

from collections.abc import Callable, Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax import (
    AdaptiveSteps,
    Discretisation,
    FixedSteps,
    InputError,
    Model,
    StepwiseProtocol,
    TransientProtocol,
    boiling_time,
    run_stepwise,
    run_transient,
    simulate_heating,
)
from arfjax.model import TabulatedSize
from arfjax.thermal.bioheat import TemperatureHistory, border_rise
from inverse.monte_carlo.spreads import Spread, varied

Outcome = Callable[[Model], dict[str, Array]]
"""What a protocol makes of a model, by the names of `arfjax.io`; all real numbers."""


def stepwise_outcome(protocol: StepwiseProtocol, temperatures: Sequence[float], settings: Discretisation) -> Outcome:
    """Displacement [m] and lesion [m] of the stepwise protocol at temperatures [degC], and the power it takes [W].

    And when tissue boils [s], NaN if never.
    """

    def outcome(model: Model) -> dict[str, Array]:
        heating = simulate_heating(model, protocol, settings)
        result = run_stepwise(model, jnp.asarray(temperatures), protocol, settings, heating=heating)
        return {
            "displacement": result.displacement,
            "lesion_length": result.lesion_length,
            "lesion_diameter": result.lesion_diameter,
            "heating_power": heating.acoustic_power,
            "boiling_time": boiling_time(TemperatureHistory(heating.time, heating.temperature), settings.heat_grid),
            "border_rise": border_rise(heating.temperature),
        }

    return outcome


def transient_outcome(
    model: Model,
    protocol: TransientProtocol,
    settings: Discretisation,
    *,
    steps: FixedSteps | AdaptiveSteps = FixedSteps(),  # noqa: B008  frozen and without state
) -> Outcome:
    """Tracked displacement [m], temperatures [degC] and lesion [m] at the output times [s] of a watched sonication.

    Displacement is NaN where the heating did not converge.

    Raises:
        InputError: if the size of the model's lesion comes from a table.
    """
    if isinstance(model.lesion.size, TabulatedSize):
        raise InputError(
            "a lesion whose size comes from a table is as large in every tissue, so that a watched sonication of "
            'varied tissue needs its own: set `lesion.size` to "dose", or take the stepwise protocol.'
        )

    def outcome(model: Model) -> dict[str, Array]:
        result = run_transient(model, protocol, settings, steps=steps)
        return {
            "tracked_displacement": jnp.where(result.sonication.effort.converged, result.tracked, jnp.nan),
            "thermocouple_temperature": result.thermocouple_temperature,
            "focal_temperature": result.sonication.focal_temperature,
            "heating_time": result.sonication.time,
            "lesion_length": result.sonication.lesion.length,
            "boiling_time": result.sonication.boiling_time,
            "border_rise": border_rise(result.sonication.temperature),
        }

    return outcome


def run_samples(
    outcome: Outcome,
    model: Model,
    spreads: Sequence[Spread],
    factors: Float[np.ndarray, "sample constant"],
    *,
    chunk: int,
    done: int = 0,
) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """Outcomes of all samples in their order, chunk by chunk.

    One after the other within a chunk: a batch would hold the factors of every sample's stiffness at once, which is
    more than memory has, and save no time. Chunks are what can be kept while the rest is still running.

    Args:
        outcome: What the protocol makes of a model.
        model: With the central constants.
        spreads: Of the constants that vary.
        factors: Of every sample and constant.
        chunk: Samples in one call of the compiled program.
        done: Samples at the start that are left out, because they are known.

    Yields:
        Number of the first sample of a chunk, and its outcomes with the sample as first axis.
    """
    numbers = jax.tree.map(jnp.asarray, model)

    @jax.jit
    def sampled(model: Model, row: Array) -> dict[str, Array]:
        return outcome(varied(model, spreads, row))

    @jax.jit
    def run(model: Model, rows: Array, wanted: Array) -> dict[str, Array]:
        shapes = jax.eval_shape(sampled, model, rows[0])

        def one(argument: tuple[Array, Array]) -> dict[str, Array]:
            row, is_wanted = argument
            nothing = {name: jnp.full(shape.shape, jnp.nan, shape.dtype) for name, shape in shapes.items()}
            return jax.lax.cond(is_wanted, lambda: sampled(model, row), lambda: nothing)

        return jax.lax.map(one, (rows, wanted))

    for first in range(done, len(factors), chunk):
        rows = factors[first : first + chunk]
        # The last chunk is filled up with rows that are skipped, so that the program is compiled once.
        filled = np.concatenate([rows, np.ones((chunk - len(rows), rows.shape[1]))])
        results = run(numbers, jnp.asarray(filled), jnp.arange(chunk) < len(rows))
        yield first, {name: np.asarray(values)[: len(rows)] for name, values in results.items()}
