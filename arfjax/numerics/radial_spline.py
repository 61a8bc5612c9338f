"""Interpolation of what is even in r, from samples on radii, as a matrix."""

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

_ON_AXIS = 1e-6
"""A first radius below this part of the second counts as the axis: mirrored it would be a second sample there."""


def even_spline_matrix(
    points: Float[np.ndarray, " point"], radii: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "point n"]:
    """Matrix from samples at ascending `radii` to values at `points`, by the cubic spline that is even in r.

    The samples are mirrored at the axis, so that the spline is smooth there whether or not one lies on it.

    Args:
        points: Not negative, up to the last radius.
        radii: Two or more, not negative.

    Accuracy: fourth order in the spacing.
    """
    own = radii if radii[0] > _ON_AXIS * radii[1] else np.append(0.0, radii[1:])
    unit = np.eye(len(own))
    stop = 0 if own[0] == 0.0 else None
    spline = CubicSpline(np.concatenate([-own[:stop:-1], own]), np.concatenate([unit[:stop:-1], unit]))
    return spline(points)
