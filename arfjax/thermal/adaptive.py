"""Bioheat with feedback in steps as long as a tolerance allows.

The step is that of `arfjax.thermal.varying`; diffrax chooses its length by the step's own estimate of its error, and
hits every output time and every switch of the power exactly.
"""

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.media import Scalar
from arfjax.thermal.bioheat import Phase, phase_times
from arfjax.thermal.conduction import Walls, cell_geometry
from arfjax.thermal.feedback import (
    FROZEN,
    Asked,
    Asking,
    Effort,
    FeedbackHistory,
    HeatSource,
    step_powers,
)
from arfjax.thermal.splitting import Cells
from arfjax.thermal.varying import Exposure, ThermalProperties, Tissue

_MOST_STEPS = 16**4
"""Bound on the number of steps; a run that needs more cannot meet its error and is reported as not converged."""


def solve_adaptively(
    properties: ThermalProperties,
    source: HeatSource,
    grid: AxisymmetricGrid,
    *,
    phases: Sequence[Phase],
    initial_temperature: Scalar,
    arterial_temperature: Scalar,
    error: float = 0.05,
    tolerance: float = FROZEN,
    walls: Walls | None = None,
    mode: Literal["reverse", "forward"] = "reverse",
) -> FeedbackHistory:
    """As `arfjax.thermal.feedback.solve_with_feedback`, in steps chosen by their error.

    Args:
        properties: Thermal constants at the cell centres of `grid` from temperature and dose there.
        source: Heat deposition at full power from temperature and dose.
        grid: Where the cells lie.
        phases: Stretches of time; the ends of their steps are the output times.
        initial_temperature: Of all cells at time 0 [degC].
        arterial_temperature: Of the blood that enters [degC].
        error: Largest error of temperature that a step may make anywhere [K], as the first stage of the step alone
            would make it; the result's own error is far smaller.
        tolerance: How far temperature may move before `source` is asked again [K]; see `solve_with_feedback`.
        walls: All at the initial temperature when None.
        mode: Which derivatives can be taken; a loop whose length is not known allows one of the two.

    Raises:
        InputError: if there is no phase, or a tolerance is not positive.

    Accuracy: the error of temperature falls in proportion to `error`, and is a small part of it.
    Differentiability: in the `mode` asked for, as for fixed steps, with the lengths of the steps counted as given.
    """
    if not phases:
        raise InputError("`phases` is empty; give at least one `Phase`.")
    if not (0.0 < error < math.inf and tolerance > 0.0):
        raise InputError(f"`error` and `tolerance` must be positive [K], got {error} and {tolerance}.")
    initial = jnp.asarray(initial_temperature, dtype=float)
    tissue = Tissue(properties, cell_geometry(grid), Walls() if walls is None else walls, initial, arterial_temperature)
    times = phase_times(phases)
    solver = _Stepper(tissue, Asking(source, initial, tolerance))
    nothing = Exposure(jnp.zeros(grid.shape), jnp.zeros(grid.shape))
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(_nothing),
        solver,
        t0=times[0],
        t1=times[-1],
        dt0=times[1] - times[0],
        y0=_State(nothing, jnp.zeros(grid.shape), jnp.asarray(0.0), jnp.asarray(0.0)),
        args=(times, step_powers(phases)),
        saveat=diffrax.SaveAt(ts=times),
        stepsize_controller=diffrax.ClipStepSizeController(
            diffrax.PIDController(rtol=0.0, atol=error, norm=_largest), step_ts=times
        ),
        adjoint=diffrax.RecursiveCheckpointAdjoint() if mode == "reverse" else diffrax.ForwardMode(),
        max_steps=_MOST_STEPS,
        throw=False,
    )
    states = solution.ys
    assert isinstance(states, _State)
    effort = Effort(
        solution.stats["num_accepted_steps"],
        solution.stats["num_rejected_steps"],
        states.error[-1],
        (solution.result == diffrax.RESULTS.successful) & jnp.all(jnp.isfinite(states.exposure.rise)),
    )
    tissue_states = states.exposure
    return FeedbackHistory(
        times, initial + tissue_states.rise, tissue_states.dose, states.heat[1:], states.updates[1:], effort
    )


class _State(eqx.Module):
    """What diffrax carries and saves: the tissue, the heat of the last step, updates and the largest error so far."""

    exposure: Exposure
    heat: Cells
    updates: Float[Array, ""]
    error: Float[Array, ""]


class _Stepper(diffrax.AbstractSolver):
    """The step of `Tissue` as diffrax wants it; what it carries from step to step is the source's last answer."""

    tissue: Tissue
    asking: Asking
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    def order(self, terms: Any) -> int:
        """Of the step's error estimate, which diffrax takes for that of the method: two."""
        return 2

    def init(self, terms: Any, t0: Any, t1: Any, y0: _State, args: Any) -> Asked:
        """Ask the source for the first time."""
        return self.asking.first(y0.exposure)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: _State, args: Any, solver_state: Asked, made_jump: Any
    ) -> tuple[_State, _State, dict[str, _State], Asked, diffrax.RESULTS]:
        """One step; it lies between two output times, and so in one phase."""
        state = y0.exposure
        times, powers = args
        power = powers[jnp.clip(jnp.searchsorted(times, 0.5 * (t0 + t1)) - 1, 0, len(powers) - 1)]
        asked, moved = self.asking.again(state, solver_state, power)
        heat = power * asked.heat
        after, error = self.tissue.step(state, heat, t1 - t0)
        largest = jax.lax.stop_gradient(jnp.max(jnp.abs(error)))
        result = _State(after, heat, y0.updates + moved, jnp.maximum(y0.error, largest))
        errors = eqx.tree_at(lambda each: each.exposure.rise, _nothing(t0, y0, args), error)
        return result, errors, {"y0": y0, "y1": result}, asked, diffrax.RESULTS.successful

    def func(self, terms: Any, t0: Any, y0: _State, args: Any) -> _State:
        """Of no use here."""
        return _nothing(t0, y0, args)


def _nothing(time: Any, state: _State, arguments: Any) -> _State:
    """Diffrax asks for a vector field; the stepper has its own."""
    return jax.tree.map(jnp.zeros_like, state)


def _largest(errors: _State) -> Float[Array, ""]:
    return jnp.max(jnp.abs(errors.exposure.rise))
