"""Logarithms of p-values, however small: those of large effects are below what a float can hold."""

import numpy as np
from jaxtyping import Float
from scipy import special, stats

_LOWEST = -600.0
"""Logarithm of a p-value below which tables of scipy underflow soon."""


def log_p_of_t(t: Float[np.ndarray, "*shape"], freedom: int) -> Float[np.ndarray, "*shape"]:
    """Logarithm of the probability that Student's t is larger than `t`, which is 0 or more."""
    found = stats.t.logsf(t, freedom)
    far = ~(found > _LOWEST)
    if np.any(far):
        found = np.where(far, _of_far_t(np.where(far, t, 1.0), freedom), found)
    return found


def log_p_of_one_variance(gain: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Logarithm of the probability that chi-squared of one degree of freedom is larger than `gain`."""
    return np.log(2.0) + stats.norm.logsf(np.sqrt(gain))


def _of_far_t(t, freedom: int):
    """The incomplete beta function by its series in $n / (n + t^2)$, its power taken out."""
    a, b, x = 0.5 * freedom, 0.5, freedom / (freedom + np.square(t))
    power = a * np.log(x) + b * np.log1p(-x) - np.log(a) - special.betaln(a, b)
    return power + np.log(special.hyp2f1(a + b, 1.0, a + 1.0, x)) - np.log(2.0)
