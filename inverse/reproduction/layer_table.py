"""Table 1: at what temperature its water is."""

import numpy as np
from numpy.polynomial import Polynomial

from arfjax import suomi2016
from inverse.reproduction.row import Row

SECTION = "layers"

_WATER_SPEED = Polynomial([1.402385e3, 5.038813, -5.799136e-2, 3.287156e-4, -1.398845e-6, 2.787860e-9])
"""Speed of sound [m/s] in water by temperature [degC]. Marczak, J. Acoust. Soc. Am. 102 (1997) 2776; 0 to 95 degC."""


def water_sound_speed(temperature: float) -> float:
    """Speed of sound in water [m/s] at a temperature [degC]."""
    return float(_WATER_SPEED(temperature))


def temperature_of_water(sound_speed: float) -> float:
    """Temperature [degC] below 70 at which water has a speed of sound [m/s]."""
    temperatures = np.linspace(0.0, 70.0, 7001)
    return float(np.interp(sound_speed, _WATER_SPEED(temperatures), temperatures))


def layer_rows() -> list[Row]:
    """The row of water, which is said to be at 35 degC."""
    water = suomi2016.TABLE_1_ACOUSTIC["water"]
    return [
        Row(
            SECTION,
            "temperature of the water in table 1",
            35.0,
            temperature_of_water(water.sound_speed),
            "degC",
            0.5,
            f"where water has {water.sound_speed:g} m/s; at 35 degC it has {water_sound_speed(35.0):.0f}. Attenuation "
            "and B/A are those of 20 degC too",
        )
    ]
