"""When 240 equivalent minutes are reached: on a straight ramp, and in the simulated sonication."""

import jax.numpy as jnp
import numpy as np

from arfjax import LETHAL_DOSE_MINUTES, Heating, cumulative_equivalent_minutes, focal_temperature_at
from inverse.reproduction.row import Row

SECTION = "dose"
FIRST_LESION = 60.0  # degC; text
_STEP = 5.0  # K; between the paper's temperatures


def lethal_temperature_of_ramp(*, start: float = 35.0, end: float = 70.0, duration: float = 60.0) -> float:
    """Temperature [degC] at which a steady ramp has given the lethal dose.

    Args:
        start: [degC].
        end: [degC].
        duration: [s].
    """
    time = jnp.linspace(0.0, duration, 60_001)
    temperature = start + (end - start) * time / duration
    dose = np.asarray(cumulative_equivalent_minutes(temperature, time))
    return float(np.asarray(temperature)[np.searchsorted(dose, LETHAL_DOSE_MINUTES)])


def lethal_moment(heating: Heating) -> tuple[float, float]:
    """Time [s] at which the first cell of a sonication has the lethal dose, and focal temperature then [degC].

    Between output times the logarithm of dose is taken to be linear.
    """
    highest = np.log(np.maximum(np.max(np.asarray(heating.dose), axis=(1, 2)), 1e-30))
    time = float(np.interp(np.log(LETHAL_DOSE_MINUTES), highest, np.asarray(heating.time)))
    return time, float(focal_temperature_at(heating, jnp.asarray([time]))[0])


def dose_rows() -> list[Row]:
    """The straight ramp."""
    why = "240 min on a straight ramp from 35 to 70 degC in 60 s; steps of 5 degC show a lesion above 55 first at 60"
    here = lethal_temperature_of_ramp()
    return [
        Row(SECTION, "temperature at which the lesion appears, straight ramp", FIRST_LESION, here, "degC", _STEP, why)
    ]


def simulated_dose_rows(heating: Heating) -> list[Row]:
    """The simulated sonication, whose focus warms fast at first and slowly at the end."""
    time, temperature = lethal_moment(heating)
    why = (
        f"240 min in the hottest cell after {time:.0f} s of the simulated sonication: a constant power heats fast at "
        "first, so that the focus has been hot for longer than on a ramp; at 55 degC there is a lesion already"
    )
    name = "temperature at which the lesion appears, simulated"
    return [Row(SECTION, name, FIRST_LESION, temperature, "degC", _STEP, why)]
