"""The diagnosis of a dynamic mechanical analysis, from the data to a verdict."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from inverse.datasets.dma import DmaData
from inverse.diagnosis.cause import DmaCause, Extension
from inverse.diagnosis.causes import DMA_CAUSES
from inverse.diagnosis.decision import REPLICATES, Decision, decide
from inverse.diagnosis.dma_problem import DmaProblem, dma_problem
from inverse.diagnosis.extended_fit import ExtendedFit, fit_extended
from inverse.diagnosis.free_forms import Place, dma_free_forms
from inverse.diagnosis.gain import Gain, held_out_gain
from inverse.diagnosis.noise import noise_family
from inverse.diagnosis.noise_gate import NoiseGate, noise_gate
from inverse.diagnosis.screening import Alternative, Screen, visibility
from inverse.diagnosis.where import Absorbed, Whiteness, absorbed_by_places, whiteness
from inverse.dma_fit import FRACTIONAL, ZenerModel

VERDICTS = ("adequate", "named", "confusable", "unexplained", "noise-model", "fit-failure")
DETECTABLE = 4.5
"""d' at which an effect counts as detectable: it is found in about 96 of 100 data sets."""
LEAST_VISIBILITY = 0.02
"""Part of a cause's effect that the fitted constants must leave, or the data cannot see it."""
DOMINANT_SHARE, DOMINANT_RATIO = 0.25, 2.0
"""A cause is named although something is left if it leaves at most this part of the sum of squares, and the next best
cause leaves at least this many times as much."""
MOST_IMPLAUSIBLE = 10.0
"""Detectable strength over the plausible one above which the data cannot see the cause either."""


@dataclasses.dataclass(frozen=True)
class CauseReport:
    """What is said about one cause that these data can see.

    Attributes:
        cause: Which.
        shape: Value of its second parameter that fits best, or None.
        statistic: t of its strength.
        p_value: That noise alone gives any cause or free form as improbable a value.
        p_alone: p-value of this cause by itself.
        estimate: Strength, refitted in full where it was put into the model, else from the linearisation.
        interval: At 95 %.
        detectability: Strength that would be found in about 96 of 100 data sets.
        status: `named`, `confusable`, `ruled out` (what it leaves is conspicuous), or `not needed`.
        left: p-value of what the model with this cause leaves, where it was put in.
        converged: Whether the refit did; True where there was none.
    """

    cause: DmaCause
    shape: float | None
    statistic: float
    p_value: float
    p_alone: float
    estimate: float
    interval: tuple[float, float]
    detectability: float
    status: str
    left: float | None
    converged: bool


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
class Diagnosis:
    """The answer.

    Attributes:
        verdict: One of `VERDICTS`.
        level: Probability of finding something wrong where nothing is.
        problem: The data and the fit.
        decision: Statistics behind the verdict; None after a failure of the fit.
        causes: In rank order.
        not_testable: What these data cannot see.
        noise: The noise gate, for the model that the verdict ends with.
        residuals_whiteness: Of the fit without extensions.
        places: Free forms by how improbable they are, tested on what the verdict's model leaves.
        extended: The refit with the named causes, or None.
        gain: What it is worth on data that it did not see, or None.
        audit: What the fit itself says against its numbers.
        seed: Of every random number.
    """

    verdict: str
    level: float
    problem: DmaProblem
    decision: Decision | None
    causes: tuple[CauseReport, ...]
    not_testable: tuple[NotTestable, ...]
    noise: NoiseGate | None
    residuals_whiteness: tuple[Whiteness, ...]
    places: tuple[Absorbed, ...]
    extended: ExtendedFit | None
    gain: Gain | None
    audit: tuple[str, ...]
    seed: int

    @property
    def named(self) -> tuple[str, ...]:
        """Causes that are named; empty where several cannot be told apart.

        One may be named although the verdict is `unexplained`: it explains by far the most, and not all.
        """
        return self.decision.named if self.decision is not None and self.verdict in ("named", "unexplained") else ()

    @property
    def confusable(self) -> tuple[tuple[str, ...], ...]:
        """Sets of causes that these data cannot tell apart."""
        return (self.decision.named,) if self.decision is not None and self.verdict == "confusable" else ()


def diagnose_dma(
    data: DmaData,
    *,
    model: ZenerModel = FRACTIONAL,
    causes: Sequence[DmaCause] = DMA_CAUSES,
    level: float = 0.05,
    seed: int = 0,
    replicates: int = REPLICATES,
    gain: bool = True,
    on_step: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Say what is wrong with the model of a dynamic mechanical analysis, and what mending it is worth.

    Args:
        data: From `read_dma`, in the order of the file.
        model: The null model, fitted to every sweep by itself.
        causes: The library to look in.
        level: Probability of finding something wrong where nothing is.
        seed: Of starts and replicates.
        replicates: Data sets of noise alone that error rates are calibrated on.
        gain: Whether to measure the held-out gain.
        on_step: Told what is being done.

    Raises:
        ValueError: if no sweep has enough frequencies, or JAX runs in single precision.
    """
    on_step("fitting")
    problem, _ = dma_problem(data, model, seed=seed)
    audit = _audit(problem)
    failed = [fit for fit in problem.fits if not fit.converged]
    if failed:
        return Diagnosis("fit-failure", level, problem, None, (), (), None, (), (), None, None, audit, seed)

    on_step("testing all causes")
    rng = np.random.default_rng(seed)
    residuals, fitted = problem.residuals(), problem.fitted_directions()
    alternatives = problem.directions(causes)
    family = noise_family(problem.orderings(), problem.frequencies())
    free_forms, places = _free_forms(problem)
    size = float(np.sqrt(np.mean(residuals**2) * len(residuals) / max(len(residuals) - fitted.shape[1], 1)))
    seen, not_testable = _testable(alternatives, fitted, size, causes)
    decision = decide(residuals, fitted, seen, free_forms, family, rng, level=level, replicates=replicates)

    verdict, extended, worth = decision.verdict, None, None
    decision = _with_dominant(decision, problem, causes, residuals, fitted, family)
    noise_index = decision.omnibus.null_noise if decision.left is None else decision.left.null_noise
    added = _chosen(decision, causes)
    start = _linear_strengths(decision, added, residuals, fitted, family)
    reports = _reports(decision, causes, seen, problem, residuals, fitted, family, size)
    if decision.named:
        on_step("refitting with " + " and ".join(e.cause.name for e in added))
        extended = fit_extended(problem, added, family[noise_index], start)
        if gain:
            on_step("measuring the gain on data left out")
            worth = held_out_gain(problem, added, family[noise_index], extended.strengths)
    directions = [a.directions for a in seen if _is_one_of(a, added)]
    model_directions = np.concatenate([fitted, *directions], axis=1)
    left = residuals if extended is None else extended.residuals
    gate = noise_gate(Screen(model_directions, (), family), left, problem, rng, replicates=replicates)
    if verdict == "adequate" and not gate.as_thought:
        verdict = "noise-model"
    tested = decision.left if decision.left is not None and decision.named else decision.omnibus
    return Diagnosis(
        verdict=verdict,
        level=level,
        problem=problem,
        decision=decision,
        causes=reports,
        not_testable=not_testable,
        noise=gate,
        residuals_whiteness=whiteness(problem, residuals, fitted, rng),
        places=absorbed_by_places(tested, places, left, model_directions),
        extended=extended,
        gain=worth,
        audit=audit,
        seed=seed,
    )


def _with_dominant(decision, problem, causes, residuals, fitted, family) -> Decision:
    """Name what explains by far the most where no cause explains all.

    Only effects far above the noise come here: near it, a cause cannot take three quarters of the residuals away.
    """
    if decision.verdict != "unexplained":
        return decision
    before, after = float(np.sum(residuals**2)), {}
    for name in decision.candidates:
        extension = _extension(name, decision, causes)
        start = _linear_strengths(decision, (extension,), residuals, fitted, family)
        refit = fit_extended(problem, (extension,), family[0], start)
        after[name] = float(np.sum(refit.residuals**2))
    ranked = sorted(after, key=lambda name: after[name])
    if not ranked or after[ranked[0]] > DOMINANT_SHARE * before:
        return decision
    if len(ranked) > 1 and after[ranked[1]] < DOMINANT_RATIO * after[ranked[0]]:
        return decision
    return dataclasses.replace(decision, named=(ranked[0],))


def _audit(problem: DmaProblem) -> tuple[str, ...]:
    """What each fit says about itself."""
    remarks = []
    for fit in problem.fits:
        if not fit.converged:
            remarks.append(f"{fit.sweep.label}: {fit.status}.")
        elif fit.n_agreeing < 2:
            remarks.append(f"{fit.sweep.label}: only one of {fit.n_starts} starts reached the best fit.")
        remarks += [f"{fit.sweep.label}: {warning}" for warning in fit.warnings if fit.converged]
    return tuple(remarks)


def _free_forms(problem: DmaProblem) -> tuple[list[Alternative], list[Place]]:
    coordinates = problem.weights.shape[1]
    forms, places = dma_free_forms(
        problem.frequencies(),
        np.repeat(np.asarray(problem.conditions.temperature), coordinates),
        np.repeat(np.asarray(problem.conditions.sweep), coordinates),
        np.tile(np.arange(coordinates), problem.rows),
        tuple(sweep.label for sweep in problem.sweeps),
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
        detectable = [_detectable(a, v, size) for a, v in zip(shapes, visible, strict=True)]
        usable = [
            a
            for a, v, d in zip(shapes, visible, detectable, strict=True)
            if v >= LEAST_VISIBILITY and d <= MOST_IMPLAUSIBLE * cause.plausible
        ]
        seen += usable
        if usable:
            continue
        best = int(np.argmax(visible))
        if visible[best] < LEAST_VISIBILITY:
            why = f"the fitted constants imitate all but {100.0 * visible[best]:.2g} % of its effect"
        else:
            why = (
                f"it would have to be {min(detectable):.2g} {cause.unit} to be seen, "
                f"where {cause.plausible:.2g} {cause.unit} is plausible"
            )
        hidden.append(NotTestable(cause.name, why, cause.helps))
    return seen, tuple(hidden)


def _detectable(alternative: Alternative, visible: float, size: float) -> float:
    length = float(np.linalg.norm(alternative.directions)) * visible
    return DETECTABLE * size / max(length, 1e-300)


def _chosen(decision: Decision, causes: Sequence[DmaCause]) -> tuple[Extension, ...]:
    """What goes into the model: the best cause, or all of them if they act together."""
    names = decision.named if decision.together else decision.named[:1]
    return tuple(_extension(name, decision, causes) for name in names)


def _extension(name: str, decision: Decision, causes: Sequence[DmaCause]) -> Extension:
    """The cause of this name in its most probable shape."""
    cause = next(cause for cause in causes if cause.name == name)
    row = decision.omnibus.best(name)
    shape = decision.omnibus.alternatives[row].shape if row is not None else None
    return Extension(cause, float("nan") if shape is None else shape)


def _is_one_of(alternative: Alternative, extensions: Sequence[Extension]) -> bool:
    return any(
        extension.cause.name == alternative.name and (alternative.shape is None or alternative.shape == extension.shape)
        for extension in extensions
    )


def _linear_strengths(decision, extensions, residuals, fitted, family) -> Float[np.ndarray, " extension"]:
    """Strengths of extensions together in the linearised model."""
    if not extensions:
        return np.zeros(0)
    noise = family[decision.omnibus.noise]
    tested = decision.omnibus.alternatives
    columns = [a.directions for extension in extensions for a in tested if _is_one_of(a, (extension,))]
    white = noise.whiten(np.concatenate([*columns, fitted], axis=1))
    lengths = np.maximum(np.linalg.norm(white, axis=0), 1e-300)
    solution = np.linalg.lstsq(white / lengths, noise.whiten(residuals[:, None])[:, 0], rcond=1e-10)[0]
    return (solution / lengths)[: len(extensions)]


def _reports(decision, causes, seen, problem, residuals, fitted, family, size) -> tuple[CauseReport, ...]:
    """Every cause that the data can see, in rank order."""
    reports = []
    names = list(dict.fromkeys(alternative.name for alternative in seen))
    for name in decision.omnibus.ranked(names):
        extension = _extension(name, decision, causes)
        cause, row = extension.cause, decision.omnibus.best(name)
        alternative = decision.omnibus.alternatives[row]
        strength = _linear_strengths(decision, (extension,), residuals, fitted, family)
        statistic = float(decision.omnibus.statistics[row])
        error = abs(float(strength[0]) / statistic) if statistic else float("inf")
        estimate, interval, converged = float(strength[0]), _interval(float(strength[0]), error, cause), True
        if name in decision.candidates:
            refit = fit_extended(problem, (extension,), family[decision.omnibus.noise], strength)
            estimate, converged = float(refit.strengths[0]), refit.converged
            interval = (float(refit.intervals[0, 0]), float(refit.intervals[0, 1]))
        visible = float(visibility(alternative.directions, fitted)[0])
        reports.append(
            CauseReport(
                cause=cause,
                shape=alternative.shape,
                statistic=statistic,
                p_value=float(decision.omnibus.p_family[row]),
                p_alone=float(np.exp(decision.omnibus.log_p[row])),
                estimate=estimate,
                interval=interval,
                detectability=_detectable(alternative, visible, size),
                status=_status(name, decision),
                left=decision.candidates.get(name),
                converged=converged,
            )
        )
    return tuple(reports)


def _interval(estimate: float, error: float, cause: DmaCause) -> tuple[float, float]:
    lower, upper = estimate - 1.96 * error, estimate + 1.96 * error
    return (max(lower, 0.0), max(upper, 0.0)) if cause.sign > 0 else (lower, upper)


def _status(name: str, decision: Decision) -> str:
    if name in decision.named:
        return "confusable" if decision.verdict == "confusable" else "named"
    if name in decision.candidates:
        return "ruled out"
    return "not needed"
