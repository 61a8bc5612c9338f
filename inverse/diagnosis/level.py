"""The level of a diagnosis, and how many replicates show it."""

import math

from arfjax import InputError
from inverse.diagnosis.decision import replicates_at
from inverse.diagnosis.evidence import ALLOWANCE
from inverse.diagnosis.noise_gate import GATE_LEVEL
from inverse.diagnosis.rule import SET_LEVEL

LOWEST_LEVEL, HIGHEST_LEVEL = 0.005, 0.5
"""Lower ones were never tried; above it nothing is a level."""


def require_level(level: float, replicates: int | None = None, *, few: bool = False) -> int:
    """Refuse a level that is out of range, or that replicates cannot show.

    Args:
        level: Of the test of everything.
        replicates: Of noise alone; as many as the level needs, if not said.
        few: Whether data are few.

    Returns:
        How many to draw: as said, or as many as the level needs.

    Raises:
        InputError: if it is out of range, or replicates are too few for it.
    """
    if not LOWEST_LEVEL <= level <= HIGHEST_LEVEL:
        raise InputError(f"`level` must be from {LOWEST_LEVEL:g} to {HIGHEST_LEVEL:g}, got {level:g}.")
    if replicates is None:
        return replicates_at(level, few=few)
    shown = min(level, SET_LEVEL, GATE_LEVEL)
    needed = math.ceil(2.0 / shown) - 1
    if replicates < needed:
        raise InputError(
            f"`replicates` must be {needed} or more to show a level of {shown:g}, got {replicates}: the least p-value "
            f"that n of them can show is 1/(n + 1), of curves {ALLOWANCE:g} times that. Causes are ruled out, and "
            f"noise is judged, at a level of {SET_LEVEL:g}."
        )
    return replicates
