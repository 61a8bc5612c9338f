"""A diagnosis of curves of displacement in one figure: data and simulation, what is left, and the causes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from inverse.diagnosis import Diagnosis
from inverse.diagnosis.hmi.courses import HmiRows
from inverse.figures.diagnosis import draw_causes, whole_column

_MARKERS = "os^Dv<>P"
_ONE_SIDED = "a sonication may lie on one side: its factor is\nthe likeliest in noise that its readings share"


def hmi_diagnosis_figure(found: Diagnosis) -> Figure:
    """Displacement and residuals over temperature without and with the extension, and the statistic of every cause.

    Args:
        found: From `diagnose_hmi`.
    """
    problem = found.problem
    stages = [("the fitted simulation", found.residuals[: len(problem.rows)])]
    if found.extended is not None:
        names = " and ".join(extension.cause.name for extension in found.extended.extensions)
        stages.append((f"with {names}", found.extended.residuals[: len(problem.rows)]))
    columns = len(stages) + (1 if found.causes else 0)
    figure = Figure(figsize=(3.3 * columns + 0.4, 5.2), layout="constrained")
    axes = figure.subplots(2, columns, squeeze=False, height_ratios=[1.4, 1.0])
    left = [100.0 * residuals / problem.weights for _, residuals in stages]
    largest = 1.15 * max(float(np.max(np.abs(one))) for one in left)
    for column, ((title, _), percent) in enumerate(zip(stages, left, strict=True)):
        _draw_curves(axes[0, column], problem.rows, percent)
        _draw_left(axes[1, column], problem.rows, percent)
        axes[0, column].set_title(title, fontsize=9)
        axes[1, column].set_ylim(-largest, largest)
        axes[1, column].set_xlabel("temperature at the focus [degC]", fontsize=8)
    # Both with the same scale, so that what the extension changes is what one sees.
    bottoms, tops = zip(*(axis.get_ylim() for axis in axes[0, : len(stages)]), strict=True)
    for axis in axes[0, : len(stages)]:
        axis.set_ylim(min(bottoms), max(tops))
    axes[0, 0].set_ylabel("displacement [%]\n(100: simulated, coldest)", fontsize=8)
    axes[1, 0].set_ylabel("measured −\nsimulated [%]", fontsize=8)
    axes[0, 0].legend(fontsize=7, frameon=False, title="sonication", title_fontsize=7)
    if found.causes:
        draw_causes(whole_column(figure, axes[:, -1]), found)
    return figure


def _draw_curves(axis: Axes, rows: HmiRows, percent: np.ndarray) -> None:
    """Points as measured, lines as simulated; each sonication relative to its coldest simulated reading."""
    for number, label in enumerate(rows.labels):
        mine = np.flatnonzero(rows.sonication == number)
        mine = mine[np.argsort(rows.temperature[mine])]
        simulated = rows.log_displacement[mine] - 0.01 * percent[mine]
        scale = simulated[0]
        colour = f"C{number % 10}"
        axis.plot(rows.temperature[mine], 100.0 * np.exp(simulated - scale), "-", lw=1.0, color=colour)
        measured = 100.0 * np.exp(rows.log_displacement[mine] - scale)
        axis.plot(rows.temperature[mine], measured, _MARKERS[number % 8], ms=3.0, color=colour, label=label)


def _draw_left(axis: Axes, rows: HmiRows, percent: np.ndarray) -> None:
    one_sided = False
    for number in range(len(rows.labels)):
        mine = np.flatnonzero(rows.sonication == number)
        mine = mine[np.argsort(rows.temperature[mine])]
        axis.plot(
            rows.temperature[mine], percent[mine], f"-{_MARKERS[number % 8]}", ms=2.5, lw=0.7, color=f"C{number % 10}"
        )
        # A single one has nothing left: its factor takes it all.
        one_sided |= len(mine) > 1 and bool(np.all(percent[mine] > 0.0) or np.all(percent[mine] < 0.0))
    axis.axhline(0.0, color="0.6", lw=0.6, zorder=0)
    if one_sided:
        axis.text(0.03, 0.04, _ONE_SIDED, transform=axis.transAxes, fontsize=6, color="0.35")
