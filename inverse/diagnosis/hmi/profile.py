"""Intervals of strengths by profile likelihood: effects of causes bend within their intervals.

Most of all where a lesion begins and the displacement turns within a kelvin: the curvature at the fit knows nothing of
what is farther away, and a correction of the fast simulation that was taken at the fit knows little. (Conduction four
times that of liver, d' 4.5, was given an interval of 0.9 to 1.9 by one, where the truth was 3.2.) So ends are
corrected to the full simulation where they come out, as fits are.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float
from scipy import stats

from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.refit import INTERVAL_LEVEL, SETTLED, HmiFit, fit_hmi, fit_in_full, moved_by
from inverse.diagnosis.noise import Noise

_MOST_TRIALS = 6
_MOST_CORRECTIONS = 2
_CLOSE = 0.05
"""Relative distance from the bound, in standard deviations, at which the search for an end stops."""
_STRIDE = 3.0
"""How many times as far, or as near, the next trial may be at most."""
_WORTH_A_FIT = 0.25
"""How much lower than the fit a trial has to be, in squared standard deviations, for the fit to begin anew there."""


def profiled(fit: HmiFit, noise: Noise, size: float) -> HmiFit:
    """The fit with intervals at whose ends the likelihood, all else fitted anew, has fallen to the bound.

    Accuracy: the distance of each end from the estimate is within 5 % of where the bound is met, if six trials find it,
    by a simulation that agrees there with the full one within `SETTLED`, if two corrections make it so; by the fast one
    alone for a fit of that. Where a simulation, or `HmiCause.largest`, ends before, the end is there.

    A trial that is better than the fit shows that this is a local one; it begins anew there, once.

    Args:
        fit: Converged; others come back as they are.
        noise: That it was fitted in.
        size: Of the noise, as for `fit_hmi`.
    """
    if not fit.converged:
        return fit
    found, lowest = _ends(fit, noise, size)
    better = None if lowest is None else _anew(fit, lowest, noise, size)
    return found if better is None else _ends(better, noise, size)[0]


def _ends(fit: HmiFit, noise: Noise, size: float) -> tuple[HmiFit, HmiFit | None]:
    """The fit with its intervals, and the best trial on the way to their ends."""
    searches = [
        _End(fit, which, direction, noise, size) for which in range(len(fit.extensions)) for direction in (-1.0, 1.0)
    ]
    ends = np.array([search.found() for search in searches]).reshape(-1, 2)
    trials = [trial for search in searches for trial in search.tried]
    return dataclasses.replace(fit, intervals=ends), min(trials, key=lambda one: one.misfit, default=None)


def _anew(fit: HmiFit, trial: HmiFit, noise: Noise, size: float) -> HmiFit | None:
    """The fit from where a trial is better; None if that leads nowhere."""
    if fit.misfit - trial.misfit < _WORTH_A_FIT * fit.misfit / fit.freedom:
        return None
    again = fit_hmi if fit.problem.correction is None else fit_in_full
    better = again(
        trial.problem, trial.extensions, noise, size=size, start=trial.unknowns, strengths=trial.strengths
    )  # fmt: skip
    return better if better.converged and better.misfit < fit.misfit else None


@dataclasses.dataclass(frozen=True)
class _Trial:
    """All else fitted with the strength a distance from its estimate, which is risen of the way to the bound."""

    step: float
    risen: float
    fit: HmiFit


class _End:
    """The search for one end: which strength, and whether below its estimate (-1) or above (1)."""

    def __init__(self, fit: HmiFit, which: int, direction: float, noise: Noise, size: float) -> None:
        self.fit, self.which, self.direction, self.noise, self.size = fit, which, direction, noise, size
        self.best = float(fit.strengths[which])
        reach = float(stats.t.ppf(0.5 + 0.5 * INTERVAL_LEVEL, fit.freedom))
        self.bound = math.sqrt(fit.misfit / fit.freedom) * reach
        self.limit = self._limit()
        self.start = fit.unknowns
        self.tried: list[HmiFit] = []

    def found(self) -> float:
        """The strength there."""
        problem, half = (
            self.fit.problem,
            abs(float(self.fit.intervals[self.which, int(self.direction > 0)]) - self.best),
        )
        end = self._searched(problem, min(half or self.limit, self.limit))
        for _ in range(_MOST_CORRECTIONS if problem.correction is not None else 0):
            if end is None or float(np.linalg.norm(problem.left(end.fit.unknowns))) <= SETTLED * self.size:
                break
            near = problem.corrected_at(end.fit.unknowns, moved_by(problem, self.fit.extensions))
            if near.correction is None or not near.correction.is_finite:
                break
            self.start = end.fit.unknowns
            problem, end = near, self._searched(near, end.step) or end
        return self.best if end is None else self.best + self.direction * end.step

    def _limit(self) -> float:
        """How far the strength may go."""
        cause = self.fit.extensions[self.which].cause
        lowest = 0.0 if cause.sign > 0 else -cause.largest
        return max(self.best - lowest if self.direction < 0.0 else cause.largest - self.best, 0.0)

    def _searched(self, problem: HmiDiagnosisProblem, step: float) -> _Trial | None:
        """The trial at the bound, or next to it; None where there is nothing but the estimate."""
        inside: _Trial | None = None
        outside: _Trial | None = None
        for _ in range(_MOST_TRIALS):
            if step <= 0.0:
                return None
            trial = self._held(problem, step)
            if trial is None:
                nearest = 0.0 if inside is None else inside.step
                self.limit = step = 0.5 * (nearest + step)
                continue
            if abs(trial.risen - 1.0) < _CLOSE or (trial.risen < 1.0 and step >= self.limit):
                return trial
            inside, outside = (trial, outside) if trial.risen < 1.0 else (inside, trial)
            step = min(_next(inside, outside), self.limit)
        return outside or inside

    def _held(self, problem: HmiDiagnosisProblem, step: float) -> _Trial | None:
        """All else fitted with the strength held; None where there is no such fit."""
        fit, strength = self.fit, self.best + self.direction * step
        strengths: Float[np.ndarray, " extension"] = fit.strengths.copy()
        strengths[self.which] = strength
        cause, unknowns = fit.extensions[self.which].cause, self.start.copy()
        unknowns[problem.program.place(cause.name)] = strength / cause.plausible
        if not np.all(np.isfinite(problem.predict(unknowns))):
            return None
        found = fit_hmi(
            problem, fit.extensions, self.noise, size=self.size, start=self.start, strengths=strengths,
            held=(self.which,),
        )  # fmt: skip
        if not found.converged:
            return None
        self.tried.append(found)
        risen = math.sqrt(max(found.misfit - fit.misfit, 0.0)) / self.bound
        return _Trial(step, risen, found)


def _next(inside: _Trial | None, outside: _Trial | None) -> float:
    """The next step: on the line between the trials next to the bound, or on the one through the estimate."""
    here, risen = (0.0, 0.0) if inside is None else (inside.step, inside.risen)
    if outside is None:
        return here * min(1.0 / max(risen, 1e-6), _STRIDE)
    slope = (outside.risen - risen) / (outside.step - here)
    return max(here + (1.0 - risen) / slope, outside.step / _STRIDE) if slope > 0.0 else 0.5 * (here + outside.step)
