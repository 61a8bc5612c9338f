"""Corrections of no name to curves of displacement: they tell where a model is wrong when no cause explains it."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from inverse.diagnosis.free_forms import COARSE, LENGTHS, Place, bumps, process
from inverse.diagnosis.hmi.courses import HmiRows
from inverse.diagnosis.screening import Alternative

_SAME = 0.25
"""Difference of temperature below which readings of several sonications count as taken at the same [K]."""


def hmi_free_forms(rows: HmiRows, log_predicted: Float[np.ndarray, " row"]) -> tuple[list[Alternative], list[Place]]:
    """Free forms, one for each place in which a simulated curve can be wrong.

    The tissue: along temperature in all sonications alike. The procedure: along time. The
    instrument: along the displacement itself. One sonication in its own way, or all in theirs; and readings at one
    temperature.

    Args:
        rows: What was measured.
        log_predicted: Logarithm of what the model predicts for each.
    """
    found, places = [], []

    def add(name: str, words: str, directions: Float[np.ndarray, "n q"]) -> None:
        found.append(Alternative(name, directions))
        places.append(Place(name, words))

    temperature, sonication, count = rows.temperature, rows.sonication, len(rows.labels)
    for length in LENGTHS:
        words = "in all sonications alike, smoothly along temperature"
        add(f"smooth-{length:g}", words, process(temperature, length))
    add("time", "following the time since the start", process(rows.time, COARSE))
    relative = log_predicted - _mean_by(log_predicted, sonication)
    add("displacement", "following the displacement", process(relative, COARSE))
    if count > 1:
        own = [process(temperature, COARSE) * (sonication == one)[:, None] for one in range(count)]
        for one, label in enumerate(rows.labels):
            add(f"sonication-{label}", f"in sonication {label} alone, smoothly along temperature", own[one])
        add("each", "in each sonication in its own way, smoothly along temperature", np.concatenate(own, axis=1))
    for value in _shared(temperature, sonication):
        at = _taken_at(temperature, value).astype(float)
        add(f"at-{value:.4g}", f"at {value:.3g} degC in all sonications", at[:, None])
    return found, places


def hmi_local_forms(rows: HmiRows) -> list[Alternative]:
    """Corrections at one temperature in all sonications, wider than a reading: for the odds of no name alone.

    Args:
        rows: What was measured.
    """
    return [Alternative(f"local-{number}", bump[:, None]) for number, bump in enumerate(bumps(rows.temperature))]


def of_all_data(forms: Sequence[Alternative], weights: Float[np.ndarray, " row"], count: int) -> list[Alternative]:
    """Corrections of weighted readings; of the data after them, which are what is believed of constants, none.

    Args:
        forms: Of readings.
        weights: Of these.
        count: Of all data.
    """
    after = [(0, count - len(weights)), (0, 0)]
    return [dataclasses.replace(one, directions=np.pad(weights[:, None] * one.directions, after)) for one in forms]


def _mean_by(values, keys):
    means = np.array([np.mean(values[keys == key]) for key in range(int(keys.max()) + 1)])
    return means[keys]


def _shared(temperature: Float[np.ndarray, " row"], sonication) -> list[float]:
    """Temperatures at which two sonications or more were looked at."""
    begins: list[float] = []
    for one in np.unique(temperature).tolist():
        # Each group begins where the last one ends, however close readings are.
        if not begins or one - begins[-1] >= _SAME:
            begins.append(one)
    return [one for one in begins if len(np.unique(sonication[_taken_at(temperature, one)])) > 1]


def _taken_at(temperature: Float[np.ndarray, " row"], begin: float) -> Bool[np.ndarray, " row"]:
    return (temperature >= begin) & (temperature - begin < _SAME)
