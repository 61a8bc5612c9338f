"""Moduli of the paper's table 2: what its text reads off the curves, and the phase that it does not give."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

from arfjax import FractionalZener, Zener, complex_modulus, suomi2016
from inverse.reproduction.row import Row, half_of_last_digit

SECTION = "dynamic modulus"
TABLES = {"zener": suomi2016.TABLE_2_ZENER, "fractional-zener": suomi2016.TABLE_2_FRACTIONAL_ZENER}


def solid_of(row: suomi2016.ZenerRow) -> Zener | FractionalZener:
    """The solid of a row of the paper's table 2."""
    relaxed, unrelaxed = row.relaxed_modulus_pa, 1e3 * row.unrelaxed_modulus_kpa
    if row.fractional_order == 1.0:
        return Zener(relaxed, unrelaxed, row.relaxation_time)
    return FractionalZener(relaxed, unrelaxed, row.relaxation_time, row.fractional_order)


def modulus_of(row: suomi2016.ZenerRow, frequency_hz: Float[np.ndarray, " n"]) -> Complex[np.ndarray, " n"]:
    """Complex modulus [Pa] of a row of table 2 at frequencies [Hz]."""
    return np.asarray(_compiled_modulus(solid_of(row), 2.0 * math.pi * jnp.asarray(frequency_hz, dtype=float)))


# Compiled, because operation by operation every other number of frequencies takes a second.
_compiled_modulus = jax.jit(complex_modulus)


def modulus_magnitude(row: suomi2016.ZenerRow, frequency_hz: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Magnitude of the complex modulus [Pa] of a row of table 2 at frequencies [Hz]."""
    return np.abs(modulus_of(row, frequency_hz))


def loss_tangent(row: suomi2016.ZenerRow, frequency_hz: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Loss over storage modulus [1] of a row of table 2 at frequencies [Hz]."""
    modulus = modulus_of(row, frequency_hz)
    return np.imag(modulus) / np.real(modulus)


def modulus_from_rounding(row: suomi2016.ZenerRow, frequency_hz: float) -> tuple[float, float]:
    """Smallest and largest magnitude [Pa] that M_inf before its rounding allows, the other constants as printed."""
    at = np.asarray([frequency_hz])
    ends = [
        float(modulus_magnitude(row._replace(unrelaxed_modulus_kpa=row.unrelaxed_modulus_kpa + half), at)[0])
        for half in (-0.05, 0.05)
    ]
    return ends[0], ends[1]


def relaxed_modulus_for(row: suomi2016.ZenerRow, frequency_hz: float, magnitude: float) -> float:
    """Relaxed modulus [Pa] with which a conventional row has a magnitude [Pa] at a frequency [Hz]."""
    squared = (2.0 * math.pi * frequency_hz * row.relaxation_time) ** 2
    # |M|^2 = (M_0^2 + x^2 M_inf^2) / (1 + x^2) for order 1.
    return math.sqrt(magnitude**2 * (1.0 + squared) - squared * (1e3 * row.unrelaxed_modulus_kpa) ** 2)


def modulus_rows() -> list[Row]:
    """Values that the text reads off its own curves, and what they would need."""
    rows = []
    for (model, temperature, frequency), stated in suomi2016.TEXT_MODULUS_KPA.items():
        row = TABLES[model][temperature]
        here = 1e-3 * float(modulus_magnitude(row, np.asarray([frequency]))[0])
        # "100" does not leave 50 open.
        tolerance = min(half_of_last_digit(stated), 0.05 * stated)
        low, high = (1e-3 * each for each in modulus_from_rounding(row, frequency))
        why = f"equations 4 and 5 with table 2, whose rounding allows {low:.3g} to {high:.3g}"
        quantity = f"|M| of the {model} model at {temperature:g} degC, {frequency:g} Hz"
        rows.append(Row(SECTION, quantity, stated, here, "kPa", tolerance, why))
    hot = suomi2016.TABLE_2_ZENER[50.0]
    needed = relaxed_modulus_for(hot, 0.1, 5e3)
    why = "what the text's 5 kPa at 0.1 Hz takes, against the table's M_0"
    rows.append(Row(SECTION, "M_0 of the zener model at 50 degC", hot.relaxed_modulus_pa, needed, "Pa", 0.05, why))
    for temperature in (50.0, 65.0, 80.0):
        here = float(loss_tangent(suomi2016.TABLE_2_ZENER[temperature], np.asarray([0.1]))[0])
        why = "implied by table 2; the paper shows measured values in a figure only"
        rows.append(
            Row(SECTION, f"tan delta of the zener model at {temperature:g} degC, 0.1 Hz", None, here, "1", 0.0, why)
        )
    return rows
