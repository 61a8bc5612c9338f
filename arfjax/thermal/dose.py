"""Thermal dose: how long at 43 degC would harm tissue as much as its whole temperature history did."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.thermal.damage import LETHAL_DOSE_MINUTES as LETHAL_DOSE_MINUTES
from arfjax.thermal.damage import ThermalDose, accumulated_damage
from arfjax.units import SECONDS_PER_MINUTE


def dose_rate(temperature: Float[Array, "*shape"] | Float[np.ndarray, "*shape"]) -> Float[Array, "*shape"]:
    """Minutes at 43 degC that count for one minute at `temperature` [degC]: R^(43 - T).

    Differentiability: everywhere; at 43 degC itself the upper slope. Finite to 170 degC in float32, 1000 in float64.
    """
    return SECONDS_PER_MINUTE * jnp.exp(ThermalDose().log_rate(temperature))


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

    Raises:
        InputError: as `accumulated_damage`.

    Accuracy: second order in the sampling interval dt; exact where temperature changes linearly between samples on
    one side of 43 degC. An interval of d kelvin across 43 degC loses at most dt d ln(2) / 8 (0.0014 min at 1 K and
    1 s), an average of dt d ln(2) / 12. Where temperature bends, the relative error above 43 degC is
    ln(2) / 12 times dt^2 times its second derivative.
    Differentiability: everywhere; at 43 degC the upper slope. No overflow to 170 degC, in float32 as well.
    Source: Sapareto & Dewey, IJROBP 10 (1984) 787.
    """
    return accumulated_damage(ThermalDose(), temperature, time)
