"""Strengths and shapes that are as large, or as small, as there can be."""

import numpy as np
from jaxtyping import Bool, Float

_CLOSE = 1e-3
"""Part of the range, or of 1 if that is less, within which a number is at its end: solvers stay a little inside."""


def at_limit(
    value: Float[np.ndarray, " n"],
    lower: Float[np.ndarray, " n"],
    upper: Float[np.ndarray, " n"],
    gradient: Float[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Which numbers are at an end of their range that a better fit lies beyond.

    Such a number cannot follow the data any more: along its effect they are as conspicuous as along any other. Inside
    of its range the gradient is 0 at a fit, so that nothing is lost by one that happens to be near the end.

    Args:
        value: Of each.
        lower: Least that it can be.
        upper: Largest that it can be.
        gradient: Of the sum of squares in it.
    """
    close = _CLOSE * np.minimum(upper - lower, 1.0)
    return ((value - lower <= close) & (gradient > 0.0)) | ((upper - value <= close) & (gradient < 0.0))
