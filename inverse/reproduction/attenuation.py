"""The attenuation polynomial: where it is normalised, where it is least, and how much of the curve it explains."""

import numpy as np
from jaxtyping import Float

from arfjax import suomi2016, tissues
from arfjax.units import from_db_per_cm
from inverse.reproduction.row import Row

SECTION = "attenuation"
FREQUENCY_MHZ = 1.1
"""Of the paper's simulated transducer."""

PATH = 20e-3
"""Liver in front of the focus [m]: half of the paper's 40 mm; where the focus lies is not stated."""

_COEFFICIENT_PLACES = (0, -2, -3, -5, -8)
"""Power of ten of each coefficient's last printed digit."""


def rounding_of_polynomial(temperature: float) -> float:
    """By how much the rounding of its coefficients can move the polynomial at a temperature [degC], in percent."""
    return 0.5 * sum(10.0**place * temperature**power for power, place in enumerate(_COEFFICIENT_PLACES))


def force_of_plane_wave(
    temperature: float | Float[np.ndarray, " n"], *, path: float = PATH
) -> float | Float[np.ndarray, " n"]:
    """Attenuation times what it leaves of the intensity, alpha(T) exp(-2 alpha(T) path), relative to 35 degC [1]."""
    percent = 1e-2 * np.asarray(tissues.liver_attenuation().percent(np.asarray([35.0, *np.atleast_1d(temperature)])))
    alpha = percent * from_db_per_cm(suomi2016.TABLE_1_ACOUSTIC["liver"].attenuation_db_per_cm_mhz) * FREQUENCY_MHZ
    force = alpha * np.exp(-2.0 * alpha * path)
    ratio = force[1:] / force[0]
    return float(ratio[0]) if np.ndim(temperature) == 0 else ratio


def lowest_of_polynomial() -> tuple[float, float]:
    """Temperature [degC] and value [percent] of the polynomial's minimum between 30 and 60 degC."""
    temperatures = np.linspace(30.0, 60.0, 3001)
    curve = np.asarray(tissues.liver_attenuation().percent(temperatures))
    lowest = int(np.argmin(curve))
    return float(temperatures[lowest]), float(curve[lowest])


def attenuation_rows() -> list[Row]:
    """The polynomial against what it is normalised to, and against the simulated displacement."""
    percent = tissues.liver_attenuation().percent
    where, lowest = lowest_of_polynomial()
    rounding = rounding_of_polynomial(37.0)
    rows = [
        Row(
            SECTION,
            "attenuation polynomial at 37 degC",
            100.0,
            float(percent(37.0)),
            "percent",
            rounding,
            "normalised to 37 degC, but not constrained there; rounding of the coefficients allows "
            f"{rounding:.2f} percent points, so it is not rounding",
        ),
        Row(
            SECTION,
            "attenuation polynomial at 35 degC",
            100.0,
            float(percent(35.0)),
            "percent",
            rounding_of_polynomial(35.0),
            "the temperature that table 1 is stated for and the displacement is normalised to",
        ),
        Row(
            SECTION,
            "temperature of the polynomial's minimum",
            45.0,
            where,
            "degC",
            2.5,
            f"text: 'around 45 degC'; the minimum is {lowest:.1f} percent",
        ),
    ]
    for temperature in (45.0, 55.0):
        here = 100.0 * float(force_of_plane_wave(temperature))
        stated = suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT[temperature]
        why = "alpha(T) exp(-2 alpha z) with z = 20 mm of liver: below 60 degC the curve is attenuation alone"
        rows.append(
            Row(SECTION, f"force of a plane wave at {temperature:g} degC", stated, here, "percent of 35 degC", 0.5, why)
        )
    return rows
