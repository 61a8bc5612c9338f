"""What to measure next, in one figure: what each measurement tells, and where a single reading tells most."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from inverse.design import Design
from inverse.design.dma_information import Information

_DECADES = 3.0
"""Of information that are shown."""
_NOW = "nothing more"


def design_figure(design: Design) -> Figure:
    """Chance that the right one of two causes looks likelier, by measurement; of a DMA, information of one reading.

    Args:
        design: From `design_dma` or `design_hmi`.
    """
    columns = 1 if design.information is None else 2
    height = 1.1 + 0.28 * (1 + len(design.rated))
    figure = Figure(figsize=(4.6 * columns + 0.6, max(height, 3.2)), layout="constrained")
    axes = figure.subplots(1, columns, squeeze=False)[0]
    _draw_rated(axes[0], design)
    if design.information is not None:
        _draw_information(axes[1], design.information)
    return figure


def _draw_rated(axis: Axes, design: Design) -> None:
    names = [_NOW, *(one.proposal.name for one in reversed(design.rated))]
    values = [design.now.worst, *(one.separation.worst for one in reversed(design.rated))]
    # As odds against the wrong one: between 99 and 100 % lies more than between 50 and 99.
    odds = np.log10(np.maximum(np.array(values) / np.maximum(1.0 - np.array(values), 1e-9), 1.0))
    axis.barh(names, odds, color=["0.6", *["C0"] * len(design.rated)])
    for place, (length, value) in enumerate(zip(odds, values, strict=True)):
        words = "> 99.9 %" if value > 0.9995 else f"{100.0 * value:.3g} %"
        axis.text(length, place, f" {words}", va="center", fontsize=7)
    axis.set_xlim(0.0, 1.25 * float(np.max(odds)) + 0.1)
    axis.set_xlabel("odds of the right one of two, power of ten", fontsize=8)
    axis.set_title("told apart: " + ", ".join(design.causes), fontsize=8)
    axis.tick_params(labelsize=7)


def _draw_information(axis: Axes, found: Information) -> None:
    coldest, hottest = float(found.temperature.min()), float(found.temperature.max())
    for temperature, nat in zip(found.temperature, found.nat, strict=True):
        place = (temperature - coldest) / max(hottest - coldest, 1.0)
        axis.plot(
            found.frequency, nat, lw=1.2, color=colormaps["viridis"](0.9 * place), label=f"{temperature:.0f} degC"
        )
    axis.plot(found.best_frequency, found.best, "k*", ms=9, clip_on=False)
    axis.set_xscale("log")
    axis.set_yscale("log")
    top = max(found.best, 1e-12)
    axis.set_ylim(top * 10.0**-_DECADES, 2.0 * top)
    axis.set_xlabel("frequency of one more reading [Hz]", fontsize=8)
    axis.set_ylabel("expected information [nat]", fontsize=8)
    axis.set_title(f"{found.causes[0]} against {found.causes[1]}", fontsize=8)
    axis.tick_params(labelsize=7)
    axis.legend(fontsize=7, frameon=False)
