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


def scaling_notes(settings: Discretisation, *factors: float) -> list[str]:
    """A warning where heat of nonlinear sound is scaled to another power by a factor other than 0 and 1."""
    scaled = [factor for factor in factors if factor > 0.0 and abs(factor - 1.0) > 0.01]
    if settings.march.n_harmonics == 1 or not scaled:
        return []
    factor = max(scaled, key=lambda each: abs(math.log(each)))
    return [
        f"heat is that of the stated power times {factor:.3g}, but nonlinear sound of that other power would heat in "
        "another shape; state the power that is used."
    ]
