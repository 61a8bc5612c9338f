"""Figures of a Monte Carlo over tissue: bands of the curve, and which constant it follows at each temperature."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from arfjax.figures import COLOURS, new_figure, tidy

_MARKERS = ("o", "s", "D", "^", "v", "P", "X")
_SHADES = (*COLOURS, "0.35")


def draw_bands(data: xr.Dataset, temperature_label: str) -> Figure:
    """Median, middle half and middle nine tenths of the curve; where it is highest, beside it."""
    figure = new_figure(9.2, 3.7)
    curve, highest = figure.subplots(1, 2, width_ratios=(2.1, 1.0))
    _draw_curve(curve, data, temperature_label)
    _draw_highest(highest, data, temperature_label)
    return figure


def _draw_curve(axes: Axes, data: xr.Dataset, temperature_label: str) -> None:
    temperature = data["curve_temperature"].to_numpy()
    low, lower, median, upper, high = data["displacement_quantile"].to_numpy()
    axes.fill_between(temperature, low, high, color=COLOURS[5], alpha=0.3, linewidth=0.0, label="90 % of samples")
    axes.fill_between(temperature, lower, upper, color=COLOURS[0], alpha=0.35, linewidth=0.0, label="50 %")
    axes.plot(temperature, median, color=COLOURS[0], linewidth=1.6, label="median")
    axes.plot(
        temperature,
        data["central_displacement_percent"],
        color="black",
        linewidth=1.0,
        linestyle=(0, (4, 2)),
        label="the model's own constants",
    )
    axes.axhline(100.0, color="0.8", linewidth=0.8, zorder=0)
    axes.legend(frameon=False, fontsize="small", loc="lower left")
    reference = data.attrs["reference_temperature_degc"]
    n_usable = int(data["usable"].to_numpy()[1:].sum())
    tidy(axes, x=temperature_label, y=f"displacement [% of {reference:g} °C]", title=f"{n_usable} samples of tissue")


def _draw_highest(axes: Axes, data: xr.Dataset, temperature_label: str) -> None:
    at, usable = data["highest_at"].to_numpy(), data["usable"].to_numpy() == 1
    drawn = at[1:][usable[1:] & np.isfinite(at[1:])]
    axes.hist(drawn, bins=12, color=COLOURS[0], alpha=0.6)
    axes.axvline(at[0], color="black", linewidth=1.0, linestyle=(0, (4, 2)))
    tidy(axes, x=temperature_label, y="samples", title="where displacement is highest")


def draw_sensitivity(data: xr.Dataset, temperature_label: str) -> Figure:
    """Rank correlation of the normalised displacement with each constant, by temperature, and how much there is of it.

    Grey is what chance makes of constants that do nothing, of the largest of them nineteen times in twenty.
    """
    figure = new_figure(8.6, 5.0)
    axes, spread = figure.subplots(2, 1, sharex=True, height_ratios=(2.6, 1.0))
    temperature = data["curve_temperature"].to_numpy()
    noise = data["rank_correlation_by_chance"].to_numpy()
    axes.fill_between(temperature, -noise, noise, color="0.9", linewidth=0.0, zorder=0)
    axes.axhline(0.0, color="0.6", linewidth=0.7, zorder=1)
    every = max(len(temperature) // 15, 1)
    for index, label in enumerate(data["constant_label"].to_numpy()):
        assumed = not bool(data["measured"][index])
        axes.plot(
            temperature,
            data["rank_correlation"][index],
            color=_SHADES[index % len(_SHADES)],
            marker=_MARKERS[index % len(_MARKERS)],
            markersize=4.0,
            markevery=every,
            linewidth=1.4,
            linestyle=(0, (3, 2)) if assumed else "-",
            label=f"{label}{' (assumed spread)' if assumed else ''}",
        )
    axes.set_ylim(-1.05, 1.05)
    figure.legend(frameon=False, fontsize="small", loc="outside right upper")
    tidy(axes, x="", y="rank correlation [1]", title="of displacement with each constant")
    spread.plot(temperature, data["displacement_sd"], color="black", linewidth=1.4)
    spread.set_ylim(bottom=0.0)
    tidy(spread, x=temperature_label, y="sd [%]", title="standard deviation of displacement over all samples")
    figure.align_ylabels([axes, spread])
    return figure
