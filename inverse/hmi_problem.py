"""The inference of an experiment from HMI data, alone or with other measurements, on a fast model that suits it.

The fast model is made twice. The first learns from draws of priors a third wider than those of the inference, and
covers all that may come; what the data leave of it is found by a normal approximation. The second learns from draws
of that, much widened, and spends its shapes of motion where the posterior is.
"""

import dataclasses
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from arfjax import Discretisation, Effort, Experiment, Model, discretise
from inverse.datasets.hmi import HmiData
from inverse.fast_hmi import FastHmi, Verification, prepare_fast
from inverse.hmi_model import plan_sweeps, require_heating, sweeps_of_each
from inverse.inference.experiment import InferenceSettings, anchored, inference_problem, population
from inverse.inference.hmi import hmi_measurement, noise_of, used_rows
from inverse.inference.problem import Measurement, Problem, State
from inverse.inference.sonications import Sonications, models_of
from inverse.inference.widened import widened
from inverse.sampling import laplace

OnStep = Callable[[str], None]

_DRAWS = 100
_WIDER = 4.0 / 3.0
_FOCUSED_DRAWS = 60
_FOCUSED_WIDER = 1.75
"""Standard deviations of the draws in those of the normal approximation: the box then reaches to four of these."""
_STARTS = 3
_EDGE = 0.97
"""Distance from the middle, in half widths of what is covered, from which a point counts as at the edge."""

FOCUSED = Effort(n_modes=100, tolerance=1e-4, n_combinations=1500, n_heat_steps=180)
"""Where the posterior is: more shapes, points and steps of heat, of which each alone would leave the others' errors."""


@dataclasses.dataclass(frozen=True, eq=False)
class FastPrediction:
    """A measurement's prediction by a fast model. No pytree, because the model's positions must be concrete.

    Attributes:
        parts: The fast model; where constants differ from sonication to sonication, one for the rows of each.
        n_rows: Rows of the data.
        in_percent: Whether they are percent of a reference, not metres.
    """

    parts: tuple[FastHmi, ...]
    n_rows: int
    in_percent: bool

    def __call__(self, model: Model | Sonications) -> Float[jax.Array, " n"]:
        """Displacement for every row of the data, NaN where the model is not covered."""
        # A part leaves the rows of other sonications at zero.
        return sum(
            (
                part.predict(each, n_rows=self.n_rows, in_percent=self.in_percent)
                for part, each in zip(self.parts, models_of(model, len(self.parts)), strict=True)
            ),
            jnp.zeros(self.n_rows),
        )

    def excess(self, model: Model | Sonications) -> Float[jax.Array, ""]:
        """How far the model of the worst sonication lies from what is covered, see `FastHmi.excess`."""
        pairs = zip(self.parts, models_of(model, len(self.parts)), strict=True)
        return jnp.max(jnp.stack([part.excess(each) for part, each in pairs]))

    def verify(
        self, models: Sequence[Model | Sonications], settings: Discretisation, *, on_step: OnStep = lambda what: None
    ) -> Verification:
        """The fast model against the full one with some settings."""
        checked = []
        for number, part in enumerate(self.parts):
            checked.append(
                part.verify(
                    [models_of(model, len(self.parts))[number] for model in models],
                    settings,
                    n_rows=self.n_rows,
                    in_percent=self.in_percent,
                    on_step=lambda what, done, of: on_step(f"full model: {what} {done} of {of}"),
                )
            )
        return Verification(
            sum((each.fast for each in checked), np.zeros(self.n_rows)),
            sum((each.full for each in checked), np.zeros(self.n_rows)),
            np.all([each.covered for each in checked], axis=0),
        )


@dataclasses.dataclass(frozen=True)
class HmiProblem:
    """An inference with HMI data in it.

    Attributes:
        problem: What is free, and what was measured.
        prediction: Of the HMI data.
        settings: Grids and mesh that the fast model learnt from.
        remark: What a reader must know of how it was made; empty if nothing.
    """

    problem: Problem
    prediction: FastPrediction
    settings: Discretisation
    remark: str = ""

    def near_edge(self, points: Float[np.ndarray, "point n"]) -> float:
        """Share of unconstrained numbers, such as draws of the posterior, that lie at the edge of what is covered."""

        def excess(point: jax.Array) -> jax.Array:
            return self.prediction.excess(self.problem.state_of(self.problem.values(point)).model)

        return float(np.mean(np.asarray(jax.jit(lambda many: jax.lax.map(excess, many))(jnp.asarray(points))) > _EDGE))

    def verify(self, points: Float[np.ndarray, "point n"], *, on_step: OnStep = lambda what: None) -> Verification:
        """The fast model against the full one at unconstrained numbers, such as draws of the posterior."""
        values = (self.problem.values(jnp.asarray(point)) for point in points)
        return self.prediction.verify(
            [self.problem.state_of(each).model for each in values], self.settings, on_step=on_step
        )


def hmi_problem(
    described: Experiment,
    settings: InferenceSettings,
    data: HmiData,
    others: Sequence[Measurement] = (),
    *,
    seed: int = 0,
    focus: bool = True,
    effort: Effort = Effort(),  # noqa: B008  frozen and without state
    focused_effort: Effort = FOCUSED,
    discretisation: Discretisation | None = None,
    heat_settings: Discretisation | None = None,
    on_step: OnStep = lambda what: None,
) -> HmiProblem:
    """The problem of an experiment's constants given HMI data, and other measurements of the same model.

    Args:
        described: The experiment.
        settings: Its section `[inference]`.
        data: What was measured.
        others: Further measurements, such as `dma_measurement(sweeps, of_liver)`.
        seed: Of the draws that the fast model learns from.
        focus: Whether it learns a second time, where the posterior is.
        effort: How much goes into it the first time.
        focused_effort: How much the second time.
        discretisation: Mesh of the pushes that it learns from; refinement 2 if not given.
        heat_settings: Of sound and heat; refinement 1 if not given.
        on_step: Told in words how far it is.

    Raises:
        InputError: if data, experiment and settings do not go together, or readings were taken while it cooled.

    Accuracy: of 24 draws of the prior of a calibration the worst curve was off by 0.31 percent of its largest value. Of
        12 of the posterior of the paper's three sonications, whose priors are wider, the worst was off by 1.1 percent
        of what the mesh of refinement 2 gives, and by 0.44 percent (half of them by 0.14) once the model had learnt
        where that is. `HmiProblem.verify` tells of the case at hand.
    """
    model = anchored(described.model(), settings)
    require_heating(data, described.stepwise().duration)
    plan = plan_sweeps(data, described.stepwise(), settings.reference_temperature_c)
    fine = discretise(model, refinement=2.0) if discretisation is None else discretisation

    def learn(draws: list[Model], effort: Effort, what: str) -> HmiProblem:
        fast = prepare_fast(
            draws, plan, fine, heat_settings=heat_settings, effort=effort,
            on_step=lambda step, done, of: on_step(f"{what}: {step} {done} of {of}"),
        )  # fmt: skip
        differ = sweeps_of_each(plan, data) if settings.across_sonications else (plan,)
        parts = tuple(FastHmi(fast.curve, sweeps) for sweeps in differ)
        prediction = FastPrediction(parts, len(data.displacement), data.in_percent)
        measured = hmi_measurement(data, prediction, reference_temperature=settings.reference_temperature_c)
        problem = inference_problem(settings, model, (*others, measured), sonications=data.labels)
        return HmiProblem(problem, prediction, fine)

    broad = learn(_draws_of_prior(settings, model, data, others, seed), effort, "fast model")
    if not focus:
        return broad
    normal = laplace(broad.problem, seed=seed, n_starts=_STARTS, on_step=on_step)
    if not (normal.converged and normal.positive_definite):
        why = f"no normal approximation of the posterior was found: {normal.message}"
        return dataclasses.replace(broad, remark=f"The fast model learnt from the priors alone, because {why}.")
    key = jax.random.key(seed + 2)
    points = normal.mode + _FOCUSED_WIDER * (normal.draw(key, _FOCUSED_DRAWS) - normal.mode)
    draws = [broad.problem.state_of(broad.problem.values(jnp.asarray(u))).model for u in [normal.mode, *points]]
    return learn([*models_of(draws[0], 1), *_one_of_each(draws[1:])], focused_effort, "fast model, focused")


def _draws_of_prior(
    settings: InferenceSettings, model: Model, data: HmiData, others: Sequence[Measurement], seed: int
) -> list[Model]:
    noise = {measurement.name: measurement.noise for measurement in others}
    noise["hmi"] = noise_of(data, used_rows(data, settings.reference_temperature_c))
    parameters, root = population(settings, model, noise, data.labels)
    wide = widened(parameters, _WIDER)
    keys = jax.random.split(jax.random.key(seed + 1), _DRAWS)
    points = jax.vmap(lambda key: wide.values(wide.draw(key)))(keys)
    return _one_of_each([wide.write(State(root, noise), point).model for point in points])


def _one_of_each(draws: list[Model | Sonications]) -> list[Model]:
    """Of each draw one sonication's model, in turn: all of them have to be covered, each as well as the others."""
    return [models[number % len(models)] for number, models in enumerate(models_of(draw, 1) for draw in draws)]
