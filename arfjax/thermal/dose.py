"""Thermal dose: how long at 43 degC would harm tissue as much as its whole temperature history did."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.units import SECONDS_PER_MINUTE

REFERENCE_TEMPERATURE = 43.0
"""Temperature [degC] at which dose is counted, and where the rate breaks."""

DOUBLINGS_PER_KELVIN_ABOVE = 1.0
"""R = 0.5: a kelvin more halves the time for the same effect. Sapareto & Dewey, IJROBP 10 (1984) 787."""

DOUBLINGS_PER_KELVIN_BELOW = 2.0
"""R = 0.25 below the break. Sapareto & Dewey, IJROBP 10 (1984) 787."""

LETHAL_DOSE_MINUTES = 240.0
"""Dose [min] taken as the border of necrosis in soft tissue. Damianou, Hynynen & Fan, IEEE UFFC 42 (1995) 187;
the threshold of Suomi et al. 2016 too."""


def dose_rate(temperature: Float[Array, "*shape"] | Float[np.ndarray, "*shape"]) -> Float[Array, "*shape"]:
    """Minutes at 43 degC that count for one minute at `temperature` [degC]: R^(43 - T).

    Differentiability: everywhere; at 43 degC itself the upper slope. Finite to 170 degC in float32, 1000 in float64.
    """
    excess = jnp.asarray(temperature) - REFERENCE_TEMPERATURE
    doublings = jnp.where(excess >= 0.0, DOUBLINGS_PER_KELVIN_ABOVE, DOUBLINGS_PER_KELVIN_BELOW)
    return jnp.exp2(doublings * excess)


def cumulative_equivalent_minutes(
    temperature: Float[Array, "time *space"] | Float[np.ndarray, "time *space"],
    time: Float[Array, " time"] | Float[np.ndarray, " time"],
) -> Float[Array, "time *space"]:
    r"""Thermal dose CEM43 of a temperature history, at each of its times.

    $$ \mathrm{CEM43}(t) = \int_0^t R^{43 - T(t')} \, dt', \quad R = 0.5 \text{ from } 43 °C, \; 0.25 \text{ below} $$

    Args:
        temperature: Tissue temperature [degC].
        time: When it was sampled, ascending, evenly or not [s].

    Returns:
        Dose [equivalent min at 43 degC], 0 at the first time.

    Accuracy: trapezoidal, second order in the sampling interval. Where temperature changes by d kelvin between two
    samples, above 43 degC, the relative error is (d ln 2)^2 / 12 and the dose too high: 1 % at d = 0.5 K.
    Differentiability: everywhere; at 43 degC the upper slope. No overflow to 170 degC, in float32 as well.
    Source: Sapareto & Dewey, IJROBP 10 (1984) 787.
    """
    rate = dose_rate(temperature)
    intervals = jnp.diff(jnp.asarray(time)) / SECONDS_PER_MINUTE
    intervals = intervals.reshape((-1,) + (1,) * (rate.ndim - 1))
    increments = 0.5 * (rate[1:] + rate[:-1]) * jnp.broadcast_to(intervals, rate[1:].shape)
    return jnp.concatenate([jnp.zeros_like(rate[:1]), jnp.cumsum(increments, axis=0)])
