"""Differences and averages that the paper states of its own numbers, counted again."""

import numpy as np

from arfjax import suomi2016
from inverse.datasets.hmi import HmiData
from inverse.reproduction.row import Row

SECTION = "counts"


def falls_and_rises(measured: HmiData) -> tuple[list[float], list[float], list[float]]:
    """Fall from the peak to the last value, rise from the lowest before, and dip to that, by sonication [percent]."""
    falls, rises, dips = [], [], []
    for label in measured.labels:
        values = measured.displacement[measured.rows_of(label)]
        peak = int(np.argmax(values))
        lowest = float(np.min(values[: peak + 1]))
        falls.append(100.0 * (1.0 - float(values[-1]) / float(values[peak])))
        rises.append(100.0 * (float(values[peak]) / lowest - 1.0))
        dips.append(100.0 - lowest)
    return falls, rises, dips


def count_rows(measured: HmiData) -> list[Row]:
    """The discussion's ranges against the values that the results state."""
    falls, rises, dips = falls_and_rises(measured)
    before, after = suomi2016.SECOND_STUDY_UNABLATED_UM, suomi2016.SECOND_STUDY_ABLATED_UM
    (low_fall, high_fall), (low_rise, high_rise) = (
        suomi2016.TEXT_MEASURED_FALL_PERCENT,
        suomi2016.TEXT_MEASURED_RISE_PERCENT,
    )
    stated = "from the values that the results' text states, sonication by sonication"
    decrease = 100.0 * (1.0 - after / before)
    return [
        Row(SECTION, "smallest fall from the peak, measured", low_fall, min(falls), "percent", 0.5, stated),
        Row(SECTION, "largest fall from the peak, measured", high_fall, max(falls), "percent", 0.5, stated),
        Row(SECTION, "smallest rise to the peak, measured", low_rise, min(rises), "percent", 0.5, stated),
        Row(SECTION, "largest rise to the peak, measured", high_rise, max(rises), "percent", 0.5, stated),
        Row(
            SECTION,
            "average dip before the rise, measured",
            suomi2016.TEXT_MEASURED_DIP_PERCENT,
            float(np.mean(dips)),
            "percent",
            0.5,
            stated,
        ),
        Row(
            SECTION,
            "decrease by ablation, second study",
            suomi2016.SECOND_STUDY_DECREASE_PERCENT,
            decrease,
            "percent",
            0.5,
            "from 9 to 6 um",
        ),
    ]
