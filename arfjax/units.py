"""Conversions between the field's customary units and SI, used at the border of the package and nowhere inside.

Inside, everything is SI, with two exceptions: temperature is in degC and thermal dose in minutes.
"""

import math

DECIBEL_PER_NEPER = 20.0 / math.log(10.0)
"""One neper in decibel, 20 log10(e)."""

ZERO_CELSIUS_IN_KELVIN = 273.15
SECONDS_PER_MINUTE = 60.0

MODULUS_IN_PASCAL = {"pa": 1.0, "kpa": 1e3, "mpa": 1e6, "gpa": 1e9}
"""Pascal per unit of modulus, by the unit's name in lower case."""

LENGTH_IN_METRE = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "\u00b5m": 1e-6, "\u03bcm": 1e-6, "nm": 1e-9}
"""Metre per unit of length, by the unit's name in lower case; micro is written u, as its own sign or as a Greek mu."""

REFERENCE_FREQUENCY = 1e6
"""Frequency [Hz] at which attenuation coefficients are quoted: the MHz in dB/(cm MHz^y)."""


def from_db_per_cm(attenuation_db_per_cm: float) -> float:
    """Attenuation [Np/m] from [dB/cm]; at 1 MHz this also converts the prefactor of dB/(cm MHz^y)."""
    return attenuation_db_per_cm * 100.0 / DECIBEL_PER_NEPER


def to_db_per_cm(attenuation: float) -> float:
    """Attenuation [dB/cm] from [Np/m]."""
    return attenuation * DECIBEL_PER_NEPER / 100.0
