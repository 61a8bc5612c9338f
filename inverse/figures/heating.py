"""Figure of a heating course: the measurement, the fit, and what is left between them."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from arfjax.figures import COLOURS, new_figure, tidy
from inverse.thermometry_fit import HeatingFit

_MEASURED, _FITTED, _SPREAD = COLOURS[0], COLOURS[1], COLOURS[5]


def heating_figure(fit: HeatingFit) -> Figure:
    """Measured temperature with the fitted course and the time of heating; residuals with the noise below."""
    figure = new_figure(6.4, 5.2)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.6, 1.0))
    _shade_heating(upper, fit)
    _shade_heating(lower, fit)
    _draw_course(upper, fit)
    _draw_residuals(lower, fit)
    figure.align_ylabels([upper, lower])
    return figure


def _shade_heating(axes: Axes, fit: HeatingFit) -> None:
    start, duration = float(fit.heating.start), float(fit.heating.duration)
    axes.axvspan(start, start + duration, color="0.93", linewidth=0.0, zorder=0)


def _draw_course(axes: Axes, fit: HeatingFit) -> None:
    data, used = fit.data, fit.used
    if data.t10 is not None and data.t90 is not None:
        axes.fill_between(
            data.time, data.t90, data.t10, color=_SPREAD, alpha=0.22, linewidth=0.0, label="T90 to T10 of the region"
        )
    axes.plot(fit.curve_time, fit.curve, color=_FITTED, linewidth=1.4, label="fit")
    dot: dict[str, Any] = {"marker": "o", "markersize": 4.0, "linestyle": "none", "color": _MEASURED}
    if data.sd is not None:
        axes.errorbar(data.time, data.temperature, data.sd, fmt="none", ecolor=_MEASURED, elinewidth=0.8)
    axes.plot(data.time[used], data.temperature[used], label="measured mean", **dot)
    if not np.all(used):
        hollow: dict[str, Any] = dot | {"markerfacecolor": "white"}
        axes.plot(data.time[~used], data.temperature[~used], label="occluded, not fitted", **hollow)
    _, top = axes.get_ylim()
    start, duration = float(fit.heating.start), float(fit.heating.duration)
    error = float(fit.uncertainty.standard_errors[4])
    unsure = fit.uncertainty.not_identified
    on = f"on for {duration:.1f} ± {error:.1f} s"
    if "duration" in unsure:
        longer = "lower bound" in unsure["duration"]
        on = f"on for {duration:.1f} s or longer" if longer else f"on for about {duration:.1f} s"
    axes.text(start + 0.5 * duration, top, on, ha="center", va="bottom", size=9)
    axes.legend(frameon=False, fontsize="small", loc="best")
    tidy(axes, x="", y="temperature [°C]")


def _draw_residuals(axes: Axes, fit: HeatingFit) -> None:
    used, noise = fit.used, fit.noise_sd
    axes.axhline(0.0, color="0.4", linewidth=0.7, zorder=1)
    for level in (-2.0 * noise, 2.0 * noise):
        axes.axhline(level, color="0.6", linewidth=0.7, linestyle=(0, (4, 3)), zorder=1)
    axes.plot(fit.data.time[used], fit.residuals[used], "o", markersize=3.2, color=_MEASURED)
    reach = 1.15 * max(3.0 * noise, float(np.abs(fit.residuals[used]).max()))
    axes.set_ylim(-reach, reach)
    axes.annotate(
        "±2 noise sd",
        (1.0, 2.0 * noise),
        xycoords=("axes fraction", "data"),
        ha="right",
        va="bottom",
        size=8,
        color="0.4",
    )
    tidy(axes, x="time [s]", y="measured − fit [K]")
