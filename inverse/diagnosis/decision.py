r"""From statistics to a verdict, at stated error rates.

1. *Is anything wrong?* The smallest p-value over all causes and free forms, against the same in replicates of the
   residuals that hold noise alone. p-values are calibrated first, each alternative by what the replicates give it, then
   causes together and free forms together: noise of unknown kind makes p-values of large free forms small by chance,
   and untouched they would take the causes' power (measured: 85 instead of 92 of 100 effects of d' = 4.5 found). A free
   form has to be `FREE_FORM_HANDICAP` times as improbable as a cause. Replicates are in the noise that goes with the
   likeliest cause; where data are few, in all kinds of noise, each as often as it is likely with that cause, and
   p-values are multiplied by an `ALLOWANCE`.
2. *Which cause?* Every cause that could be the one is put into the model, and everything else is tested again: a cause
   after which nothing is left stays possible: a true one that is tried is left out with probability `SET_LEVEL`.
3. *Two causes?* Where one does not do, the likeliest causes of what it leaves that have `NEEDED` there are put in
   beside it, and everything else is tested once more. A pair counts only if each is so strong beside the other that it
   would be seen alone (`NEEDED`): two wrong causes take much of what a third leaves.
4. *No cause?* If a correction of no name is more probable than the causes, or something beside the one that fits best
   (`odds`), or every cause is ruled out, and no pair is much more probable than that and leaves the rest inconspicuous
   at `PAIR_LEVEL`, the verdict is `unexplained`, never the nearest name. Which causes stay possible is said then, too.
   A refit that did not converge explains nothing, but rules no cause out either.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from arfjax import InputError
from inverse.diagnosis.evidence import Evidence, evidence
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.odds import NO_ODDS, Odds, Weighed, odds, odds_of_pair, weighed
from inverse.diagnosis.projection import independent, unit_columns
from inverse.diagnosis.rule import MOST_OF_PAIR, SET_LEVEL, enough
from inverse.diagnosis.screening import LEAST_FREEDOM, Alternative, Screen

FREE_FORM_HANDICAP = 10.0
PAIR_LEVEL = 0.1
"""p-value of what is left below which a pair does not explain the data: many are tried, so that one that takes an
effect of no name is found more easily."""
NEEDED = 4.5
"""t that each cause of a pair must have beside the other."""
REPLICATES = 400
"""Of noise alone, at a level of 5 %; see `replicates_at`."""
_BEYOND = 20
"""Of them that are beyond a lower level, as at this one."""
_OF_FEW = 4
"""Times as many where data are few, which they take 0.5 s of: in 400 a p near what decides scatters by a third."""
_CONSIDERED = 6
"""Causes that are put into the model, best first."""
_FIRST, _SECOND = 3, 3
"""Causes of which pairs are made, and how many are put beside each."""
_WORTH_A_LOOK = 0.02
"""p-value of a cause alone above which it is not put into the model; of the likeliest the level, if that is more."""


def replicates_at(level: float, *, few: bool = False) -> int:
    """So many that not one or two of them decide; never fewer than `REPLICATES`, since other levels are fixed.

    Args:
        level: Of the test of everything.
        few: Whether data are few.
    """
    return max(REPLICATES, round(_BEYOND / level)) * (_OF_FEW if few else 1)


@dataclasses.dataclass(frozen=True)
class Refitted:
    """The model with one cause or two in it, refitted in full.

    Attributes:
        residuals: Measured less predicted.
        directions: Derivative of the prediction in everything that was fitted.
        misfit: What the fit made least; among causes, the lower the better.
        converged: Whether the fit did: one that did not explains nothing, whatever it leaves.
        others: The causes that were not put in, at this fit: far from the null model their directions are others.
    """

    residuals: Float[np.ndarray, " n"]
    directions: Float[np.ndarray, "n q"]
    misfit: float
    others: Sequence[Alternative]
    converged: bool = True


@dataclasses.dataclass(frozen=True)
class Decision:
    """What follows.

    Attributes:
        verdict: `adequate`, `named`, `confusable` or `unexplained`.
        omnibus: The test of everything at once.
        candidates: For each cause that was put into the model, the p-value of what is left; the best fit first.
        misfits: What each of these fits made least.
        explanations: What is named, best first: each one cause or two that leave nothing conspicuous.
        tests: For each cause that was put into the model, the test of what is left.
        last: The test of what the model that the verdict ends with leaves.
        odds: Of a correction of no name over the causes.
        best_fit: The cause whose refit converged and fits best; none if that is empty.
        unsettled: Causes that were put into the model, and whose refit did not converge.
    """

    verdict: str
    omnibus: Evidence
    candidates: dict[str, float]
    misfits: dict[str, float]
    explanations: tuple[tuple[str, ...], ...]
    tests: dict[str, Evidence]
    last: Evidence
    odds: Odds
    best_fit: str = ""
    unsettled: tuple[str, ...] = ()

    @property
    def named(self) -> tuple[str, ...]:
        """Causes that are part of every explanation."""
        everywhere = set.intersection(*map(set, self.explanations)) if self.explanations else set()
        return tuple(name for name in self._mentioned if name in everywhere)

    @property
    def confusable(self) -> tuple[str, ...]:
        """Causes that are part of some explanations and not of others, best first."""
        return tuple(name for name in self._mentioned if name not in self.named)

    @property
    def _mentioned(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(name for names in self.explanations for name in names))

    @property
    def possible(self) -> tuple[str, ...]:
        """Causes that what a settled refit leaves does not rule out, best first, whatever the verdict."""
        alone = (name for name, p in self.candidates.items() if p >= SET_LEVEL or name in self.unsettled)
        return tuple(dict.fromkeys([*self._mentioned, *alone]))

    def ranked(self, names: Sequence[str]) -> list[str]:
        """Names in order: those that were put into the model by how well it fits then, the others by their p-value."""
        return [*self.candidates, *(name for name in self.omnibus.ranked(names) if name not in self.candidates)]


def decide(
    residuals: Float[np.ndarray, " n"],
    fitted: Float[np.ndarray, "n p"],
    causes: Sequence[Alternative],
    free_forms: Sequence[Alternative],
    family: Sequence[Noise],
    rng: np.random.Generator,
    *,
    extend: Callable[[Sequence[Alternative], Noise], Refitted] | None = None,
    level: float = 0.05,
    replicates: int | None = None,
    few: bool = False,
    local_forms: Sequence[Alternative] = (),
) -> Decision:
    """Diagnose residuals of a fit that is linear about its optimum.

    Args:
        residuals: Measured less predicted.
        fitted: Derivative of the prediction in the fitted parameters.
        causes: Named causes that these data can see, one alternative for each shape.
        free_forms: Corrections of no name.
        family: Noise members, white first.
        rng: For replicates.
        extend: Refits the model with one cause or two in full, in noise of the given kind. Without it their directions
            join the fitted ones.
        level: Probability of finding something wrong where nothing is.
        replicates: Data sets of noise alone that the levels are calibrated on: if not said, see `replicates_at`.
        few: Whether data are so few that the likeliest kind of noise is often another one than theirs: replicates of
            the test of everything are in noise of all kinds then, each as often as it is likely, with the `ALLOWANCE`.
        local_forms: More corrections of no name, which are weighed against causes only.

    Raises:
        InputError: if a cause has the name of a free form.
    """
    names = list(dict.fromkeys(cause.name for cause in causes))
    without_cause = {free_form.name for free_form in [*free_forms, *local_forms]}
    if both := without_cause.intersection(names):
        raise InputError(f"the cause {min(both)} has the name of a correction of no name: give it another.")
    count = replicates_at(level, few=few) if replicates is None else replicates

    def test(left, moved, remaining: Sequence[Alternative], handicap: float, **how: bool) -> Evidence:
        screen = Screen(moved, remaining, family)
        free = np.array([a.name in without_cause for a in screen.alternatives], dtype=bool)
        return evidence(screen, left, rng, free, handicap, count, **how)

    def linearly(added: Sequence[Alternative], noise: Noise) -> Refitted:
        moved = np.concatenate([fitted, *(alternative.directions for alternative in added)], axis=1)
        white, basis = noise.whiten(residuals[:, None]), np.linalg.qr(noise.whiten(unit_columns(moved)))[0]
        left = white - basis @ (basis.T @ white)
        return Refitted(residuals, moved, float(np.sum(left**2)), causes)

    omnibus = test(residuals, fitted, [*causes, *free_forms], FREE_FORM_HANDICAP, averaged=few)
    if omnibus.p_value > level:
        return Decision("adequate", omnibus, {}, {}, (), {}, omnibus, NO_ODDS)

    ranked = omnibus.ranked(names)
    best = {name: row for name in ranked if (row := omnibus.best(name)) is not None}
    # One kind of noise for all, so that their misfits compare: the one that goes with the likeliest cause.
    noise = family[omnibus.noises[best[ranked[0]]]] if ranked else family[0]
    freedom = len(residuals) - independent(fitted).shape[1]

    def put_in(added: Sequence[Alternative]) -> _Tried:
        refitted = linearly(added, noise) if extend is None else extend(added, noise)
        inside = [alternative.name for alternative in added]
        visible = {(cause.name, cause.shape) for cause in causes if cause.name not in inside}
        others = [cause for cause in refitted.others if (cause.name, cause.shape) in visible]
        left = test(refitted.residuals, refitted.directions, [*others, *free_forms], 1.0, whole=few)
        # What leaves no data to judge it by explains nothing.
        judged = len(residuals) - independent(refitted.directions).shape[1] >= LEAST_FREEDOM
        return _Tried(refitted, left, others, refitted.converged and judged)

    def gained(name: str, tried: _Tried) -> float:
        """Nats by which a refit, the best shape in it, is likelier than the fit along the direction about the null."""
        if not tried.converged:
            return 0.0
        straight = linearly([omnibus.alternatives[best[name]]], noise).misfit
        return 0.5 * freedom * math.log(straight / tried.misfit) if 0.0 < tried.misfit < straight else 0.0

    # Where few are looked for, one of p = 0.04 alone can be what was found.
    at_most = {name: max(_WORTH_A_LOOK, level) if name == ranked[0] else _WORTH_A_LOOK for name in ranked}
    worth = [name for name in ranked if omnibus.log_p[best[name]] <= math.log(at_most[name])]
    alone = {name: put_in([omnibus.alternatives[best[name]]]) for name in worth[:_CONSIDERED]}
    alone = dict(sorted(alone.items(), key=lambda item: item[1].misfit))
    converged = [name for name, one in alone.items() if one.converged]
    best_fit = converged[0] if converged else ""

    def weigh(left, moved, remaining: Sequence[Alternative]) -> Weighed:
        return weighed(left, moved, remaining, [*free_forms, *local_forms], family)

    gains = {name: gained(name, one) for name, one in alone.items()}
    scales = _Scales(weigh(residuals, fitted, causes).gained(gains), alone, best_fit, weigh)
    found = Decision(
        verdict="unexplained",
        omnibus=omnibus,
        candidates={name: one.left.p_value for name, one in alone.items()},
        misfits={name: one.misfit for name, one in alone.items()},
        explanations=(),
        tests={name: one.left for name, one in alone.items()},
        last=omnibus,
        odds=scales.of_one(),
        best_fit=best_fit,
        unsettled=tuple(name for name in alone if name not in converged),
    )
    singles = _explanations({(name,): one for name, one in alone.items()}) if enough(found.odds) else {}
    pairs = {} if singles else _pairs(found, put_in, names, scales)
    return _concluded(found, singles or _explanations(pairs, PAIR_LEVEL))


@dataclasses.dataclass(frozen=True)
class _Tried:
    """A cause or two put into the model.

    Attributes:
        fit: With it.
        left: The test of what it leaves.
        others: Causes that were not put in.
        converged: Whether it did, and left data to judge it by.
    """

    fit: Refitted
    left: Evidence
    others: Sequence[Alternative]
    converged: bool

    @property
    def misfit(self) -> float:
        """What the fit made least."""
        return self.fit.misfit


class _Scales:
    """Causes weighed against corrections of no name: about the fit, and beside each cause that was put into it."""

    def __init__(
        self, null: Weighed, alone: Mapping[str, _Tried], best_fit: str, weigh: Callable[..., Weighed]
    ) -> None:
        self._null, self._alone, self._best_fit, self._weigh = null, alone, best_fit, weigh
        self._beside: dict[str, Weighed] = {}

    def of_one(self) -> Odds:
        """Of a correction of no name over one cause."""
        return odds(self._null, self._best_fit, self._with(self._best_fit) if self._best_fit else None)

    def of_pair(self, first: str, second: str) -> float:
        """Of a correction of no name over two; against all where nothing tells what the best fit leaves."""
        if not self._best_fit:
            return math.inf
        best, with_first = self._with(self._best_fit), self._with(first)
        return odds_of_pair(self._null, self._best_fit, best, first, with_first, second)

    def _with(self, name: str) -> Weighed:
        if name not in self._beside:
            one = self._alone[name]
            self._beside[name] = self._weigh(one.fit.residuals, one.fit.directions, one.others)
        return self._beside[name]


def _explanations(tried: dict[tuple[str, ...], _Tried], level: float = SET_LEVEL) -> dict[tuple[str, ...], Evidence]:
    """Fits that are not ruled out, best first, if one of them leaves nothing conspicuous at a level."""
    fits = {names: one for names, one in tried.items() if one.converged}
    if max((one.left.p_value for one in fits.values()), default=0.0) < level:
        return {}
    ordered = sorted(fits.items(), key=lambda item: item[1].misfit)
    return {names: one.left for names, one in ordered if one.left.p_value >= SET_LEVEL}


def _concluded(found: Decision, explanations: dict[tuple[str, ...], Evidence]) -> Decision:
    if not explanations:
        return found
    verdict = "named" if len(explanations) == 1 else "confusable"
    best = next(iter(explanations.values()))
    return dataclasses.replace(found, verdict=verdict, explanations=tuple(explanations), last=best)


def _pairs(
    found: Decision,
    put_in: Callable[[Sequence[Alternative]], _Tried],
    names: Sequence[str],
    scales: _Scales,
) -> dict[tuple[str, ...], _Tried]:
    """Pairs of which each cause is needed beside the other, put into the model."""
    tried: dict[tuple[str, ...], _Tried] = {}
    for first in list(found.misfits)[:_FIRST]:
        left = found.tests[first]
        for second in left.ranked(names)[:_SECOND]:
            row = left.best(second)
            pair = tuple(sorted((first, second)))
            if row is None or abs(left.statistics[row]) < NEEDED:
                continue
            other = found.tests.get(second)
            back = None if other is None else other.best(first)
            if pair in tried or (other is not None and back is not None and abs(other.statistics[back]) < NEEDED):
                continue
            start = found.omnibus.best(first)
            if start is not None and scales.of_pair(first, second) <= MOST_OF_PAIR:
                tried[pair] = put_in([found.omnibus.alternatives[start], left.alternatives[row]])
    return tried
