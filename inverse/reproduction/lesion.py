"""Lesions from computed dose against the paper's table of sizes."""

from collections.abc import Mapping

from arfjax import suomi2016
from arfjax.thermal.lesion import LesionSize
from inverse.reproduction.bench import Bench
from inverse.reproduction.row import Row

SECTION = "lesion"


def sizes_by_dose(bench: Bench, *, nonlinear: bool = False) -> dict[float, LesionSize]:
    """Lesions by the contour of 240 min when the focus reaches each temperature of table 3 [degC].

    Args:
        bench: The experiment.
        nonlinear: Whether the sonication is that of a field with harmonics.
    """
    heating = bench.heating_nonlinear if nonlinear else bench.heating
    return {each: bench.size("dose", each, heating=heating) for each in suomi2016.TABLE_3_LESION}


def lesion_size_rows(sizes: Mapping[float, LesionSize], sizes_nonlinear: Mapping[float, LesionSize]) -> list[Row]:
    """Length and diameter of both simulated sonications against table 3, by temperature [degC]."""
    rows = []
    for temperature, column in suomi2016.TABLE_3_LESION.items():
        for name, printed in (("length", column.length_mm), ("diameter", column.diameter_mm)):
            here, with_harmonics = (1e3 * float(getattr(each[temperature], name)) for each in (sizes, sizes_nonlinear))
            why = (
                f"240 min contour, linear sound ({with_harmonics:.2f} mm with harmonics), {here / printed:.1f} times "
                "as large; the paper states neither power nor course of the heating"
            )
            rows.append(Row(SECTION, f"lesion {name} at {temperature:g} degC", printed, here, "mm", 0.05, why))
    return rows
