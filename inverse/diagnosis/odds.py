r"""Odds of a correction of no name over named causes.

Tests ask whether what a cause leaves could be noise. Where a wrong cause takes most of an effect it could, and the
effect as a whole is still more like something else. So both are weighed: how probable are these data if one of the
causes is there, how probable if none of them is and the model is wrong in some other way? Strengths, shapes and noise
are averaged over on either side, which makes a cause with many shapes, or a correction that bends a lot, pay for what
else it could have explained; a likelihood at its best would not (Kass & Raftery, 1995, Bayes factors, JASA 90, 773).

What else there could be nobody knows. It may be smooth along some coordinate, local, in one part of the data
(`corrections`); and it may be like a mixture of the effects that causes have, since it happens in the same physics. It
may take the place of a cause (`instead`), or the best-fitting cause takes a part of it and leaves the rest (`beside`).
"""

import collections
import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from inverse.diagnosis.noise import Noise
from inverse.diagnosis.projection import independent, project_out
from inverse.diagnosis.screening import Alternative, Screen

MIXTURE = "mixture of causes"
"""Name of the correction that is like one."""
_WHITE, _CORRELATED, _LOUDER = 0.95, 0.03, 0.02
"""What is believed of the noise: white, correlated between neighbours, or larger on one side of a step.

Noise that is correlated absorbs what a wrong cause leaves of a smooth effect, and whoever believes in it as much as in
white noise finds fewer. Curves, development sets, belief in white noise 0.7 -> 0.95 -> 1: of effects in no list of d' 9
`unexplained` 88.6 -> 90.9 -> 92.0 of 100, of causes taken out 82.4 -> 82.1 -> 83.7, and of true causes of d' 6 in noise
correlated by 0.6 11.8 -> 15.1 -> 44.3, three times louder above 60 degC 7.2 -> 9.0 -> 26.3, where 5 are in white."""
FEWEST_MIXED = 8
"""Causes of which there is a mixture: one of few is hardly more than each of them, or than two at once."""
_DISTINCT = 1e-2
"""Singular value of effects, over the largest, below which they have nothing more of their own."""


@dataclasses.dataclass(frozen=True)
class Weighed:
    """How probable data are, as logarithms that have a common factor.

    Attributes:
        causes: With each cause beside what was fitted.
        corrections: With each kind of correction of no name.
        nothing: With neither.
    """

    causes: dict[str, float]
    corrections: dict[str, float]
    nothing: float

    @property
    def any_cause(self) -> float:
        """With one of the causes, each believed in as much as every other."""
        return _log_sum([*self.causes.values()])

    @property
    def any_correction(self) -> float:
        """With a correction of one kind, each believed in as much as a cause."""
        return _log_sum([*self.corrections.values()])

    def gained(self, gains: Mapping[str, float]) -> "Weighed":
        """The same, if refits with causes are likelier by so many nats than their directions."""
        causes = {name: value + gains.get(name, 0.0) for name, value in self.causes.items()}
        return dataclasses.replace(self, causes=causes)


@dataclasses.dataclass(frozen=True)
class Odds:
    """Of a correction of no name over the causes, all of them together, in nats.

    Attributes:
        instead: Of one in their place.
        beside: Of one beside the cause that fits best; minus infinity where no refit converged.
        evidence: By how much causes, or a correction in their place, are more probable than noise alone.
    """

    instead: float
    beside: float
    evidence: float


NO_ODDS = Odds(-math.inf, -math.inf, 0.0)
"""Where there is nothing to explain."""


def weighed(
    residuals: Float[np.ndarray, " n"],
    fitted: Float[np.ndarray, "n p"],
    causes: Sequence[Alternative],
    corrections: Sequence[Alternative],
    family: Sequence[Noise],
) -> Weighed:
    """Weigh causes, corrections of no name and nothing at all against each other, beside what was fitted.

    Args:
        residuals: Of the fit.
        fitted: Derivative of the prediction in what was fitted, causes among it where some were put in.
        causes: That the data can see, one alternative for each shape.
        corrections: Of no name; what their names have before the first hyphen is their kind.
        family: Noise members, white first.
    """
    names = {cause.name for cause in causes}
    screen = Screen(fitted, [*causes, *corrections, *_mixture(causes, fitted)], believed(family))
    found, nothing = screen.log_evidence(residuals[:, None])
    of_causes, of_corrections = collections.defaultdict(list), collections.defaultdict(list)
    for one, value in zip(screen.alternatives, found[:, 0].tolist(), strict=True):
        if one.name in names:
            of_causes[one.name].append(value)
        else:
            of_corrections[one.name.split("-")[0]].append(value)
    return Weighed(_means(of_causes), _means(of_corrections), float(nothing[0]))


def odds(null: Weighed, name: str, best: Weighed | None) -> Odds:
    """Of a correction of no name over the causes.

    Args:
        null: What there is to explain, weighed.
        name: Of the cause that fits best.
        best: What that one leaves, weighed; none if no refit converged.
    """
    evidence = max(null.any_cause, null.any_correction) - null.nothing
    instead = null.any_correction - null.any_cause if null.causes else math.inf
    if best is None or name not in null.causes:
        return Odds(instead, -math.inf, evidence)
    return Odds(instead, _beside(null, name, best) - null.any_cause, evidence)


def odds_of_pair(null: Weighed, name: str, best: Weighed, first: str, with_first: Weighed, second: str) -> float:
    """Of a correction of no name, instead of all causes or beside the one that fits best, over two causes, in nats.

    Args:
        null: What there is to explain, weighed.
        name: Of the cause that fits best.
        best: What that one leaves, weighed.
        first: One of the two.
        with_first: What that one leaves, weighed.
        second: The other one.
    """
    pair = null.causes[first] + with_first.causes[second] - with_first.nothing
    return _log_sum([null.any_correction, _beside(null, name, best)]) - pair


def _beside(null: Weighed, name: str, best: Weighed) -> float:
    return null.causes[name] + best.any_correction - best.nothing


def believed(family: Sequence[Noise]) -> tuple[Noise, ...]:
    """Members of one kind, white, correlated or stepping, each with what is believed of it.

    Args:
        family: Noise members; those that are correlated and step are left out.
    """
    kept = [noise for noise in family if noise.correlation == 0.0 or noise.step == 1.0]
    share = {(False, False): _WHITE, (True, False): _CORRELATED, (False, True): _LOUDER}
    kinds = [(noise.correlation != 0.0, noise.step != 1.0) for noise in kept]
    often = collections.Counter(kinds)
    return tuple(
        dataclasses.replace(noise, log_prior=math.log(share[kind] / often[kind]))
        for noise, kind in zip(kept, kinds, strict=True)
    )


def _mixture(causes: Sequence[Alternative], fitted: Float[np.ndarray, "n p"]) -> list[Alternative]:
    """Whatever is like a mixture of the effects of all causes, each as strong as every other."""
    basis, effects = independent(fitted), collections.defaultdict(list)
    for cause in causes:
        (left,) = project_out(cause.directions, basis).T
        length = float(np.linalg.norm(left))
        if length > _DISTINCT * float(np.linalg.norm(cause.directions)):
            effects[cause.name].append(left / length)
    if len(effects) < FEWEST_MIXED:
        return []
    columns = np.column_stack([one / math.sqrt(len(shapes)) for shapes in effects.values() for one in shapes])
    axes, singular, _ = np.linalg.svd(columns, full_matrices=False)
    kept = singular > _DISTINCT * singular[0]
    return [Alternative(MIXTURE, axes[:, kept] * singular[kept])]


def _means(kinds: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Logarithm of the mean over the alternatives of each kind: nobody knows which of them it would be."""
    return {kind: _log_sum(values) - math.log(len(values)) for kind, values in kinds.items()}


def _log_sum(values: Sequence[float]) -> float:
    """Logarithm of the sum of exponentials; of none minus infinity."""
    return float(np.logaddexp.reduce(values, initial=-math.inf))
