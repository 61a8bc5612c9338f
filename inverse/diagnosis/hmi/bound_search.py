"""The search for the step from an estimate at which a profile of the likelihood meets its bound."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

MOST_TRIALS = 8
_CLOSE = 0.05
"""Relative distance from the bound, in standard deviations, at which the search for an end stops."""
_STRIDE = 3.0
"""How many times as far, or as near, the next trial may be at most."""


@dataclasses.dataclass(frozen=True)
class Trial:
    """All else fitted with the strength a distance from its estimate, which is risen of the way to the bound.

    `remark` is what is to be said of it if it is the end.
    """

    step: float
    risen: float
    unknowns: Float[np.ndarray, " unknown"]
    remark: str = ""


def searched(held: Callable[[float], Trial | None], step: float, limit: float, most: int = MOST_TRIALS) -> Trial | None:
    """The trial at the bound, or next to it; None where there is nothing but the estimate.

    Args:
        held: The trial at a distance; None where there is none.
        step: Where to begin.
        limit: The farthest.
        most: Trials.
    """
    inside: Trial | None = None
    outside: Trial | None = None
    failed = math.inf
    for _ in range(most):
        trial = held(step)
        if trial is None:
            failed = step
        elif abs(trial.risen - 1.0) < _CLOSE or (trial.risen < 1.0 and step >= limit):
            return trial
        elif trial.risen < 1.0:
            inside = trial
        else:
            outside = trial
        nearest = 0.0 if inside is None else inside.step
        if inside is not None and failed - nearest < _CLOSE * failed:
            return dataclasses.replace(inside, remark=inside.remark or "is where fits could be made no farther.")
        step = min(_next(inside, outside) if inside or outside else failed, limit)
        if step >= failed:
            step = 0.5 * (nearest + failed)
    end = outside or inside
    return None if end is None else dataclasses.replace(end, remark=end.remark or f"was not met in {most} trials.")


def _next(inside: Trial | None, outside: Trial | None) -> float:
    """The next step: on the line between the trials next to the bound, or on the one through the estimate."""
    here, risen = (0.0, 0.0) if inside is None else (inside.step, inside.risen)
    if outside is None:
        return here * min(1.0 / max(risen, 1e-6), _STRIDE)
    slope = (outside.risen - risen) / (outside.step - here)
    return max(here + (1.0 - risen) / slope, outside.step / _STRIDE)
