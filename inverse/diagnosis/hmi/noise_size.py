"""How large the noise of readings is, which is what priors of the constants count against.

Where a file does not state it, residuals of the fit without causes tell it, and an effect that is hidden in them makes
them too large: d' 9 in forty readings by 1.9 (1.5 to 3.3). Priors then hold constants too firmly in every refit with a
cause, and what is left by a wrong cause is lost in them. The size is therefore the one beside the likeliest single
effect, if noise alone would seldom look so.

On linear curves (development, 51 data sets, a cause of d' 9 taken out of the library) 38 were `unexplained` with the
size known, 30 with the one of all residuals, 35 with this one before correlated noise was told from effects.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.screening import Alternative, Screen

_SELDOM = 0.01
"""Probability of any effect so likely in noise alone, of the number of effects taken together (Bonferroni)."""
_SETTLED, _MOST_TURNS = 0.01, 20


def noise_size(fit: HmiFit) -> float:
    """Standard deviation of a fit's residuals, by readings alone, in units of the weights."""
    return float(np.sqrt(np.sum(fit.of_readings**2) / fit.freedom))


def size_beside_effect(
    residuals: Float[np.ndarray, " datum"],
    directions: Float[np.ndarray, "datum p"],
    family: Sequence[Noise],
    effects: Sequence[Alternative],
    size: float,
) -> float:
    """Standard deviation of what the likeliest single effect leaves of the readings, in units of the weights.

    By turns with how firmly priors of that size hold the constants, in the linearised model, until it falls no more.

    Args:
        residuals: Of a fit without causes in white noise: of readings, then of beliefs.
        directions: Derivative in all that was fitted.
        family: Noise that there may be, white first: what correlated noise may do is no effect.
        effects: Of causes about it.
        size: That its beliefs are weighed against.

    Returns:
        The size, or `size` where that is not larger or noise alone may well look so.
    """
    readings, found = len(residuals) - family[0].beliefs, size
    for _ in range(_MOST_TURNS):
        weighed = np.where(np.arange(len(residuals)) < readings, 1.0, found / size)
        left = _beside_likeliest(weighed * residuals, weighed[:, None] * directions, family, effects)
        if left >= (1.0 - _SETTLED) * found:
            break
        found = left
    return found


def _beside_likeliest(
    residuals: Float[np.ndarray, " datum"],
    directions: Float[np.ndarray, "datum p"],
    family: Sequence[Noise],
    effects: Sequence[Alternative],
) -> float:
    screen = Screen(directions, effects, family)
    log_p = screen.statistics(residuals[:, None]).log_p[:, 0]
    if len(log_p) and np.min(log_p) + np.log(len(log_p)) <= np.log(_SELDOM):
        likeliest = screen.alternatives[int(np.argmin(log_p))]
        directions = np.append(directions, likeliest.directions, axis=1)
    return Screen(directions, (), family[:1]).of_readings(residuals)[0]
