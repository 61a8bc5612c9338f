"""A data set examined: which causes it can see, and what the tests of all of them say."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from inverse.diagnosis.cause import DmaCause, Extension, every_shape
from inverse.diagnosis.decision import REPLICATES, Decision, Refitted, decide
from inverse.diagnosis.dma_problem import DmaProblem
from inverse.diagnosis.extended_fit import fit_extended
from inverse.diagnosis.free_forms import Place, dma_free_forms
from inverse.diagnosis.noise import Noise, noise_family
from inverse.diagnosis.screening import Alternative, Screen, visibility

DETECTABLE = 4.5
"""d' at which an effect counts as detectable: it is found in about 96 of 100 data sets."""
LEAST_VISIBILITY = 0.02
"""Part of a cause's effect that the fitted constants must leave, or the data cannot see it."""
MOST_IMPLAUSIBLE = 10.0
"""Detectable strength over the plausible one above which the data cannot see the cause either."""


@dataclasses.dataclass(frozen=True)
class NotTestable:
    """A cause that these data cannot see.

    Attributes:
        name: Which.
        why: In words.
        what_would_help: The measurement that would show it.
    """

    name: str
    why: str
    what_would_help: str


@dataclasses.dataclass(frozen=True)
class Examined:
    """A data set examined: what it can see, and what follows.

    Attributes:
        problem: The data and the fit.
        causes: The library.
        residuals: Measured less predicted, weighted.
        fitted: Derivatives in the fitted constants.
        size: Standard deviation of the residuals.
        seen: Alternatives that the data can see.
        not_testable: Causes that they cannot see.
        places: Where the free forms act.
        family: Noise members.
        decision: What follows.
    """

    problem: DmaProblem
    causes: tuple[DmaCause, ...]
    residuals: Float[np.ndarray, " n"]
    fitted: Float[np.ndarray, "n p"]
    size: float
    seen: tuple[Alternative, ...]
    not_testable: tuple[NotTestable, ...]
    places: tuple[Place, ...]
    family: tuple[Noise, ...]
    decision: Decision

    def extension(self, name: str) -> Extension:
        """The cause of this name in its most probable shape."""
        cause = next(cause for cause in self.causes if cause.name == name)
        shape = self.alternative(name).shape
        return Extension(cause, 0.0 if shape is None else shape)

    def alternative(self, name: str) -> Alternative:
        """The most probable shape of the cause of this name."""
        return self.decision.omnibus.alternatives[self.row(name)]

    def row(self, name: str) -> int:
        """Where the test of everything has the most probable shape of the cause of this name."""
        row = self.decision.omnibus.best(name)
        if row is None:
            raise KeyError(f"these data cannot see {name}")
        return row

    def direction(self, extension: Extension) -> Float[np.ndarray, "n 1"]:
        """Derivative of the weighted prediction in the strength of an extension."""
        return self.alternative(extension.cause.name).directions

    def linear_strengths(self, extensions: Sequence[Extension]) -> Float[np.ndarray, " extension"]:
        """Strengths of the extensions together in the linearised model: where a refit starts."""
        added = [self.alternative(extension.cause.name) for extension in extensions]
        return _linear_strengths(added, self.residuals, self.fitted)


def examine(
    problem: DmaProblem,
    causes: Sequence[DmaCause],
    rng: np.random.Generator,
    *,
    level: float = 0.05,
    replicates: int = REPLICATES,
    program: Sequence[DmaCause] = (),
) -> Examined:
    """Test every cause and every free form on a fitted data set.

    Args:
        problem: The data and the fit.
        causes: The library to look in.
        rng: For replicates.
        level: Probability of finding something wrong where nothing is.
        replicates: Data sets of noise alone that error rates are calibrated on.
        program: Causes that the compiled refits hold beside the library, so that other libraries need no others.
    """
    program = (*program, *(cause for cause in causes if cause.name not in {one.name for one in program}))
    family = noise_family(problem.orderings(), problem.frequencies())
    residuals, fitted, constants = _fitted_in_its_noise(problem, family, program)
    size = float(np.sqrt(np.sum(residuals**2) / max(len(residuals) - fitted.shape[1], 1)))
    free_forms, places = _free_forms(problem, residuals)
    seen, not_testable = _testable(problem.directions(every_shape(causes), constants), fitted, size, causes)
    by_name = {cause.name: cause for cause in causes}

    def extend(added: Sequence[Alternative], noise: Noise) -> Refitted:
        extensions = [Extension(by_name[a.name], 0.0 if a.shape is None else a.shape) for a in added]
        start = _linear_strengths(added, residuals, fitted)
        refit = fit_extended(problem, extensions, noise, start, library=program, profile=False)
        return Refitted(refit.residuals, refit.directions, refit.misfit, refit.others)

    decision = decide(
        residuals, fitted, seen, free_forms, family, rng, extend=extend, level=level, replicates=replicates
    )
    return Examined(
        problem, tuple(causes), residuals, fitted, size, tuple(seen), not_testable, tuple(places), family, decision
    )


def _fitted_in_its_noise(problem: DmaProblem, family: Sequence[Noise], program: Sequence[DmaCause]):
    """Residuals, derivatives and constants of the model fitted in the likeliest kind of noise.

    A fit that takes the noise for white strays farther than the linearisation holds where a part of the data is louder:
    measured on noise that is three times larger above 40 Hz, one data set in six was found wrong for that alone.
    """
    residuals, fitted = problem.residuals(), problem.fitted_directions()
    _, member, _ = Screen(fitted, (), family).noise_evidence(residuals[:, None])
    if family[member[0]].is_white:
        return residuals, fitted, problem.constants
    refit = fit_extended(problem, (), family[member[0]], np.zeros(0), library=program, profile=False)
    return refit.residuals, refit.directions, refit.constants


def _free_forms(problem: DmaProblem, residuals: Float[np.ndarray, " n"]) -> tuple[list[Alternative], list[Place]]:
    coordinates, conditions = problem.weights.shape[1], problem.conditions
    predicted = problem.measured - residuals.reshape(problem.weights.shape) / problem.weights
    phase = predicted[:, 1] if problem.has_phase else np.zeros(problem.rows)
    forms, places = dma_free_forms(
        problem.frequencies(),
        np.repeat(np.asarray(problem.conditions.temperature), coordinates),
        np.repeat(np.asarray(problem.conditions.sweep), coordinates),
        np.tile(np.arange(coordinates), problem.rows),
        tuple(sweep.label for sweep in problem.sweeps),
        np.repeat(np.exp(predicted[:, 0] + 1j * phase), coordinates),
        (
            np.repeat(np.asarray(conditions.time_in_sweep), coordinates),
            np.repeat(np.asarray(conditions.exposure), coordinates),
        ),
    )
    weights = problem.weights.ravel()[:, None]
    return [dataclasses.replace(form, directions=weights * form.directions) for form in forms], places


def _testable(
    alternatives: Sequence[Alternative], fitted: Float[np.ndarray, "n p"], size: float, causes: Sequence[DmaCause]
) -> tuple[list[Alternative], tuple[NotTestable, ...]]:
    """Alternatives that the data can see, and why the others cannot be seen."""
    seen, hidden = [], []
    for cause in causes:
        shapes = [a for a in alternatives if a.name == cause.name]
        visible = [float(visibility(a.directions, fitted)[0]) for a in shapes]
        detectable = [detectable_strength(a, v, size) for a, v in zip(shapes, visible, strict=True)]
        usable = [
            a
            for a, v, d in zip(shapes, visible, detectable, strict=True)
            if v >= LEAST_VISIBILITY and d <= MOST_IMPLAUSIBLE * cause.plausible
        ]
        seen += usable
        if usable:
            continue
        best = int(np.argmax(visible))
        if not np.any(shapes[best].directions):
            why = "it has no effect on these data"
        elif visible[best] < LEAST_VISIBILITY:
            why = f"the fitted constants imitate all but {100.0 * visible[best]:.2g} % of its effect"
        else:
            why = (
                f"it would have to be {min(detectable):.2g} {cause.unit} to be seen, "
                f"where {cause.plausible:.2g} {cause.unit} is plausible"
            )
        hidden.append(NotTestable(cause.name, why, cause.helps))
    return seen, tuple(hidden)


def detectable_strength(alternative: Alternative, visible: float, size: float) -> float:
    """Strength at which an effect is found in about 96 of 100 data sets."""
    length = float(np.linalg.norm(alternative.directions)) * visible
    return DETECTABLE * size / max(length, 1e-300)


def _linear_strengths(
    alternatives: Sequence[Alternative], residuals: Float[np.ndarray, " n"], fitted: Float[np.ndarray, "n p"]
) -> Float[np.ndarray, " alternative"]:
    """Strengths of alternatives of one direction each in the linearised model, all residuals weighing the same."""
    columns = np.concatenate([*(alternative.directions for alternative in alternatives), fitted], axis=1)
    lengths = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return (np.linalg.lstsq(columns / lengths, residuals, rcond=1e-10)[0] / lengths)[: len(alternatives)]
