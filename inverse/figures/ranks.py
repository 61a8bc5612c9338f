"""Figure of a simulation-based calibration: the ranks of true constants among draws of their posteriors."""

import math

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from arfjax.figures import COLOURS, new_figure, tidy
from inverse.sampling.rank_calibration import N_DRAWS, RankCalibration

_CLASSES = 10
_COLUMNS = 3
_WITHIN = 0.95


def draw_ranks(found: RankCalibration) -> Figure:
    """A histogram of ranks for each constant, with the band in which a uniform one has 95 % of its bars.

    In the corner: p of the chi-square test, and what intervals of 50 and 90 percent cover.
    """
    rows = math.ceil(len(found.names) / _COLUMNS)
    figure = new_figure(7.0, 1.45 * rows + 0.5)
    low, high = stats.binom.interval(_WITHIN, found.n_replicates, 1.0 / _CLASSES)
    middle, width = found.n_replicates / _CLASSES, (N_DRAWS + 1) / _CLASSES
    places = width * np.arange(_CLASSES)
    fifty, ninety = found.covered(0.5), found.covered(0.9)
    for index, (name, counts, p) in enumerate(zip(found.names, found.counts(_CLASSES), found.p_values(), strict=True)):
        axes = figure.add_subplot(rows, _COLUMNS, index + 1)
        axes.axhspan(low, high, color="0.88", linewidth=0.0)
        axes.axhline(middle, color="0.6", linewidth=0.8)
        axes.bar(places, counts, width=0.9 * width, align="edge", color=COLOURS[0])
        told = f"p {p:.2f}; {100 * fifty[index]:.0f}, {100 * ninety[index]:.0f} %"
        axes.text(0.98, 0.97, told, transform=axes.transAxes, ha="right", va="top", fontsize="x-small", color="0.35")
        axes.set_xlim(0, N_DRAWS + 1)
        axes.set_ylim(0, 1.3 * max(high, float(np.max(found.counts(_CLASSES)))))
        lowest = index >= len(found.names) - _COLUMNS
        tidy(
            axes,
            x="Rank of the true value" if lowest else "",
            y="" if index % _COLUMNS else "Data sets",
            title=name.replace("_", " "),
        )
    return figure
