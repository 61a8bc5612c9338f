"""Table 3: where the constants of the finite-element model come from."""

import math

import numpy as np

from arfjax import suomi2016
from inverse.reproduction.row import Row

SECTION = "table of the finite-element model"
PUSH = 0.5e-3
"""Duration of the paper's push [s]."""


def regressions() -> dict[float, tuple[float, float]]:
    """Stiffness [kPa] and relaxation time [s] of the lesion as regressions through all rows of table 2.

    By temperature [degC]: M_inf log-linear, tau linear in temperature.
    """
    temperatures = np.asarray(sorted(suomi2016.TABLE_2_ZENER))
    table = [suomi2016.TABLE_2_ZENER[float(t)] for t in temperatures]
    stiffness = np.polyfit(temperatures, np.log([row.unrelaxed_modulus_kpa for row in table]), 1)
    relaxation = np.polyfit(temperatures, [row.relaxation_time for row in table], 1)
    return {
        temperature: (float(np.exp(np.polyval(stiffness, temperature))), float(np.polyval(relaxation, temperature)))
        for temperature in suomi2016.TABLE_3_LESION
    }


def mean_relaxed_modulus() -> float:
    """Mean M_0 [Pa] of the conventional rows of table 2."""
    return float(np.mean([row.relaxed_modulus_pa for row in suomi2016.TABLE_2_ZENER.values()]))


def relaxed_share(relaxation_time: float, duration: float = PUSH) -> float:
    """Share of a Zener solid's branch that has relaxed by the end of a push."""
    return -math.expm1(-duration / relaxation_time)


def lesion_constant_rows() -> list[Row]:
    """Table 3 as regressions through the hot and cold rows of table 2."""
    rows, lines = [], regressions()
    for temperature, column in suomi2016.TABLE_3_LESION.items():
        stiffness, relaxation = lines[temperature]
        why = "log-linear regression of M_inf over all rows of table 2: M_inf is printed as M_inf - M_0"
        quantity = f"lesion M_inf - M_0 at {temperature:g} degC"
        rows.append(Row(SECTION, quantity, column.branch_modulus_kpa, stiffness, "kPa", 0.25, why))
        why = "linear regression of tau over all rows of table 2"
        quantity = f"lesion relaxation time at {temperature:g} degC"
        rows.append(Row(SECTION, quantity, column.relaxation_time, relaxation, "s", 0.0015, why))
    return rows + _oddities()


def _oddities() -> list[Row]:
    measured, tabulated = suomi2016.TABLE_2_ZENER[65.0], suomi2016.TABLE_3_LESION[65.0]
    liver = suomi2016.TABLE_2_ZENER[35.0]
    relaxed = liver.unrelaxed_modulus_kpa - suomi2016.TABLE_3_LIVER_BRANCH_MODULUS_KPA
    mean = mean_relaxed_modulus()
    slowest = relaxed_share(min(column.relaxation_time for column in suomi2016.TABLE_3_LESION.values()))
    return [
        Row(
            SECTION,
            "liver M_0 (printed in Pa)",
            suomi2016.TABLE_3_LIVER_RELAXED_MODULUS_AS_PRINTED_PA,
            1e3 * relaxed,
            "Pa",
            0.05,
            "M_inf of table 2 at 35 degC less M_inf - M_0 of table 3: 1.1 kPa is meant",
        ),
        Row(
            SECTION,
            "lesion stiffness at 65 degC, the fit at that temperature",
            tabulated.branch_modulus_kpa,
            measured.unrelaxed_modulus_kpa,
            "kPa",
            0.05,
            f"the regression lies {100.0 * (1.0 - tabulated.branch_modulus_kpa / measured.unrelaxed_modulus_kpa):.0f} "
            "percent below the row that was fitted at 65 degC",
        ),
        Row(
            SECTION,
            "mean M_0 of table 2 (second study)",
            suomi2016.SECOND_STUDY_RELAXED_MODULUS_PA,
            mean,
            "Pa",
            0.5,
            "'8.0 Pa, the average values of liver tissue in the experiments'",
        ),
        Row(
            SECTION,
            "share of the lesion's branch that relaxes in a push",
            None,
            100.0 * slowest,
            "percent",
            0.0,
            "M_0 and tau do not matter because 0.5 ms is far below tau, not because M_inf overpowers them",
        ),
    ]
