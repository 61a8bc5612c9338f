"""Harmonic motion imaging in an inference: curves of displacement against temperature or time.

Curves in percent of a reading of their own carry that reading's error in every point: see `inverse.inference.noise`.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from inverse.datasets.hmi import HmiData
from inverse.inference.noise import NoiseModel, Series
from inverse.inference.problem import Measurement

FIRST_RELATIVE_DEVIATION = 0.05
"""Scatter of a displacement as a fraction of it from which an estimate starts."""

SAME_TEMPERATURE_K = 1e-6


def hmi_measurement(
    data: HmiData,
    predict: Callable[[Any], Float[Array, " n"]],
    *,
    reference_temperature: float,
    noise: NoiseModel | None = None,
    name: str = "hmi",
) -> Measurement:
    """HMI data as a measurement of a model.

    Rows that were measured at the reference temperature itself are 100 percent by construction. They say nothing of
    the model and are left out; their error is in all other rows of their sonication. Of a curve over time, whose
    temperatures are not known, that is the first row of exactly 100 percent: predictions are then in percent of the
    one for that row, which is what the data were divided by.

    Args:
        data: What was measured.
        predict: Displacement for every row of the data, in percent or metres as they are.
        reference_temperature: At which it is 100 percent [degC].
        noise: How the data scatter; if not given, by the deviations of the file or else by a fraction of the
            displacement. The reference reading of data in percent then scatters as the others do.
        name: Of the measurement.
    """
    rows = used_rows(data, reference_temperature)
    measured = np.asarray(data.displacement)[rows]
    divisor = _divisors(data)[rows]

    def of_rows(model: Any) -> Float[Array, " n"]:
        found = predict(model)
        scale = jnp.where(jnp.asarray(divisor) >= 0, 100.0 / found[jnp.asarray(divisor)], 1.0)
        return found[jnp.asarray(rows)] * scale

    return Measurement(
        name,
        of_rows,
        jnp.asarray(measured),
        _along_sonications(data, rows),
        noise_of(data, rows) if noise is None else noise,
        "percent" if data.in_percent else "m",
        is_long=True,
    )


def used_rows(data: HmiData, reference_temperature: float) -> Int[np.ndarray, " n"]:
    """Rows of the file that say something of the model, in the order of the measurement's data."""
    if not data.in_percent:
        return np.arange(len(data.displacement))
    if data.temperature is None:
        divisors = _divisors(data)
        return np.flatnonzero(divisors != np.arange(len(divisors)))
    at_reference = np.abs(np.asarray(data.temperature) - reference_temperature) < SAME_TEMPERATURE_K
    return np.flatnonzero(~(at_reference & (np.asarray(data.displacement) == 100.0)))


def _divisors(data: HmiData) -> Int[np.ndarray, " row"]:
    """For each row of curves over time the row of its sonication that it was divided by; -1 where the file has none."""
    found = np.full(len(data.displacement), -1)
    if not data.in_percent or data.temperature is not None or data.time is None:
        return found
    for label in data.labels:
        rows = np.asarray(data.rows_of(label))
        rows = rows[np.argsort(np.asarray(data.time)[rows], kind="stable")]
        whole = rows[np.asarray(data.displacement)[rows] == 100.0]
        if len(whole):
            found[rows] = whole[0]
    return found


def noise_of(data: HmiData, rows: Int[np.ndarray, " n"]) -> NoiseModel:
    """How those rows of a file scatter, by what it says of that."""
    if data.sd is None:
        return NoiseModel(relative=FIRST_RELATIVE_DEVIATION, tie_reference=data.in_percent)
    deviations = np.asarray(data.sd)[rows]
    if not data.in_percent:
        return NoiseModel(known=jnp.asarray(deviations))
    # The file says nothing of the reading that it divided by: it is taken to scatter as the others do.
    usual = float(np.median(deviations / np.asarray(data.displacement)[rows]))
    return NoiseModel(known=jnp.asarray(deviations), reference_relative=usual)


def _along_sonications(data: HmiData, rows: Int[np.ndarray, " n"]) -> Series:
    labels = list(dict.fromkeys(data.sonication))
    group = np.array([labels.index(data.sonication[row]) for row in rows])
    given = data.time if data.time is not None else data.temperature
    assert given is not None  # the reader asks for time or temperature
    position = np.asarray(given)[rows]
    previous, gap = np.full(len(rows), -1), np.ones(len(rows))
    for number in range(len(labels)):
        members = np.flatnonzero(group == number)
        members = members[np.argsort(position[members], kind="stable")]
        previous[members[1:]] = members[:-1]
        gap[members[1:]] = np.diff(position[members])
    follows = previous >= 0
    usual = float(np.median(gap[follows])) if np.any(follows) and np.median(gap[follows]) > 0.0 else 1.0
    gap = np.where(follows, np.maximum(gap / usual, 1e-3), 1.0)
    # Deviations may change with the displacement, not with time: the coordinate says nothing.
    return Series(np.ones(len(rows)), previous, gap, group, len(labels))
