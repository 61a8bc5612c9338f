"""What more than one command has to say about its results."""

import math
from typing import SupportsFloat

from arfjax import Discretisation


def boiling_notes(boiling_time: SupportsFloat) -> list[str]:
    """A warning where tissue reaches 100 degC at a time [s] that is not NaN."""
    time = float(boiling_time)
    if math.isnan(time):
        return []
    return [f"tissue reaches 100 degC at {time:g} s: it would boil, which is not simulated; do not trust what follows."]


def sound_notes(settings: Discretisation, *factors: float) -> list[str]:
    """Warnings where the sound field falls short of its tolerance, or where its heat is scaled by a power's factor.

    Heat of nonlinear sound may not be scaled by any other factor than 0 and 1.
    """
    short = [f"the sound field is not within its tolerance: {settings.shortcoming}."] if settings.shortcoming else []
    return short + _scaling_notes(settings, *factors)


def _scaling_notes(settings: Discretisation, *factors: float) -> list[str]:
    scaled = [factor for factor in factors if factor > 0.0 and abs(factor - 1.0) > 0.01]
    if settings.march.n_harmonics == 1 or not scaled:
        return []
    factor = max(scaled, key=lambda each: abs(math.log(each)))
    return [
        f"heat is that of the stated power times {factor:.3g}, but nonlinear sound of that other power would heat in "
        "another shape; state the power that is used."
    ]
