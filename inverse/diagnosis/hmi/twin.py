"""A second strength of one cause that describes the data as well, where its effect turns back.

Displacement has an extremum between 37 and 50 degC in most tissue: a reading that was taken warmer than stated then has
a twin, taken colder. A fit descends into the one that is nearer to nothing, and the profile about it ends before the
other: of two data sets with `normalisation-temperature` hidden, both intervals missed the strength for this reason.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float
from scipy import stats

from inverse.diagnosis.hmi.fitting import INTERVAL_LEVEL, Fitting, HmiFit
from inverse.diagnosis.hmi.problem import farthest
from inverse.diagnosis.noise import Noise

_STRENGTHS = 33
"""Looked at on the way from the largest to the smallest that an effect is followed to; 20 ms each."""
_CLEARLY_WORSE = 5.0
"""t by which a strength is, constants as they are; the fast simulation's errors are of that length."""
_WORTH_SAYING = 0.25
"""How much lower, in squared standard deviations, the twin's misfit is for it to take the fit's place."""


def twin_strength(fit: HmiFit, noise: Noise, size: float) -> float | None:
    """Where a fit of one cause may have a twin outside of its interval; None if nowhere.

    By the fast simulation as it is, because a correction knows nothing of what is far away, and with the constants of
    the fit: a twin that needs others is not found.

    Args:
        fit: `profiled`.
        noise: What it was weighed with.
        size: Of the noise, in units of the weights: what the priors count against.
    """
    if len(fit.extensions) != 1 or not fit.converged:
        return None
    cause = fit.extensions[0].cause
    least, largest = (sign * _farthest(fit, sign) for sign in (-1, 1))
    fitting = Fitting(dataclasses.replace(fit.problem, correction=None), fit.extensions, noise, size)

    def misfit(strength: float) -> float:
        unknowns = fit.unknowns.copy()
        unknowns[fitting.strengths[0]] = strength
        value = fitting.stacked(unknowns)
        return float(value @ value) if np.all(np.isfinite(value)) else math.inf

    strengths = np.linspace(least, largest, _STRENGTHS)
    found = np.array([misfit(strength) for strength in strengths])
    own = misfit(float(fit.strengths[0]) / cause.plausible)
    around = np.pad(found, 1, constant_values=np.inf)
    lower, upper = fit.intervals[0] / cause.plausible
    beside = (strengths < lower) | (strengths > upper)
    # One of the ends may be a turn, too: the flank of a twin farther out, which the fit then finds.
    turns = (found < around[:-2]) & (found < around[2:])
    near = found - own < _CLEARLY_WORSE**2 * own * fit.variance / fit.misfit
    places = np.flatnonzero(beside & turns & near)
    return float(strengths[places[np.argmin(found[places])]]) * cause.plausible if len(places) else None


def _farthest(fit: HmiFit, sign: int) -> float:
    """How far from 0 a twin is looked for to one side, in plausible strengths."""
    cause = fit.extensions[0].cause
    # The fit itself may lie beyond what effects are followed to.
    return max(farthest(cause, sign), min(2.0 * abs(float(fit.strengths[0])), cause.farthest(sign)) / cause.plausible)


def spanning(fit: HmiFit, twin: HmiFit) -> HmiFit:
    """The better of two fits of one cause; where both describe the data, with an interval over both.

    Accuracy: the ends of the worse fit are counted from where it is, not from the better: they are as far out as those
    of the likelihood at least.

    Args:
        fit: `profiled`.
        twin: `profiled`, of another strength.
    """
    is_better = fit.misfit - twin.misfit > _WORTH_SAYING * fit.variance
    better, worse = (twin, fit) if is_better else (fit, twin)
    risen = math.sqrt(max(worse.misfit - better.misfit, 0.0) / better.variance)
    remarks = better.remarks
    if is_better:
        remarks += ("another strength fits better: the strength is of that one, p-values are not.",)
    if risen >= float(stats.t.ppf(0.5 + 0.5 * INTERVAL_LEVEL, better.freedom)):
        return dataclasses.replace(better, remarks=remarks)
    ends: Float[np.ndarray, "2 2"] = np.stack([better.intervals[0], worse.intervals[0]])
    unit = "" if (unit := better.extensions[0].cause.unit) == "1" else f" {unit}"
    first, second = (
        f"{one.strengths[0]:.3g} ({one.intervals[0, 0]:.3g} to {one.intervals[0, 1]:.3g}){unit}"
        for one in (better, worse)
    )
    both = f"two strengths describe these data, {first} and {second}: the interval spans both and what lies between."
    own = tuple(one for one in worse.remarks if one not in remarks)
    intervals = np.array([[ends.min(), ends.max()]])
    return dataclasses.replace(better, intervals=intervals, remarks=(*remarks, *own, both))
