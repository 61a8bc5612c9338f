"""Intervals of strengths by profile likelihood: effects of causes bend within their intervals.

Most of all where a lesion begins and the displacement turns within a kelvin: the curvature at the fit knows nothing of
what is farther away.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float
from scipy import stats

from inverse.diagnosis.hmi.refit import INTERVAL_LEVEL, HmiFit, fit_hmi
from inverse.diagnosis.noise import Noise

_MOST_TRIALS = 6
_CLOSE = 0.05
"""Relative distance from the bound, in standard deviations, at which the search for an end stops."""
_STRIDE = 3.0
"""How many times as far, or as near, the next trial may be at most."""


def profiled(fit: HmiFit, noise: Noise, size: float) -> HmiFit:
    """The fit with intervals at whose ends the likelihood, all else fitted anew, has fallen to the bound.

    Accuracy: the distance of each end from the estimate is within 5 % of where the bound is met, if six trials find it,
    by the fast simulation as corrected at the fit. Where that, or `HmiCause.largest`, ends before, the end is there.

    Args:
        fit: Converged; others come back as they are.
        noise: That it was fitted in.
        size: Of the noise, as for `fit_hmi`.
    """
    if not fit.converged:
        return fit
    ends = [
        [_end(fit, which, direction, noise, size) for direction in (-1.0, 1.0)] for which in range(len(fit.extensions))
    ]
    return dataclasses.replace(fit, intervals=np.array(ends).reshape(-1, 2))


def _end(fit: HmiFit, which: int, direction: float, noise: Noise, size: float) -> float:
    """Where the root of what the fit made least has risen by as many standard deviations as the level allows."""
    reach = float(stats.t.ppf(0.5 + 0.5 * INTERVAL_LEVEL, fit.freedom))
    deviation = math.sqrt(fit.misfit / fit.freedom)
    best, lowest = float(fit.strengths[which]), fit.misfit
    limit = _limit(fit, which, direction)
    step = min(abs(float(fit.intervals[which, int(direction > 0)]) - best) or limit, limit)
    inside, outside = (0.0, 0.0), None
    for _ in range(_MOST_TRIALS):
        if step <= 0.0:
            return best
        there = _held(fit, which, best + direction * step, noise, size)
        if there is None:
            limit = step = 0.5 * (inside[0] + step)
            continue
        risen = math.sqrt(max(there.misfit - lowest, 0.0)) / deviation / reach
        if abs(risen - 1.0) < _CLOSE or (risen < 1.0 and step >= limit):
            return best + direction * step
        inside, outside = ((step, risen), outside) if risen < 1.0 else (inside, (step, risen))
        step = min(_next(inside, outside, step), limit)
    return best + direction * (outside or inside)[0]


def _next(inside: tuple[float, float], outside: tuple[float, float] | None, step: float) -> float:
    """The next trial: on the line between the trials next to the bound, or on the one through the estimate."""
    if outside is None:
        return inside[0] * min(1.0 / max(inside[1], 1e-6), _STRIDE)
    slope = (outside[1] - inside[1]) / (outside[0] - inside[0])
    return max(inside[0] + (1.0 - inside[1]) / slope, step / _STRIDE) if slope > 0.0 else 0.5 * (inside[0] + outside[0])


def _limit(fit: HmiFit, which: int, direction: float) -> float:
    """How far the strength may go."""
    cause, best = fit.extensions[which].cause, float(fit.strengths[which])
    lowest = 0.0 if cause.sign > 0 else -cause.largest
    return max(best - lowest if direction < 0.0 else cause.largest - best, 0.0)


def _held(fit: HmiFit, which: int, strength: float, noise: Noise, size: float) -> HmiFit | None:
    """All else fitted with one strength held; None where there is no such fit."""
    strengths: Float[np.ndarray, " extension"] = fit.strengths.copy()
    strengths[which] = strength
    cause, unknowns = fit.extensions[which].cause, fit.unknowns.copy()
    unknowns[fit.problem.program.place(cause.name)] = strength / cause.plausible
    if not np.all(np.isfinite(fit.problem.predict(unknowns))):
        return None
    found = fit_hmi(
        fit.problem, fit.extensions, noise, size=size, start=fit.unknowns, strengths=strengths, held=(which,)
    )  # fmt: skip
    return found if found.converged else None
