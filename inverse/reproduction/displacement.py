"""Normalised displacement of the simulated protocol against the paper's text."""

import numpy as np

from arfjax import StepwiseResult, suomi2016
from inverse.reproduction.row import Row

SECTION = "displacement"


def percent_of_first(result: StepwiseResult) -> dict[float, float]:
    """Displacement in percent of that at the first temperature, by temperature [degC]."""
    displacement = np.asarray(result.displacement)
    percent = 100.0 * displacement / displacement[0]
    return dict(zip(np.asarray(result.temperature).tolist(), percent.tolist(), strict=True))


def displacement_rows(result: StepwiseResult, lesion: str) -> list[Row]:
    """What the text states of its simulated curve, with the default reading of everything but the lesion.

    Args:
        result: From `Bench.run`.
        lesion: Where its size comes from, in words.
    """
    percent = percent_of_first(result)
    rows = []
    for temperature, stated in suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT.items():
        why = (
            "attenuation alone"
            if temperature < 60.0
            else "linear field of the bowl, Young's moduli, linear edge, layers ours: readings.csv has others"
        )
        quantity = f"displacement at {temperature:g} degC, lesion by {lesion}"
        rows.append(Row(SECTION, quantity, stated, percent[temperature], "percent of 35 degC", 1.0, why))
    return rows
