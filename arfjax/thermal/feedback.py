"""Bioheat with feedback: tissue's constants follow its temperature and dose, and so does the heat that sound leaves.

The heat comes from a function of temperature and dose (a sound field, which this file knows nothing of). It is asked
again whenever any cell's temperature has moved by more than a tolerance since it was last asked; without a tolerance
once, at the start: the frozen field.
"""

import math
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.media import Scalar
from arfjax.thermal.bioheat import Phase, phase_times
from arfjax.thermal.conduction import Walls, cell_geometry
from arfjax.thermal.splitting import Cells
from arfjax.thermal.varying import Exposure, ThermalProperties, Tissue

HeatSource = Callable[[Cells, Cells], Cells]
"""Heat deposition [W/m^3] at full power from each cell's temperature [degC] and dose [equivalent min at 43 degC]."""

FROZEN = math.inf
"""Tolerance of a source that is asked only once."""


class Effort(eqx.Module):
    """What a run took, and whether it came to its end.

    Attributes:
        n_steps: Steps that count.
        n_rejected: Steps that were tried and found too long.
        error: Largest error of a step that counts, as the first stage alone would have made it [K]; the result's own
            is far smaller.
        converged: Whether the end was reached; if not, what lies beyond the last step is infinite.
    """

    n_steps: Array
    n_rejected: Array
    error: Float[Array, ""]
    converged: Array


class FeedbackHistory(eqx.Module):
    """Course of a sonication, at the start and at the output times.

    Attributes:
        time: [s].
        temperature: [degC].
        dose: CEM43 [equivalent min at 43 degC].
        heat: Heat deposition before each output time but the start [W/m^3].
        updates: How often the source had been asked again by each of these times.
        effort: What the run took.
    """

    time: Float[Array, " time"]
    temperature: Float[Array, "time r z"]
    dose: Float[Array, "time r z"]
    heat: Float[Array, "step r z"]
    updates: Array
    effort: Effort


class Asked(eqx.Module):
    """What the source last answered, and to which temperature.

    Attributes:
        heat: [W/m^3] at full power.
        rise: Above the initial temperature [K].
        dose: [equivalent min at 43 degC].
    """

    heat: Cells
    rise: Cells
    dose: Cells


def solve_with_feedback(
    properties: ThermalProperties,
    source: HeatSource,
    grid: AxisymmetricGrid,
    *,
    phases: Sequence[Phase],
    initial_temperature: Scalar,
    arterial_temperature: Scalar,
    tolerance: float = FROZEN,
    walls: Walls | None = None,
) -> FeedbackHistory:
    """Temperature and dose of tissue whose constants and heat follow both.

    Args:
        properties: Thermal constants at the cell centres of `grid` from temperature and dose there.
        source: Heat deposition at full power from temperature and dose.
        grid: Where the cells lie.
        phases: Stretches of time, one after the other, each with its share of the heat.
        initial_temperature: Of all cells at time 0 [degC].
        arterial_temperature: Of the blood that enters [degC].
        tolerance: How far temperature may move anywhere before `source` is asked again [K]. Doubling of a dose beyond
            one minute counts as a kelvin, since tissue that stays hot changes too.
        walls: All at the initial temperature when None.

    Raises:
        InputError: if there is no phase, or the tolerance is not positive.

    Accuracy: second order in the time step for smooth constants and a frozen source. A source that follows is up to
    `tolerance` late, an error proportional to it.
    Steps far longer than a cell's own time constant are stable while its conductances over its capacity grow by less
    than 24 percent in one of them.
    Differentiability: forward and reverse in all that `properties` and `source` hold, in the phases, temperatures and
    walls; the steps at which the source is asked again count as given. Each step is computed again for the reverse
    mode, so that memory is that of the temperatures.
    Cost: two tridiagonal factorisations and four solves a step, cells times steps; under `vmap` the source is asked in
    every step.
    """
    if not phases:
        raise InputError("`phases` is empty; give at least one `Phase`.")
    if not tolerance > 0.0:
        raise InputError(f"`tolerance` must be positive [K], or infinite for a frozen field, got {tolerance}.")
    initial = jnp.asarray(initial_temperature, dtype=float)
    tissue = Tissue(properties, cell_geometry(grid), Walls() if walls is None else walls, initial, arterial_temperature)
    lengths, powers = step_lengths(phases), step_powers(phases)
    start = Exposure(jnp.zeros(grid.shape), jnp.zeros(grid.shape))
    ask = asking(source, initial)
    asked = ask(start)

    # Each step is computed again on the way back: its many intermediate results are not worth their memory.
    @jax.checkpoint
    def step(carry: tuple[Exposure, Asked], given: tuple[Array, Array]) -> tuple[tuple[Exposure, Asked], tuple]:
        state, asked = carry
        length, power = given
        moved = (power > 0.0) & (movement(state, asked) > tolerance)
        asked = ask_again(ask, moved, state, asked, tolerance)
        heat = power * asked.heat
        after, error = tissue.step(state, heat, length)
        return (after, asked), (after, heat, moved, jnp.max(jnp.abs(error)))

    _, (states, heat, updated, error) = jax.lax.scan(step, (start, asked), (lengths, powers))
    states = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), start, states)
    effort = Effort(jnp.asarray(len(lengths)), jnp.asarray(0), jnp.max(error), jnp.asarray(True))
    return FeedbackHistory(phase_times(phases), initial + states.rise, states.dose, heat, jnp.cumsum(updated), effort)


def asking(source: HeatSource, initial_temperature: Float[Array, ""]) -> Callable[[Exposure], Asked]:
    """What asks the source; its own intermediate results are computed again in reverse mode."""
    heat = jax.checkpoint(source)

    def ask(state: Exposure) -> Asked:
        return Asked(heat(initial_temperature + state.rise, state.dose), state.rise, state.dose)

    return ask


def ask_again(ask: Callable[[Exposure], Asked], moved: Array, state: Exposure, asked: Asked, tolerance: float) -> Asked:
    """The source's answer for `state` where the tissue has moved, else the last one."""
    if tolerance == FROZEN:
        return asked  # spares compiling the source once more
    return jax.lax.cond(moved, lambda: ask(state), lambda: asked)


def movement(state: Exposure, asked: Asked) -> Float[Array, ""]:
    """How far the tissue has moved since the source was asked: the largest change [K], or doublings of dose."""
    doublings = jnp.log2((1.0 + state.dose) / (1.0 + asked.dose))
    return jax.lax.stop_gradient(jnp.maximum(jnp.max(jnp.abs(state.rise - asked.rise)), jnp.max(doublings)))


def step_lengths(phases: Sequence[Phase]) -> Float[Array, " step"]:
    """Length of every step of every phase [s]."""
    return jnp.concatenate([jnp.broadcast_to(jnp.asarray(phase.time_step), (phase.n_steps,)) for phase in phases])


def step_powers(phases: Sequence[Phase]) -> Float[Array, " step"]:
    """Factor on the heat in every step of every phase."""
    counts = np.asarray([phase.n_steps for phase in phases])
    powers = jnp.stack([jnp.asarray(phase.power, dtype=float) for phase in phases])
    return jnp.repeat(powers, counts, total_repeat_length=int(counts.sum()))
