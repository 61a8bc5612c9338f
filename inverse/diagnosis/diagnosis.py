"""From an examined data set to the answer, whatever was measured."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from inverse.diagnosis.cause import Cause, Extension
from inverse.diagnosis.constants import FittedConstant
from inverse.diagnosis.decision import Decision
from inverse.diagnosis.examination import DETECTABLE, Examined, FullFit, NotTestable
from inverse.diagnosis.gain import Gain
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.noise_gate import Coordinates, NoiseGate, Repeats, noise_gate
from inverse.diagnosis.regression import Regression
from inverse.diagnosis.screening import Screen
from inverse.diagnosis.where import Absorbed, Axis, Whiteness, absorbed_by_places, whiteness

VERDICTS = ("adequate", "named", "confusable", "unexplained", "noise-model", "fit-failure")
DOMINANT_SHARE, DOMINANT_RATIO = 0.25, 2.0
"""A cause is named although something is left if it leaves at most this part of the sum of squares, and the next best
cause leaves at least this many times as much."""


@runtime_checkable
class Account(Protocol):
    """What a report has to know of the data and of the model behind them."""

    @property
    def model(self) -> str:
        """Name of the model that was examined."""
        ...

    @property
    def sentence(self) -> str:
        """The model and the data, in half a sentence."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed."""
        ...

    @property
    def stated_deviations(self) -> bool:
        """Whether the data give standard deviations."""
        ...

    def facts(self, with_causes: Mapping[str, Any]) -> list[str]:
        """What one looks at first, as measured and as the model has it, without causes and with each of some."""
        ...

    def links(self) -> tuple[Absorbed, ...]:
        """What a correction of no name in each link of the model takes of the misfit of the fit without causes."""
        ...

    def describe(self, place: Absorbed) -> str:
        """Where a correction of no name is largest, its sign and its size."""
        ...

    def constants(self, extended: Any) -> list[FittedConstant]:
        """The fitted constants without and with what was put into the model."""
        ...


@dataclasses.dataclass(frozen=True)
class CauseReport:
    """What is said about one cause that these data can see.

    Attributes:
        cause: Which.
        shape: Value of its second parameter that fits best, or None.
        statistic: t of its strength.
        p_value: That noise alone gives any cause or free form as improbable a value; of curves with the `ALLOWANCE`.
        p_alone: p-value of this cause by itself; of curves, which are looked along with either sign, of the likelier
            sign.
        estimate: Strength, refitted in full where it was put into the model, else from the linearisation, in the
            likeliest noise without any cause: where t says that nothing is there, the interval holds 0.
        interval: At 95 %.
        detectability: Strength of d' = 4.5 in noise as the verdict's model leaves it, found in 96 of 100 data sets if
            noise and model were known.
        status: `named`, `confusable`, `possible` (what it leaves does not rule it out, but it is no
            explanation by itself, or the refit did not converge), `ruled out` (what it leaves is conspicuous), or
            `not needed`.
        left: p-value of what the model with this cause leaves, where it was put in.
        converged: Whether the refit did; True where there was none.
        refit: That, with a second cause in it where two are named together; None where there was none.
    """

    cause: Cause
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
    refit: FullFit | None


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The answer.

    Attributes:
        verdict: One of `VERDICTS`.
        level: Probability of finding something wrong where nothing is.
        account: Of data and model, for the report.
        problem: The data and the model: `DmaProblem` or `HmiDiagnosisProblem`.
        residuals: Of the fit without extensions: measured less predicted, weighted, readings before beliefs.
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
    account: Account
    problem: Any
    residuals: Float[np.ndarray, " n"]
    decision: Decision | None
    causes: tuple[CauseReport, ...]
    not_testable: tuple[NotTestable, ...]
    noise: NoiseGate | None
    residuals_whiteness: tuple[Whiteness, ...]
    places: tuple[Absorbed, ...]
    extended: FullFit | None
    gain: Gain | None
    audit: tuple[str, ...]
    seed: int

    @property
    def named(self) -> tuple[str, ...]:
        """Causes that are named: one, or two at once; empty where the data cannot tell them from others.

        One may be named although the verdict is `unexplained`: it explains by far the most, and not all. One may be
        named although the verdict is `confusable`: others are so only beside it.
        """
        return self.decision.named if self.decision is not None else ()

    @property
    def confusable(self) -> tuple[tuple[str, ...], ...]:
        """Sets of causes that these data cannot tell apart."""
        return (self.decision.confusable,) if self.decision is not None and self.decision.confusable else ()

    @property
    def in_question(self) -> dict[str, FullFit]:
        """Refits with what is not ruled out, by the names of the causes in them, in rank order."""
        kept = [one for one in self.causes if one.status in ("named", "confusable", "possible") and one.converged]
        refits = [one.refit for one in kept if one.refit is not None]
        return {" and ".join(extension.cause.name for extension in refit.extensions): refit for refit in refits}


def failed(account: Account, problem: Any, residuals, audit: Sequence[str], *, level: float, seed: int) -> Diagnosis:
    """The answer where the fit itself failed."""
    return Diagnosis(
        "fit-failure", level, account, problem, residuals, None, (), (), None, (), (), None, None, tuple(audit), seed
    )


def conclude(
    examined: Examined,
    account: Account,
    problem: Any,
    rng: np.random.Generator,
    *,
    audit: Sequence[str],
    axes: Sequence[Axis],
    repeats: Repeats | None,
    gain: Callable[[FullFit, Noise], Gain | None] | None,
    level: float,
    seed: int,
    replicates: int,
    coordinates: Coordinates | None = None,
    followed: int | None = None,
    on_step: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Refit what was found, measure its gain, and look at noise and remainder.

    Args:
        examined: The data and what the tests say.
        account: Of data and model.
        problem: Of these.
        rng: For replicates.
        audit: What the fit says against its numbers.
        axes: Along which residuals are tested for correlation.
        repeats: Scatter of repeated readings, if there are any.
        gain: Measures what an extension gains on data left out.
        level: Of the omnibus test.
        seed: Of every random number, for the record.
        replicates: Of noise alone.
        coordinates: Of the residuals, where readings have several.
        followed: How many of the causes that stay possible, those that fit best, have the ends of their intervals
            searched for beside what was found; all, if not said.
        on_step: Told what is being done.
    """
    decision = _with_dominant(examined)
    verdict, extended, worth = decision.verdict, None, None
    added = _chosen(examined, decision)
    noise = examined.family[decision.last.null_noise]
    if added:
        on_step("refitting with " + " and ".join(e.cause.name for e in added))
        extended = examined.fit(added, noise, examined.linear_strengths(added), True)
        if gain is not None:
            on_step("measuring the gain on data left out")
            worth = gain(extended, noise)
    directions, left = examined.fitted, examined.residuals
    if extended is not None:
        directions, left = extended.directions, extended.residuals
    on_step("refitting what else is possible")
    spread = Regression(left, directions, noise).size
    settled = [n for n in decision.candidates if n in decision.possible and n not in decision.unsettled]
    sought = settled[:followed]
    alone = Regression(examined.residuals, examined.fitted, noise)
    reports = _reports(examined, decision, extended, alone, spread, sought)
    gate = noise_gate(
        Screen(directions, (), examined.family), left, rng,
        stated=account.stated_deviations, repeats=repeats, coordinates=coordinates, replicates=replicates,
    )  # fmt: skip
    if verdict == "adequate" and not gate.as_thought:
        verdict = "noise-model"
    return Diagnosis(
        verdict=verdict,
        level=level,
        account=account,
        problem=problem,
        residuals=examined.residuals,
        decision=decision,
        causes=reports,
        not_testable=examined.not_testable,
        noise=gate,
        residuals_whiteness=whiteness(axes, examined.residuals, examined.fitted, rng),
        places=absorbed_by_places(decision.last, examined.places),
        extended=extended,
        gain=worth,
        audit=(*audit, *_of_curvature(decision, sought, added)),
        seed=seed,
    )


def _of_curvature(decision: Decision, sought: Sequence[str], added: Sequence[Extension]) -> list[str]:
    """That some intervals are what the curvature of a fit says."""
    inside = {extension.cause.name for extension in added}
    looked_at = (name for name in decision.candidates if name in decision.possible)
    others = [name for name in looked_at if name not in sought and name not in inside]
    if not others:
        return []
    return [
        f"Intervals of {', '.join(others)} are what the curvature at their fits says; the ends of those of the causes "
        "that fit best were searched for."
    ]


def _with_dominant(examined: Examined) -> Decision:
    """Name what explains by far the most where no cause explains all.

    Only effects far above the noise come here: near it, a cause cannot take three quarters of the residuals away.
    """
    decision = examined.decision
    if decision.verdict != "unexplained":
        return decision
    before, after = float(np.sum(examined.residuals**2)), {}
    for name in decision.candidates:
        extension = examined.extension(name)
        start = examined.linear_strengths((extension,))
        refit = examined.fit((extension,), examined.family[0], start, False)
        if refit.converged:
            after[name] = float(np.sum(refit.residuals**2))
    ranked = sorted(after, key=lambda name: after[name])
    if not ranked or after[ranked[0]] > DOMINANT_SHARE * before:
        return decision
    if len(ranked) > 1 and after[ranked[1]] < DOMINANT_RATIO * after[ranked[0]]:
        return decision
    best = ranked[0]
    return dataclasses.replace(decision, explanations=((best,),), last=decision.tests[best])


def _chosen(examined: Examined, decision: Decision) -> tuple[Extension, ...]:
    """What goes into the model: the best explanation."""
    return tuple(examined.extension(name) for name in (decision.explanations or ((),))[0])


def _reports(
    examined: Examined,
    decision: Decision,
    extended: FullFit | None,
    ended: Regression,
    spread: float,
    sought: Sequence[str],
) -> tuple[CauseReport, ...]:
    """Every cause that the data can see, in rank order.

    Args:
        examined: The data.
        decision: What follows.
        extended: The refit with what was found.
        ended: The fit without causes in the noise that the verdict ends with.
        spread: Standard deviation of the residuals that the verdict's model leaves, in that noise.
        sought: Causes whose intervals' ends are searched for.
    """
    names = list(dict.fromkeys(alternative.name for alternative in examined.seen))
    return tuple(
        _report(
            examined,
            decision,
            extended,
            name,
            DETECTABLE * spread / ended.length(examined.effect(name).directions[:, 0]),
            name in sought,
        )
        for name in decision.ranked(names)
    )


def _report(
    examined: Examined, decision: Decision, extended: FullFit | None, name: str, detectability: float, is_sought: bool
) -> CauseReport:
    extension, row = examined.extension(name), examined.row(name)
    tested = examined.alternative(name)
    # In the noise that its t is of.
    alone = Regression(examined.residuals, examined.fitted, examined.family[decision.omnibus.noises[row]])
    estimate, interval = alone.strength(tested.directions[:, 0])
    estimate = max(estimate, 0.0) if tested.sign > 0 else min(estimate, 0.0) if tested.sign < 0 else estimate
    # Where a strength comes out on the side that was not tested, none is the best that there can be.
    reach = 0.5 * (interval[1] - interval[0])
    interval = np.clip([estimate - reach, estimate + reach], *extension.cause.possible).tolist()
    shape, converged = tested.shape, True
    inside = [one.cause.name for one in extended.extensions] if extended is not None else []
    refit, which = (extended, inside.index(name)) if name in inside else (None, 0)
    if refit is None and name in decision.candidates:
        noise = examined.family[decision.tests[name].null_noise]
        refit = examined.fit((extension,), noise, examined.linear_strengths((extension,)), is_sought)
    if refit is not None:
        estimate, converged = float(refit.strengths[which]), refit.converged
        interval = refit.intervals[which].tolist()
        shape = None if shape is None else float(refit.extensions[which].shape)
    return CauseReport(
        cause=extension.cause,
        shape=shape,
        statistic=float(decision.omnibus.statistics[row]),
        p_value=float(decision.omnibus.p_family[row]),
        p_alone=float(np.exp(decision.omnibus.log_p[row])),
        estimate=estimate,
        interval=(interval[0], interval[1]),
        detectability=detectability,
        status=_status(name, decision),
        left=decision.candidates.get(name),
        converged=converged,
        refit=refit,
    )


def _status(name: str, decision: Decision) -> str:
    if name in decision.named:
        return "named"
    if name in decision.confusable:
        return "confusable"
    if name in decision.possible:
        return "possible"
    if name in decision.candidates:
        return "ruled out"
    return "not needed"
