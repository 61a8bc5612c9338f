"""What more than one command has to say about its results."""

import math
from typing import SupportsFloat


def boiling_notes(boiling_time: SupportsFloat) -> list[str]:
    """A warning where tissue reaches 100 degC at a time [s] that is not NaN."""
    time = float(boiling_time)
    if math.isnan(time):
        return []
    return [f"tissue reaches 100 degC at {time:g} s: it would boil, which is not simulated; do not trust what follows."]
