"""The paper's own numbers beside what its tables, its equations and this simulation give.

Nothing is tuned to agree: each row states what the paper says, what comes out here, and why they differ where they do.
"""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from arfjax import (
    LETHAL_DOSE_MINUTES,
    DoseSize,
    FractionalZener,
    StepwiseResult,
    TabulatedSize,
    Zener,
    complex_modulus,
    cumulative_equivalent_minutes,
    suomi2016,
    tissues,
)


@dataclasses.dataclass(frozen=True)
class Row:
    """A number of the paper and its counterpart.

    Attributes:
        quantity: What it is.
        paper: As printed.
        here: As computed.
        unit: Of both.
        tolerance: Largest difference that the paper's rounding allows, in the unit.
        why: Where the computed number comes from, or what explains the difference.
    """

    quantity: str
    paper: float
    here: float
    unit: str
    tolerance: float
    why: str

    @property
    def difference(self) -> float:
        """Computed minus printed."""
        return self.here - self.paper

    @property
    def verdict(self) -> str:
        """Whether the difference is within what rounding allows."""
        return "agrees" if abs(self.difference) <= self.tolerance else "differs"


def solid_of(row: suomi2016.ZenerRow) -> Zener | FractionalZener:
    """The solid of a row of the paper's table 2."""
    relaxed, unrelaxed = row.relaxed_modulus_pa, 1e3 * row.unrelaxed_modulus_kpa
    if row.fractional_order == 1.0:
        return Zener(relaxed, unrelaxed, row.relaxation_time)
    return FractionalZener(relaxed, unrelaxed, row.relaxation_time, row.fractional_order)


def modulus_magnitude(row: suomi2016.ZenerRow, frequency_hz: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Magnitude of the complex modulus [Pa] of a row of table 2 at frequencies [Hz]."""
    solid = solid_of(row)
    return np.asarray([abs(complex(complex_modulus(solid, 2.0 * math.pi * float(f)))) for f in frequency_hz])


def attenuation_rows() -> list[Row]:
    """The polynomial against what it is normalised to."""
    attenuation = tissues.liver_attenuation()
    temperatures = np.linspace(30.0, 60.0, 3001)
    curve = np.asarray(attenuation.percent(temperatures))
    lowest = int(np.argmin(curve))
    rounding = 0.5 * sum(10.0**e * 37.0**i for i, e in enumerate((0, -2, -3, -5, -8)))
    return [
        Row(
            "attenuation polynomial at 37 degC",
            100.0,
            float(attenuation.percent(37.0)),
            "percent",
            rounding,
            "normalised to 37 degC, but not constrained there; rounding of the coefficients allows "
            f"{rounding:.2f} percent points, so it is not rounding",
        ),
        Row(
            "temperature of the polynomial's minimum",
            45.0,
            float(temperatures[lowest]),
            "degC",
            2.5,
            f"text: 'around 45 degC'; the minimum is {curve[lowest]:.1f} percent",
        ),
    ]


def modulus_rows() -> list[Row]:
    """Values that the text reads off its own curves, recomputed from its table 2."""
    tables = {"zener": suomi2016.TABLE_2_ZENER, "fractional-zener": suomi2016.TABLE_2_FRACTIONAL_ZENER}
    rows = []
    for (model, temperature, frequency), stated in suomi2016.TEXT_MODULUS_KPA.items():
        here = 1e-3 * float(modulus_magnitude(tables[model][temperature], np.asarray([frequency]))[0])
        tolerance = min(_half_of_last_digit(stated), 0.05 * stated)
        quantity = f"|M| of the {model} model at {temperature:g} degC, {frequency:g} Hz"
        rows.append(Row(quantity, stated, here, "kPa", tolerance, "equations 4 and 5 with table 2"))
    return rows


def _half_of_last_digit(stated: float) -> float:
    """Half a unit of the last digit that is not a trailing zero: what "around 40" and "approximately 19" leave open.

    Its caller stops at 5 percent, since "100" does not leave 50 open.
    """
    digits = f"{stated:g}"
    decimals = len(digits.partition(".")[2])
    zeros = 0 if decimals else len(digits) - len(digits.rstrip("0"))
    return 0.5 * 10.0 ** (zeros - decimals)


def lesion_constant_rows() -> list[Row]:
    """Table 3 as regressions through the hot and cold rows of table 2."""
    temperatures = np.asarray(sorted(suomi2016.TABLE_2_ZENER))
    table = [suomi2016.TABLE_2_ZENER[t] for t in temperatures]
    stiffness = np.polyfit(temperatures, np.log([row.unrelaxed_modulus_kpa for row in table]), 1)
    relaxation = np.polyfit(temperatures, [row.relaxation_time for row in table], 1)
    rows = []
    for temperature, column in suomi2016.TABLE_3_LESION.items():
        rows.append(
            Row(
                f"lesion M_inf - M_0 at {temperature:g} degC",
                column.branch_modulus_kpa,
                float(np.exp(np.polyval(stiffness, temperature))),
                "kPa",
                0.25,
                "log-linear regression of M_inf over all rows of table 2: M_inf is printed as M_inf - M_0",
            )
        )
        rows.append(
            Row(
                f"lesion relaxation time at {temperature:g} degC",
                column.relaxation_time,
                float(np.polyval(relaxation, temperature)),
                "s",
                0.0015,
                "linear regression of tau over all rows of table 2",
            )
        )
    return rows


def dose_rows() -> list[Row]:
    """The temperature at which a steady 60 s ramp from 35 to 70 degC has given 240 equivalent minutes."""
    time = jnp.linspace(0.0, 60.0, 60_001)
    temperature = 35.0 + 35.0 * time / 60.0
    dose = np.asarray(cumulative_equivalent_minutes(temperature, time))
    reached = float(np.asarray(temperature)[np.searchsorted(dose, LETHAL_DOSE_MINUTES)])
    why = "the paper steps by 5 degC, so that a lesion that forms above 55 first shows at 60"
    return [Row("temperature at which the lesion appears", 60.0, reached, "degC", 5.0, why)]


def displacement_rows(result: StepwiseResult, size: DoseSize | TabulatedSize) -> list[Row]:
    """Normalised displacement of a simulated protocol against the text."""
    label = "dose" if isinstance(size, DoseSize) else "table 3"
    temperatures = np.asarray(result.temperature)
    percent = 100.0 * np.asarray(result.displacement) / float(result.displacement[0])
    rows = []
    for temperature, stated in suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT.items():
        here = float(percent[int(np.argmin(np.abs(temperatures - temperature)))])
        above = (
            f"lesion sized by {label}; here the field is linear (the paper's has 128 harmonics), moduli are read as "
            "Young's, and layer thicknesses are ours"
        )
        why = "attenuation alone" if temperature < 60.0 else above
        quantity = f"displacement at {temperature:g} degC, lesion by {label}"
        rows.append(Row(quantity, stated, here, "percent of 35 degC", 1.0, why))
    return rows


def lesion_size_rows(result: StepwiseResult) -> list[Row]:
    """Lesion sizes from computed dose against table 3."""
    temperatures = np.asarray(result.temperature)
    rows = []
    for temperature, column in suomi2016.TABLE_3_LESION.items():
        step = int(np.argmin(np.abs(temperatures - temperature)))
        why = "240 min contour; the time course of the paper's heating is not stated"
        for name, printed, values in (
            ("length", column.length_mm, result.lesion_length),
            ("diameter", column.diameter_mm, result.lesion_diameter),
        ):
            here = 1e3 * float(values[step])
            rows.append(Row(f"lesion {name} at {temperature:g} degC", printed, here, "mm", 0.05, why))
    return rows
