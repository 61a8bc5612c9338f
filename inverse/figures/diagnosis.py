"""A diagnosis in one figure: residuals before and after, and the causes by their statistic."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from inverse.diagnosis import CauseReport, Diagnosis

_MOST_CAUSES = 12
_FACTORS = (100.0, 1e3)
LABELS = ("magnitude,\nmeasured − model [%]", "phase,\nmeasured − model [mrad]")
"""Of axes with what a model leaves of magnitude and phase."""


def diagnosis_figure(found: Diagnosis) -> Figure:
    """Relative residuals of magnitude and phase over frequency, and the statistic of every cause.

    Args:
        found: From `diagnose_dma`.
    """
    problem = found.problem
    coordinates = problem.weights.shape[1]
    stages = [("the fitted model", found.residuals)]
    if found.extended is not None:
        names = " and ".join(extension.cause.name for extension in found.extended.extensions)
        stages.append((f"with {names}", found.extended.residuals))
    wide = 3.2 * len(stages) + (3.4 if found.causes else 0.0)
    figure = Figure(figsize=(wide + 1.2, 2.4 * coordinates + 0.9), layout="constrained")
    widths = [1.0] * len(stages) + ([1.0] if found.causes else [])
    axes = figure.subplots(coordinates, len(widths), squeeze=False, width_ratios=widths)
    temperatures = np.array([sweep.temperature_c for sweep in problem.sweeps])
    scale = Normalize(temperatures.min() - 1.0, temperatures.max() + 1.0)
    limits = _limits(problem, stages[0][1])
    for column, (title, residuals) in enumerate(stages):
        shaped = (residuals / problem.weights.ravel()).reshape(problem.weights.shape)
        for coordinate in range(coordinates):
            axis = axes[coordinate, column]
            _draw_residuals(axis, problem, _FACTORS[coordinate] * shaped[:, coordinate], scale)
            axis.set_ylim(-limits[coordinate], limits[coordinate])
            if column == 0:
                axis.set_ylabel(LABELS[coordinate])
        axes[0, column].set_title(title, fontsize=9)
        axes[-1, column].set_xlabel("frequency [Hz]")
    bar = figure.colorbar(ScalarMappable(scale, "viridis"), ax=axes[:, : len(stages)], pad=0.01, aspect=35)
    bar.set_label("temperature of the sweep [degC]", fontsize=8)
    if found.causes:
        draw_causes(whole_column(figure, axes[:, -1]), found)
    return figure


def whole_column(figure: Figure, column: np.ndarray) -> Axes:
    """One panel in place of all panels of a column."""
    spec = column[0].get_subplotspec()
    for axis in column:
        axis.remove()
    return figure.add_subplot(spec.get_gridspec()[:, spec.colspan.start])


def _limits(problem, residuals) -> list[float]:
    shaped = np.abs((residuals / problem.weights.ravel()).reshape(problem.weights.shape))
    return [
        1.15 * factor * float(shaped[:, c].max())
        for c, factor in zip(range(shaped.shape[1]), (100.0, 1e3), strict=False)
    ]


def _draw_residuals(axis: Axes, problem, values, scale) -> None:
    colours = colormaps["viridis"]
    frequency = np.asarray(problem.conditions.angular_frequency) / (2.0 * np.pi)
    sweep = np.asarray(problem.conditions.sweep)
    for index, one in enumerate(problem.sweeps):
        rows = sweep == index
        axis.semilogx(frequency[rows], values[rows], "-o", ms=2.5, lw=0.7, color=colours(scale(one.temperature_c)))
    axis.axhline(0.0, color="0.6", lw=0.6, zorder=0)


def draw_causes(axis: Axes, found: Diagnosis) -> None:
    """The statistic of every cause, the likeliest on top, coloured by what is said of it."""
    shown = found.causes[:_MOST_CAUSES][::-1]
    colours = {"named": "C3", "confusable": "C1", "possible": "C4", "ruled out": "0.45"}
    for row, one in enumerate(shown):
        axis.barh(row, _evidence(one), color=colours.get(one.status, "0.8"), height=0.65)
    axis.set_yticks(range(len(shown)), [one.cause.name for one in shown], fontsize=7)
    axis.set_xlabel("|t| of the strength")
    present = [status for status in colours if any(one.status == status for one in shown)]
    labels = {"confusable": "cannot be told apart"}
    handles = [Patch(color=colours[status], label=labels.get(status, status)) for status in present]
    handles += [Patch(color="0.8", label="not needed")]
    axis.legend(handles=handles, fontsize=7, frameon=False, loc="lower right")
    axis.margins(y=0.01)


def _evidence(one: CauseReport) -> float:
    """Size of t; 0 where a strength that cannot be negative came out so."""
    return max(one.statistic, 0.0) if one.cause.sign > 0 else abs(one.statistic)
