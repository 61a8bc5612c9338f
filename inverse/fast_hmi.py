"""The forward side of a posterior of HMI data: `hmi_model.predict` in tens of milliseconds, never outside its range.

    fast = prepare_fast(draws, sweeps, arfjax.discretise(model, refinement=2.0))
    rows = jax.jit(lambda model: fast.predict(model, n_rows=n, in_percent=True))(model)    # NaN where not covered
    fast.verify(models_of_the_posterior, arfjax.discretise(model, refinement=3.0), n_rows=n, in_percent=True)

A sampler refuses where rows are NaN, and counts how often; at the end it has some of its draws verified.
"""

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from arfjax import (
    Discretisation,
    Effort,
    FastCurve,
    Heating,
    InputError,
    Model,
    focal_temperature_at,
    prepare_curve,
)
from inverse.hmi_model import Sweep, predict

OnStep = Callable[[str, int, int], None]
"""Told what is done, how many times it has been done and how many times it is to be."""

_STATES_OF_A_SWEEP = 12
"""Temperatures at which a sweep is looked at in preparation, at least."""


@dataclasses.dataclass(frozen=True)
class Verification:
    """A fast model against the full one.

    Attributes:
        fast: What the fast model gives for each row, NaN for a model that it does not cover.
        full: What the full one gives.
        covered: Whether the fast one covers each model.
    """

    fast: Float[np.ndarray, "model row"]
    full: Float[np.ndarray, "model row"]
    covered: Bool[np.ndarray, " model"]

    @property
    def errors(self) -> Float[np.ndarray, " model"]:
        """Largest difference of a row over the full model's largest in that curve; NaN where not covered."""
        largest = np.max(np.abs(self.full), axis=1)
        return np.max(np.abs(self.fast - self.full), axis=1) / largest

    @property
    def largest_error(self) -> float:
        """Of all models that are covered; NaN if none is."""
        return float(np.max(self.errors[self.covered])) if np.any(self.covered) else float("nan")


class FastHmi(eqx.Module):
    """The fast model of a set of HMI data; close over it under `jit`.

    Attributes:
        curve: The fast model of the protocol.
        sweeps: Sonications and the states in which they were looked at.
    """

    curve: FastCurve
    sweeps: tuple[Sweep, ...]

    def predict(self, model: Model, *, n_rows: int, in_percent: bool) -> Float[Array, " n"]:
        """As `hmi_model.predict`: displacement for every row of the data, in percent of the reference or in metres.

        All rows are NaN where the model is not covered in any state: see `excess`.

        Accuracy: see `FastCurve`; `verify` measures it.
        Differentiability: in every leaf of the model that may differ (`arfjax.prepare_curve`), forward and reverse,
            under `vmap` and `jit`.
        """
        prediction, excess = jnp.zeros(n_rows), jnp.zeros(())
        for sweep in self.sweeps:
            heating, temperatures = self._states(model, sweep)
            displacement = self.curve.extrapolated(model, temperatures, sweep.protocol, heating=heating)
            values = displacement[1:][sweep.places]
            prediction = prediction.at[sweep.rows].set(100.0 * values / displacement[0] if in_percent else values)
            excess = jnp.maximum(excess, self.curve.excess(model, temperatures, sweep.protocol, heating=heating))
        return jnp.where(excess <= 1.0, prediction, jnp.nan)

    def excess(self, model: Model) -> Float[Array, ""]:
        """How far a model lies from the middle of what was trained on, in its worst state and feature.

        Up to 1 it is covered; infinite where it differs in what may not differ.
        """
        worst = jnp.zeros(())
        for sweep in self.sweeps:
            heating, temperatures = self._states(model, sweep)
            worst = jnp.maximum(worst, self.curve.excess(model, temperatures, sweep.protocol, heating=heating))
        return worst

    def indicator(self, model: Model) -> Float[Array, ""]:
        """Estimate of the relative error of the normalised curve, from what the last third of the shapes contributes.

        Infinite where the model is not covered. It takes about two evaluations.
        """
        worst = jnp.zeros(())
        n_fewer = self.curve.solid.n_modes - self.curve.solid.n_modes // 3
        for sweep in self.sweeps:
            heating, temperatures = self._states(model, sweep)
            curves = [
                self.curve.extrapolated(model, temperatures, sweep.protocol, heating=heating, n_modes=n)
                for n in (n_fewer, self.curve.solid.n_modes)
            ]
            fewer, all_shapes = (curve / curve[0] for curve in curves)
            worst = jnp.maximum(worst, jnp.max(jnp.abs(fewer - all_shapes)) / jnp.max(all_shapes))
        return jnp.where(self.excess(model) <= 1.0, worst, jnp.inf)

    def require_covered(self, model: Model) -> None:
        """Refuse a model, with concrete numbers, that is not covered.

        Raises:
            InputError: if it is not.
        """
        excess = float(jax.jit(lambda numbers: self.excess(numbers))(jax.tree.map(jnp.asarray, model)))
        if not excess <= 1.0:
            raise InputError(
                f"the model lies outside of what the fast model was prepared with (excess {excess:.3g}, at most 1): "
                "prepare it with draws that reach further, or use the full model."
            )

    def verify(
        self,
        models: Sequence[Model],
        settings: Discretisation,
        *,
        n_rows: int,
        in_percent: bool,
        on_step: OnStep = lambda what, done, of: None,
    ) -> Verification:
        """The fast model against the full one with some settings, for models such as draws of a posterior."""
        fast = jax.jit(lambda model: self.predict(model, n_rows=n_rows, in_percent=in_percent))
        full = jax.jit(lambda model: predict(model, self.sweeps, settings, n_rows=n_rows, in_percent=in_percent))
        pairs = []
        for done, model in enumerate(models):
            numbers = jax.tree.map(jnp.asarray, model)
            pairs.append((np.asarray(fast(numbers)), np.asarray(full(numbers))))
            on_step("models", done + 1, len(models))
        ours, theirs = (np.stack(each) for each in zip(*pairs, strict=True))
        return Verification(ours, theirs, np.all(np.isfinite(ours), axis=1))

    def _states(self, model: Model, sweep: Sweep) -> tuple[Heating, Float[Array, " state"]]:
        """The sonication, and the temperatures of the reference and of all states."""
        heating = self.curve.heating(model, sweep.protocol)
        states = jnp.asarray(sweep.states)
        temperatures = focal_temperature_at(heating, states) if sweep.in_time else states
        return heating, jnp.concatenate([jnp.asarray([sweep.reference_temperature]), temperatures])


def prepare_fast(
    draws: Sequence[Model],
    sweeps: tuple[Sweep, ...],
    settings: Discretisation,
    *,
    heat_settings: Discretisation | None = None,
    effort: Effort = Effort(),  # noqa: B008  frozen and without state
    on_step: OnStep = lambda what, done, of: None,
) -> FastHmi:
    """The fast model of HMI data for all models like some draws, see `arfjax.prepare_curve`.

    Args:
        draws: Models that span what a sampler will ask for, such as 100 draws of the prior, a third wider than it.
        sweeps: What `plan_sweeps` makes of the data.
        settings: Mesh of the pushes that it learns from: refinement 2.
        heat_settings: Of sound and heat; refinement 1 if not given.
        effort: How much to put in.
        on_step: Told of the progress.

    Raises:
        InputError: if the draws differ in what may not differ, or no draw has a lesion.
    """
    protocols = []
    for sweep in sweeps:
        ends = (sweep.protocol.start_temperature, sweep.protocol.final_temperature)
        between = np.linspace(*ends, _STATES_OF_A_SWEEP)
        known = np.zeros(0) if sweep.in_time else np.asarray(sweep.states)
        protocols.append((sweep.protocol, np.union1d(np.append(known, sweep.reference_temperature), between)))
    curve = prepare_curve(draws, protocols, settings, heat_settings=heat_settings, effort=effort, on_step=on_step)
    return FastHmi(curve, sweeps)
