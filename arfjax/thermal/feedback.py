"""Bioheat with feedback: tissue's constants follow its temperature and dose, and so does the heat that sound leaves.

The heat comes from a function of temperature and dose (a sound field, which this file knows nothing of). It is asked
again whenever any cell's temperature has moved by more than a tolerance since it was last asked; without a tolerance
once, at the start: the frozen field.

An answer serves while temperature moves on by about as much again. So the source is not asked for the temperature as
it is, but for where it will be half way: every cell half as far ahead as it has come since the last time.
"""

import functools
import math
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.ad_checkpoint import checkpoint_name
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

_ANSWER = "answer of the source"


class Effort(eqx.Module):
    """What a run took, and whether it came to its end.

    Attributes:
        n_steps: Steps that count.
        n_rejected: Steps that were tried and found too long.
        error: Largest error of a step that counts, as the first stage alone would have made it [K]; the result's own
            is far smaller.
        converged: Whether the end was reached with finite temperatures.
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
    """What the source last answered, and what the tissue was like then.

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

    Accuracy: second order in the time step for smooth constants and a frozen source. What a source that follows lags
    behind falls faster than in proportion to `tolerance` while the tissue heats steadily, as long as the steps are
    short beside the time between updates; after a turn from cooling to heating in proportion to it.
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
    asking = Asking(source, initial, tolerance)

    # Each step is computed again on the way back: its many intermediate results are not worth their memory. What the
    # source answered is kept, so that the source, which recomputes its own intermediate results, is not asked thrice.
    @functools.partial(jax.checkpoint, policy=jax.checkpoint_policies.save_only_these_names(_ANSWER))
    def step(carry: tuple[Exposure, Asked], given: tuple[Array, Array]) -> tuple[tuple[Exposure, Asked], tuple]:
        state, asked = carry
        length, power = given
        asked, moved = asking.again(state, asked, power)
        asked = checkpoint_name(asked, _ANSWER)
        heat = power * asked.heat
        after, error = tissue.step(state, heat, length)
        return (after, asked), (after, heat, moved, jnp.max(jnp.abs(error)))

    _, (states, heat, updated, error) = jax.lax.scan(step, (start, asking.first(start)), (lengths, powers))
    states = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), start, states)
    finite = jnp.all(jnp.isfinite(states.rise))
    effort = Effort(jnp.asarray(len(lengths)), jnp.asarray(0), jnp.max(error), finite)
    return FeedbackHistory(phase_times(phases), initial + states.rise, states.dose, heat, jnp.cumsum(updated), effort)


class Asking(eqx.Module):
    """Asks the source; its own intermediate results are computed again in reverse mode."""

    source: HeatSource
    initial_temperature: Float[Array, ""]
    tolerance: float = eqx.field(static=True)

    def first(self, state: Exposure) -> Asked:
        """The answer for the tissue as it is."""
        heat = jax.checkpoint(self.source)(self.initial_temperature + state.rise, state.dose)
        return Asked(heat, state.rise, state.dose)

    def again(self, state: Exposure, asked: Asked, power: Scalar) -> tuple[Asked, Array]:
        """The answer that serves from here on, and whether it is a new one: only where the tissue has moved."""
        moved = (power > 0.0) & (movement(state, asked) > self.tolerance)
        if self.tolerance == FROZEN:
            return asked, moved  # spares compiling the source once more

        def ahead() -> Asked:
            reach = jnp.clip(0.5 * (state.rise - asked.rise), -0.5 * self.tolerance, 0.5 * self.tolerance)
            answer = self.first(Exposure(state.rise + reach, state.dose))
            return Asked(answer.heat, state.rise, state.dose)

        return jax.lax.cond(moved, ahead, lambda: asked), moved


def movement(state: Exposure, asked: Asked | Exposure) -> Float[Array, ""]:
    """How far the tissue has moved since something was asked: the largest change [K], or doublings of dose."""
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
