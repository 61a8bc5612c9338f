"""Table 2: what its sums of squared errors can mean, whether its rows are optima, and whether M_0 is determined.

The measured curve is not published as numbers. The fractional row stands for it, which by the table lies within 0.002
to 0.014 of it (sum of squares of relative errors).
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from arfjax import suomi2016
from inverse.reproduction.moduli import modulus_magnitude
from inverse.reproduction.row import Row

SECTION = "Zener table"
NOISE = 0.02
"""Relative error of a modulus, for what M_0 could be known to (assumed; ours)."""

POINTS_A_DECADE = 4
_SAME_FREQUENCY = 0.08  # of a frequency; 31.6 and 56 stand for 31.62 and 56.23, and 0.6 for 0.56


def fitted_frequencies(row: suomi2016.ZenerRow) -> Float[np.ndarray, " n"]:
    """Frequencies [Hz] of a row's fit: four points a decade, which its ends (17.8, 31.6, 56, 100 Hz) lie on."""
    low, high = row.lowest_frequency_hz, row.highest_frequency_hz
    grid = 10.0 ** (np.arange(-1 * POINTS_A_DECADE, 3 * POINTS_A_DECADE) / POINTS_A_DECADE)
    return grid[(grid > low * (1.0 - _SAME_FREQUENCY)) & (grid < high * (1.0 + _SAME_FREQUENCY))]


def sum_of_squares(
    row: suomi2016.ZenerRow, target: suomi2016.ZenerRow, frequency: Float[np.ndarray, " n"], *, relative: bool = True
) -> float:
    """Sum of squared errors of a row's magnitude against another's [1, or kPa^2 if not relative]."""
    model, measured = (modulus_magnitude(each, frequency) for each in (row, target))
    errors = model / measured - 1.0 if relative else 1e-3 * (model - measured)
    return float(np.sum(errors**2))


class Refit(NamedTuple):
    """A conventional row fitted anew to its fractional one."""

    unrelaxed_modulus_kpa: float
    relaxed_modulus_pa: float
    relaxation_time: float
    sum_of_squares: float


def refit(temperature: float, *, frees_relaxed_modulus: bool) -> Refit:
    """The conventional solid that is nearest to the fractional row at a temperature [degC], by relative errors.

    Args:
        temperature: One of table 2.
        frees_relaxed_modulus: Whether M_0 is fitted too; otherwise it stays the table's.
    """
    printed, target = suomi2016.TABLE_2_ZENER[temperature], suomi2016.TABLE_2_FRACTIONAL_ZENER[temperature]
    frequency = fitted_frequencies(printed)
    measured = modulus_magnitude(target, frequency)
    omega = 2.0 * math.pi * frequency

    def relative_errors(logarithms: np.ndarray) -> np.ndarray:
        unrelaxed, time, *relaxed = np.exp(logarithms)
        squared = (omega * time) ** 2
        held = relaxed[0] if relaxed else printed.relaxed_modulus_pa
        return np.sqrt((held**2 + squared * unrelaxed**2) / (1.0 + squared)) / measured - 1.0

    start = [math.log(1e3 * printed.unrelaxed_modulus_kpa), math.log(printed.relaxation_time)]
    # From 8 Pa the slope in M_0 is nil, and a descent would stay there.
    starts = [[*start, math.log(share * measured[0])] for share in (0.3, 0.9)] if frees_relaxed_modulus else [start]
    found = min((least_squares(relative_errors, each, xtol=1e-14, ftol=1e-14) for each in starts), key=lambda f: f.cost)
    unrelaxed, time, *relaxed = np.exp(found.x)
    return Refit(1e-3 * unrelaxed, relaxed[0] if relaxed else printed.relaxed_modulus_pa, time, 2.0 * found.cost)


def relaxed_modulus_uncertainty(row: suomi2016.ZenerRow, *, noise: float = NOISE, phase: bool = False) -> float:
    """Standard deviation of ln M_0 that a row's fit leaves, by the Fisher matrix.

    Args:
        row: Of table 2.
        noise: Relative error of each magnitude (and in radians of each phase).
        phase: Whether the phase is fitted too, not only the magnitude as in the paper.

    It is the bound for unbiased estimates and small errors: far above 1 it says "not determined", and no more.
    """
    relaxed, unrelaxed = row.relaxed_modulus_pa, 1e3 * row.unrelaxed_modulus_kpa
    base = 2j * math.pi * fitted_frequencies(row) * row.relaxation_time
    z = base**row.fractional_order
    modulus = (relaxed + unrelaxed * z) / (1.0 + z)
    of_power = (unrelaxed - relaxed) * z / (1.0 + z) ** 2
    # Derivatives of M to ln M_inf, ln tau, the order if it is fitted, and ln M_0.
    of_constants = [unrelaxed * z / (1.0 + z), row.fractional_order * of_power]
    of_constants += [of_power * np.log(base)] if row.fractional_order != 1.0 else []
    relative = np.stack([*of_constants, relaxed / (1.0 + z)], axis=1) / modulus[:, None] / noise
    slopes = np.concatenate([relative.real, relative.imag]) if phase else relative.real
    # A QR factor keeps what a squared condition number would lose.
    triangle = np.asarray(np.linalg.qr(slopes, mode="r"))
    return float(1.0 / abs(triangle[-1, -1]))


def zener_rows() -> list[Row]:
    """The table's own errors, its rows fitted anew, and what is known of M_0."""
    return [*_error_rows(), *_refit_rows(), *_ratio_rows(), *_uncertainty_rows()]


def _error_rows() -> list[Row]:
    rows = []
    for temperature, printed in suomi2016.TABLE_2_ZENER.items():
        target = suomi2016.TABLE_2_FRACTIONAL_ZENER[temperature]
        frequency = fitted_frequencies(printed)
        here = sum_of_squares(printed, target, frequency)
        absolute = sum_of_squares(printed, target, frequency, relative=False)
        why = (
            f"relative errors against the fractional row at {len(frequency)} points, four a decade; in kPa^2 it would "
            f"be {absolute:.2g}"
        )
        # The fractional curve is not the measured one: it has an error of its own, of either sign beside this one.
        own = target.sum_of_squared_errors
        tolerance = own + 2.0 * math.sqrt(own * printed.sum_of_squared_errors) + 0.0005
        rows.append(
            Row(SECTION, f"SSE of Z {temperature:g} degC", printed.sum_of_squared_errors, here, "1", tolerance, why)
        )
    return rows


def _refit_rows() -> list[Row]:
    rows = []
    for temperature, printed in suomi2016.TABLE_2_ZENER.items():
        if temperature < 50.0:
            continue
        for free in (False, True):
            fit = refit(temperature, frees_relaxed_modulus=free)
            held = "M_0 fitted too" if free else "M_0 held at the table's"
            why = f"{held}: M_0 = {fit.relaxed_modulus_pa:.4g} Pa, SSE {fit.sum_of_squares:.3f}, relative errors"
            label = f"of Z {temperature:g} degC, {held}"
            stated = printed.unrelaxed_modulus_kpa
            rows.append(Row(SECTION, f"M_inf {label}", stated, fit.unrelaxed_modulus_kpa, "kPa", 0.05, why))
            rows.append(Row(SECTION, f"tau {label}", printed.relaxation_time, fit.relaxation_time, "s", 0.0005, why))
        rows.append(
            Row(
                SECTION,
                f"M_0 of Z {temperature:g} degC, M_0 fitted too",
                printed.relaxed_modulus_pa,
                fit.relaxed_modulus_pa,
                "Pa",
                0.05,
                f"SSE falls from {printed.sum_of_squared_errors:g} to {fit.sum_of_squares:.3f}: 8 Pa is no optimum",
            )
        )
    return rows


def error_ratios(*, frees_relaxed_modulus: bool = False) -> dict[float, float]:
    """SSE of the conventional over that of the fractional row, by temperature [degC], where the latter is not 0.000.

    Args:
        frees_relaxed_modulus: Whether the conventional SSE is that of `refit` with M_0 free.
    """
    ratios = {}
    for temperature, printed in suomi2016.TABLE_2_ZENER.items():
        own = suomi2016.TABLE_2_FRACTIONAL_ZENER[temperature].sum_of_squared_errors
        if own > 0.0:
            freed = frees_relaxed_modulus and temperature >= 50.0
            error = refit(temperature, frees_relaxed_modulus=True).sum_of_squares if freed else None
            ratios[temperature] = (printed.sum_of_squared_errors if error is None else error) / own
    return ratios


def _ratio_rows() -> list[Row]:
    printed, freed = error_ratios(), error_ratios(frees_relaxed_modulus=True)
    hot = [ratio for temperature, ratio in freed.items() if temperature >= 50.0]
    why = "'two magnitudes lower for all temperatures'; SSE of table 2, and 0.000 at 21 degC left out"
    fitted = "'two magnitudes lower'; hot rows with M_0 fitted too"
    return [
        Row(SECTION, "smallest SSE of Z over FZ", 100.0, min(printed.values()), "1", 50.0, why),
        Row(SECTION, "largest SSE of Z over FZ", 100.0, max(printed.values()), "1", 50.0, why),
        Row(SECTION, "smallest SSE of Z over FZ, M_0 fitted too", 100.0, min(hot), "1", 50.0, fitted),
        Row(SECTION, "largest SSE of Z over FZ, M_0 fitted too", 100.0, max(hot), "1", 50.0, fitted),
    ]


def _uncertainty_rows() -> list[Row]:
    rows = []
    for name, table in (("Z", suomi2016.TABLE_2_ZENER), ("FZ", suomi2016.TABLE_2_FRACTIONAL_ZENER)):
        for temperature, row in table.items():
            here, with_phase = relaxed_modulus_uncertainty(row), relaxed_modulus_uncertainty(row, phase=True)
            why = (
                f"Fisher matrix of |M| at the fitted frequencies, {100.0 * NOISE:g} percent noise; far above 1: not "
                f"determined. With the phase as well: {with_phase:.2g}"
            )
            rows.append(
                Row(SECTION, f"standard deviation of ln M_0, {name} {temperature:g} degC", None, here, "1", 0.0, why)
            )
    return rows
