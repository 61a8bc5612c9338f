"""What a diagnosis leaves, against every coordinate of the data, and the correction of no name where one is left."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from inverse.diagnosis import Diagnosis
from inverse.diagnosis.dma.problem import DmaProblem
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.figures.diagnosis import LABELS

_MOST_LABELS = 10
_COUNTED = "(in the file's order)"
_LEAST_DOSE = 1e-6
"""Drawn in place of less [min]."""


@dataclasses.dataclass(frozen=True)
class _Seen:
    """Data as they are drawn: coordinates of every row, and quantities of each with their unit.

    Attributes:
        coordinates: By their label; whether it is drawn logarithmically.
        series: Of each row; series are drawn in colours of their own.
        labels: Of the series.
        quantities: Label of each, and by what relative numbers are multiplied for its unit.
        weights: One over the standard deviation of each row and quantity, or 1.
    """

    coordinates: dict[str, tuple[Float[np.ndarray, " row"], bool]]
    series: Int[np.ndarray, " row"]
    labels: tuple[str, ...]
    quantities: tuple[tuple[str, float], ...]
    weights: Float[np.ndarray, "row quantity"]

    def relative(self, weighted: Float[np.ndarray, " n"], quantity: int) -> Float[np.ndarray, " row"]:
        """One quantity of what is weighted, in its unit; beliefs, which come after the data, are left out."""
        rows = weighted[: self.weights.size].reshape(self.weights.shape)
        return self.quantities[quantity][1] * rows[:, quantity] / self.weights[:, quantity]


def residuals_figure(found: Diagnosis) -> Figure:
    """Residuals of the model that the verdict ends with (points) and of the one without causes (rings).

    Where something without a name is left, a line is the free correction that is the most improbable by chance.

    Args:
        found: From `diagnose_dma` or `diagnose_hmi`.
    """
    seen = _of_hmi(found.problem) if isinstance(found.problem, HmiDiagnosisProblem) else _of_dma(found.problem)
    left = found.residuals if found.extended is None else found.extended.residuals
    correction = found.places[0] if found.verdict == "unexplained" and found.places else None
    rows, columns = len(seen.quantities), len(seen.coordinates)
    figure = Figure(figsize=(2.9 * columns + 0.6, 2.3 * rows + 0.9), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharey="row")
    for quantity, (words, _) in enumerate(seen.quantities):
        for axis, (label, (position, logarithmic)) in zip(panels[quantity], seen.coordinates.items(), strict=True):
            if found.extended is not None:
                _points(axis, seen, position, seen.relative(found.residuals, quantity), hollow=True)
            _points(axis, seen, position, seen.relative(left, quantity))
            if correction is not None:
                _line(axis, seen, position, seen.relative(correction.correction, quantity))
            axis.axhline(0.0, color="0.6", lw=0.6, zorder=0)
            axis.set_xscale("log" if logarithmic else "linear")
            if label.endswith(_COUNTED):
                axis.xaxis.set_major_locator(MaxNLocator(integer=True))
            axis.tick_params(labelsize=7)
            if quantity == rows - 1:
                axis.set_xlabel(label, fontsize=8)
        panels[quantity, 0].set_ylabel(words, fontsize=8)
    told = []
    if found.extended is not None:
        told.append(f"rings: without, points: with {' and '.join(one.cause.name for one in found.extended.extensions)}")
    if correction is not None:
        told.append(f"line: {correction.words}")
    if told:
        figure.suptitle("; ".join(told), fontsize=9)
    if len(seen.labels) <= _MOST_LABELS:
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right upper", fontsize=7, frameon=False)
    return figure


def _points(axis: Axes, seen: _Seen, position, values, *, hollow: bool = False) -> None:
    for number, label in enumerate(seen.labels):
        mine, colour = seen.series == number, f"C{number % 10}"
        if hollow:
            axis.plot(position[mine], values[mine], "o", ms=3.5, mfc="none", mec=colour, mew=0.4, alpha=0.6)
        else:
            axis.plot(position[mine], values[mine], "o", ms=2.2, color=colour, label=label)


def _line(axis: Axes, seen: _Seen, position, values) -> None:
    for number in range(len(seen.labels)):
        mine = np.flatnonzero(seen.series == number)
        mine = mine[np.argsort(position[mine], kind="stable")]
        if np.ptp(position[mine]) > 0.02 * np.ptp(position):  # else all of it would be upon one another
            axis.plot(position[mine], values[mine], "-", lw=0.9, color=f"C{number % 10}")


def _of_hmi(problem: HmiDiagnosisProblem) -> _Seen:
    rows = problem.rows
    coordinates = {"temperature at the focus [degC]": (rows.temperature, False), "time [s]": (rows.time, False)}
    if rows.dose is not None:
        coordinates["thermal dose [min at 43 degC]"] = (np.maximum(rows.dose, _LEAST_DOSE), True)
    coordinates[f"sonication {_COUNTED}"] = (1.0 + rows.sonication, False)
    quantities = (("measured − simulated [%]", 100.0),)
    return _Seen(coordinates, rows.sonication, rows.labels, quantities, problem.weights[:, None])


def _of_dma(problem: DmaProblem) -> _Seen:
    conditions = problem.conditions
    sweep = np.asarray(conditions.sweep)
    coordinates = {
        "frequency [Hz]": (np.asarray(conditions.angular_frequency) / (2.0 * np.pi), True),
        "temperature [degC]": (np.asarray(conditions.temperature), False),
        f"time [{'rows' if _counts_rows(problem) else 's'}]": (np.asarray(conditions.time), False),
    }
    samples = list(dict.fromkeys(one.sample for one in problem.sweeps))
    if len(samples) > 1:
        of_sweep = np.array([1.0 + samples.index(one.sample) for one in problem.sweeps])
        coordinates[f"sample {_COUNTED}"] = (of_sweep[sweep], False)
    quantities = tuple(zip(LABELS, (100.0, 1e3), strict=True))
    labels = tuple(one.label for one in problem.sweeps)
    return _Seen(coordinates, sweep, labels, quantities[: problem.weights.shape[1]], problem.weights)


def _counts_rows(problem: DmaProblem) -> bool:
    """Whether the file gives no time, as a note of the problem then says."""
    return any(note.startswith("The file gives no time") for note in problem.notes)
