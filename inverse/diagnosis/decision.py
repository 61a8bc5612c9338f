r"""From statistics to a verdict, at stated error rates.

1. *Is anything wrong?* The smallest p-value over all causes and free forms, against the same in replicates of the
   residuals that hold noise alone. p-values are calibrated first, each alternative by what the replicates give it, then
   causes together and free forms together: noise of unknown kind makes p-values of large free forms small by chance,
   and untouched they would take the causes' power (measured: 85 instead of 92 of 100 effects of d' = 4.5 found). A free
   form has to be `FREE_FORM_HANDICAP` times as improbable as a cause. Replicates are in the noise that goes with the
   likeliest cause; where data are few, in all kinds of noise, each as often as it is likely with that cause.
2. *Which cause?* Every cause that could be the one is put into the model, and everything else is tested again: a cause
   after which nothing is left stays possible: a true one that is tried is left out with probability `SET_LEVEL`.
3. *Two causes?* Where one does not do, the likeliest causes of what it leaves that have `NEEDED` there are put in
   beside it, and everything else is tested once more. A pair counts only if each is so strong beside the other that it
   would be seen alone (`NEEDED`): two wrong causes take much of what a third leaves.
4. *No cause?* If not even the best leaves the rest inconspicuous at `UNEXPLAINED_LEVEL` (a pair: at `PAIR_LEVEL`),
   the verdict is `unexplained`, never the nearest name. Which causes stay possible is said then, too: with a true one
   that happens in the share of data sets that lies between the two levels. A refit that did not converge explains
   nothing, but does not rule its cause out either.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from inverse.diagnosis.noise import Noise
from inverse.diagnosis.screening import Alternative, Screen, Statistics, unit_columns

FREE_FORM_HANDICAP = 10.0
SET_LEVEL = 0.01
UNEXPLAINED_LEVEL = 0.06
PAIR_LEVEL = 0.1
"""The same for pairs: many are tried, so that one that takes an effect of no name is found more easily."""
NEEDED = 4.5
"""t that each cause of a pair must have beside the other."""
REPLICATES = 400
_CONSIDERED = 6
"""Causes that are put into the model, best first."""
_FIRST, _SECOND = 3, 3
"""Causes of which pairs are made, and how many are put beside each."""
_WORTH_A_LOOK = 0.02
"""p-value of a cause alone above which it is not put into the model."""
_BATCH = 100
"""Replicates drawn at a time: none of so many is as improbable only if the p-value is below 0.01."""
_CLEAR, _CLEARLY_BELOW = 0.25, 5.0
"""Share of a batch above which a p-value is clearly above `UNEXPLAINED_LEVEL`; and nats between the data and the
most improbable of a batch beyond which it is clearly below `SET_LEVEL`."""
_TAIL = 0.05
"""Quantile at which p-values of replicates are made equal."""


@dataclasses.dataclass(frozen=True)
class Evidence:
    """What a test of everything at once says.

    Attributes:
        p_value: That noise alone gives something as improbable.
        statistic: Minus the logarithm of the smallest calibrated p-value, over what noise alone gives in one of twenty.
        alternatives: What was tested.
        log_p: Logarithm of the p-value of each alternative alone.
        p_family: The same for the whole family: that noise alone gives any alternative as improbable a value.
        statistics: t of each cause, and twice the gain of the log-likelihood of each free form of several directions.
        noises: The noise member that each alternative goes with.
        null_noise: The noise member without any alternative.
        least_p: The least p-value that as many replicates can show.
    """

    p_value: float
    statistic: float
    alternatives: tuple[Alternative, ...]
    log_p: Float[np.ndarray, " alternative"]
    p_family: Float[np.ndarray, " alternative"]
    statistics: Float[np.ndarray, " alternative"]
    noises: Int[np.ndarray, " alternative"]
    null_noise: int
    least_p: float

    def best(self, name: str) -> int | None:
        """Index of the most probable shape of a cause."""
        rows = [i for i, alternative in enumerate(self.alternatives) if alternative.name == name]
        return min(rows, key=lambda row: self.log_p[row]) if rows else None

    def ranked(self, names: Sequence[str]) -> list[str]:
        """Names by their most probable shape."""
        found = [(self.log_p[row], name) for name in names if (row := self.best(name)) is not None]
        return [name for _, name in sorted(found)]


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
    """

    verdict: str
    omnibus: Evidence
    candidates: dict[str, float]
    misfits: dict[str, float]
    explanations: tuple[tuple[str, ...], ...]
    tests: dict[str, Evidence]
    last: Evidence

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
        """Causes whose remainder does not rule them out, best first, whatever the verdict."""
        alone = (name for name, p in self.candidates.items() if p >= SET_LEVEL)
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
    replicates: int = REPLICATES,
    averaged: bool = False,
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
        replicates: Data sets of noise alone that the levels are calibrated on.
        averaged: Whether the replicates of the test of everything are in noise of all kinds, each as often as it is
            likely: where data are so few that the likeliest is often another one than theirs.
    """
    names = list(dict.fromkeys(cause.name for cause in causes))

    def test(left, moved, remaining: Sequence[Alternative], handicap: float, **how: bool) -> Evidence:
        screen = Screen(moved, remaining, family)
        free = np.array([a.name not in names for a in screen.alternatives], dtype=bool)
        return evidence(screen, left, rng, free, handicap, replicates, **how)

    def linearly(added: Sequence[Alternative], noise: Noise) -> Refitted:
        moved = np.concatenate([fitted, *(alternative.directions for alternative in added)], axis=1)
        white, basis = noise.whiten(residuals[:, None]), np.linalg.qr(noise.whiten(unit_columns(moved)))[0]
        left = white - basis @ (basis.T @ white)
        return Refitted(residuals, moved, float(np.sum(left**2)), causes)

    omnibus = test(residuals, fitted, [*causes, *free_forms], FREE_FORM_HANDICAP, averaged=averaged)
    if omnibus.p_value > level:
        return Decision("adequate", omnibus, {}, {}, (), {}, omnibus)

    ranked = omnibus.ranked(names)
    # One kind of noise for all, so that their misfits compare: the one that goes with the likeliest cause.
    noise = family[omnibus.noises[omnibus.best(ranked[0]) or 0]] if ranked else family[0]

    def put_in(added: Sequence[Alternative]) -> _Tried:
        refitted = (extend or linearly)(added, noise)
        inside = [alternative.name for alternative in added]
        visible = {(cause.name, cause.shape) for cause in causes if cause.name not in inside}
        others = [cause for cause in refitted.others if (cause.name, cause.shape) in visible]
        left = test(refitted.residuals, refitted.directions, [*others, *free_forms], 1.0, whole=False)
        return _Tried(refitted.misfit, left, refitted.converged)

    alone: dict[str, _Tried] = {}
    for name in ranked[:_CONSIDERED]:
        row = omnibus.best(name)
        if row is None or omnibus.log_p[row] > math.log(_WORTH_A_LOOK):
            break
        alone[name] = put_in([omnibus.alternatives[row]])
    alone = dict(sorted(alone.items(), key=lambda item: item[1].misfit))
    found = Decision(
        verdict="unexplained",
        omnibus=omnibus,
        candidates={name: one.left.p_value for name, one in alone.items()},
        misfits={name: one.misfit for name, one in alone.items()},
        explanations=(),
        tests={name: one.left for name, one in alone.items()},
        last=omnibus,
    )
    singles = _explanations({(name,): one for name, one in alone.items()}, UNEXPLAINED_LEVEL)
    return _concluded(found, singles or _explanations(_pairs(found, put_in, names), PAIR_LEVEL))


@dataclasses.dataclass(frozen=True)
class _Tried:
    """A cause or two put into the model: what the fit made least, the test of what it leaves, whether it converged."""

    misfit: float
    left: Evidence
    converged: bool


def _explanations(tried: dict[tuple[str, ...], _Tried], level: float) -> dict[tuple[str, ...], Evidence]:
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
    found: Decision, put_in: Callable[[Sequence[Alternative]], _Tried], names: Sequence[str]
) -> dict[tuple[str, ...], _Tried]:
    """Pairs of which each cause is needed beside the other, put into the model."""
    tried: dict[tuple[str, ...], _Tried] = {}
    for first in list(found.misfits)[:_FIRST]:
        left = found.tests[first]
        for second in left.ranked(names)[:_SECOND]:
            row = left.best(second)
            pair = tuple(sorted((first, second)))
            if row is None or abs(left.statistics[row]) < NEEDED:
                break
            other = found.tests.get(second)
            back = None if other is None else other.best(first)
            if pair in tried or (other is not None and back is not None and abs(other.statistics[back]) < NEEDED):
                continue
            start = found.omnibus.best(first)
            if start is not None:
                tried[pair] = put_in([found.omnibus.alternatives[start], left.alternatives[row]])
    return tried


def evidence(
    screen: Screen,
    residuals: Float[np.ndarray, " n"],
    rng: np.random.Generator,
    free: Bool[np.ndarray, " alternative"],
    handicap: float,
    replicates: int,
    *,
    averaged: bool = False,
    whole: bool = True,
) -> Evidence:
    """Test everything at once, against replicates of noise alone.

    Args:
        screen: With all alternatives.
        residuals: Of the fit.
        rng: For replicates.
        free: Which alternatives are free forms.
        handicap: How many times as improbable as a cause these have to be.
        replicates: How many.
        averaged: Whether these are in noise of all kinds, each as often as it is likely, or in the likeliest.
        whole: If false, no more replicates are drawn once the p-value is clear: far above every level, or below.
    """
    found = screen.statistics(residuals[:, None])
    weights, log_p = _noise_of_replicates(screen, found, residuals, free, averaged=averaged), found.log_p
    calibrated = smallest = np.zeros((0, 0))
    while log_p.shape[1] <= replicates:
        count = replicates if whole else min(_BATCH, replicates + 1 - log_p.shape[1])
        drawn = screen.replicate(residuals, weights, count, rng)
        log_p = np.concatenate([log_p, screen.statistics(drawn).log_p], axis=1)
        calibrated = _calibrated(log_p, free, handicap)
        smallest = np.min(calibrated, axis=0)
        if np.mean(smallest[1:] <= smallest[0]) > _CLEAR or smallest[0] < np.min(smallest[1:]) - _CLEARLY_BELOW:
            break
    p_family = np.mean(smallest[None, :] <= calibrated[:, :1], axis=1)
    p_family = np.maximum(p_family, 1.0 / len(smallest))
    best = int(np.argmin(calibrated[:, 0]))
    return Evidence(
        p_value=float(p_family[best]),
        statistic=float(-smallest[0]),
        alternatives=screen.alternatives,
        log_p=found.log_p[:, 0],
        p_family=p_family,
        statistics=found.statistic[:, 0],
        noises=found.noise[:, 0],
        null_noise=int(found.null_noise[0]),
        least_p=1.0 / len(smallest),
    )


def _noise_of_replicates(
    screen: Screen,
    found: Statistics,
    residuals: Float[np.ndarray, " n"],
    free: Bool[np.ndarray, " alternative"],
    *,
    averaged: bool,
) -> Float[np.ndarray, " member"]:
    """Share of the replicates in each kind of noise, judged with the likeliest cause in the model, if there is one.

    Without the effect in the model noise has to explain it, and a smooth one looks like noise that is correlated, in
    replicates of which large statistics are common: 87.5 of 100 effects of d' 4.5 were found so, 91.0 this way, with as
    many false alarms in noise of every kind (144 and 600 sets for development). With a free form in the model it is the
    other way round: many terms absorb correlated noise, and on replicates of white noise nothing is ever so large.

    One kind alone is often the wrong one where data are few. Development sets of 57 readings, likeliest -> averaged: in
    noise correlated by 0.3 false alarms 8.3 -> 6.2 of 100 (480 sets); effects of d' 4.5 found 92.6 -> 91.6 (1020 sets).
    A dynamic mechanical analysis has more to lose: 8.1 -> 5.4 and 92.5 -> 89.8 (186 sets each). What a cause leaves is
    judged in the likeliest: averaged, 33 instead of 44 of 100 causes taken out were unexplained (85 sets).
    """
    cause = None if np.all(free) else int(np.argmin(np.where(free, np.inf, found.log_p[:, 0])))
    if averaged:
        return screen.noise_weights(residuals, cause)
    member = found.null_noise[0] if cause is None else found.noise[cause, 0]
    return (np.arange(len(screen.family)) == member).astype(float)


def _calibrated(
    log_p: Float[np.ndarray, "alternative batch"], free: Bool[np.ndarray, " alternative"], handicap: float
) -> Float[np.ndarray, "alternative batch"]:
    """Logarithms of p-values over what noise alone gives each alternative, and each kind, in one of twenty.

    The first column, which is the data, counts as one of the batch: where nothing is hidden all are alike.
    """
    calibrated = log_p - np.quantile(log_p, _TAIL, axis=1, keepdims=True)
    for kind, penalty in ((~free, 0.0), (free, math.log(handicap))):
        if np.any(kind):
            calibrated[kind] += penalty - np.quantile(np.min(calibrated[kind], axis=0), _TAIL)
    return calibrated
