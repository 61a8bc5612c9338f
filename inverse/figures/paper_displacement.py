"""Figures of displacement: against temperature with variations and measured values, and by reading."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from arfjax import StepwiseResult, suomi2016
from arfjax.figures import COLOURS, new_figure, tidy
from inverse.datasets.hmi import HmiData
from inverse.figures.calibration import draw_measured
from inverse.reproduction import (
    LADDER_TEMPERATURES,
    TEMPERATURES,
    Case,
    Comparison,
    Reading,
    Variation,
    percent_of_first,
)

_RUNGS = {
    "stepwise": "stepwise protocol",
    "heating": "+ heating with feedback (dose)",
    "local absorption": "+ absorption by local temperature",
    "path": "+ heated path",
    "lesion shape": "+ lesion shaped by dose, local moduli",
    "shaking": "+ 50 Hz instead of 0.5 ms",
    "fractional solid": "+ fractional solid",
}
_NAMES = {"table": "table 3", "dose": "dose"}


def draw_displacements(
    runs: Mapping[str, StepwiseResult],
    readings: Sequence[Reading],
    variations: Sequence[Variation],
    measured: HmiData,
    comparison: Comparison,
) -> Figure:
    """Simulated displacement as in the paper, with both variations, and beside it what was measured."""
    figure = new_figure(9.6, 4.2)
    simulated, beside = figure.subplots(1, 2)
    _draw_simulated(simulated, runs, variations)
    _draw_measured(beside, runs["dose"], measured, comparison)
    for axes in (simulated, beside):
        axes.set_ylim(0.0, 140.0)
    return figure


def _draw_simulated(axes: Axes, runs: Mapping[str, StepwiseResult], variations: Sequence[Variation]) -> None:
    for colour, (lesion, run) in zip(COLOURS, runs.items(), strict=False):
        percent = percent_of_first(run)
        for what, alpha in (("attenuation", 0.15), ("modulus", 0.4)):
            low, high = _band(percent, [each for each in variations if each.lesion == lesion and each.what == what])
            label = f"± 25 % of the lesion's {what}"
            axes.fill_between(list(percent), low, high, color=colour, alpha=alpha, linewidth=0, label=label)
        label = f"here, lesion by {_NAMES[lesion]}"
        axes.plot(list(percent), list(percent.values()), "-o", markersize=3.0, color=colour, label=label)
    stated = suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT
    axes.plot(list(stated), list(stated.values()), "X", color="black", markersize=7, label="paper's simulation")
    axes.legend(frameon=False, fontsize="x-small", loc="lower left")
    tidy(axes, x="temperature [°C]", y="displacement [% of 35 °C]", title="single pushes of 0.5 ms")


def _band(percent: dict[float, float], variations: Sequence[Variation]) -> tuple[list[float], list[float]]:
    low, high = dict(percent), dict(percent)
    for each in variations:
        target = low if each.points < 0.0 else high
        target[each.temperature] = percent[each.temperature] + each.points
    return list(low.values()), list(high.values())


def _draw_measured(axes: Axes, pushed: StepwiseResult, measured: HmiData, comparison: Comparison) -> None:
    assert measured.temperature is not None
    for colour, name, curve in (
        (COLOURS[0], "stepwise, pushes of 0.5 ms", percent_of_first(pushed)),
        (COLOURS[2], "transient, 50 Hz, peak to peak", comparison.curve()),
    ):
        at, values = np.asarray(list(curve)), np.asarray(list(curve.values()))
        axes.plot(at, 100.0 * values / np.interp(37.0, at, values), "-", color=colour, label=name)
    draw_measured(axes, measured, measured.temperature, measured.displacement)
    axes.legend(frameon=False, fontsize="x-small", loc="lower left")
    tidy(axes, x="temperature [°C]", y="displacement [% of 37 °C]", title="measured by HMI, and both protocols here")


def draw_ladder(comparison: Comparison) -> Figure:
    """What each assumption that the transient protocol drops does to the curve: the curves, and the changes alone."""
    figure = new_figure(10.2, 4.0)
    curves, changes = figure.subplots(1, 2)
    shades = colormaps["viridis"](np.linspace(0.0, 0.92, len(comparison.rungs)))
    percents = [np.asarray(rung.percent()) for rung in comparison.rungs]
    for rung, percent, shade in zip(comparison.rungs, percents, shades, strict=True):
        curves.plot(LADDER_TEMPERATURES, percent, "-o", markersize=2.5, color=shade, label=_RUNGS[rung.name])
    for rung, before, after, shade in zip(comparison.rungs[1:], percents, percents[1:], shades[1:], strict=False):
        changes.plot(LADDER_TEMPERATURES, after - before, "-o", markersize=2.5, color=shade, label=_RUNGS[rung.name])
    for axes in (curves, changes):
        axes.axhline(100.0 if axes is curves else 0.0, color="0.8", linewidth=0.8, zorder=0)
    tidy(
        curves, x="temperature of the focus [°C]", y="displacement [% of 35 °C]", title="one assumption after the other"
    )
    tidy(changes, x="temperature of the focus [°C]", y="change [percent points]", title="what each of them changes")
    handles, labels = curves.get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, fontsize="small", loc="outside lower center", ncols=3)
    return figure


def draw_readings(readings: Sequence[Reading]) -> Figure:
    """The curve above 55 degC for one departure at a time from the default, for each beam."""
    names = list(dict.fromkeys(each.beam for each in readings))
    figure = new_figure(10.6, 3.9)
    panels = figure.subplots(1, len(names), sharey=True)
    cases = (
        (Case(), "table 3, linear edge, Young, 1.1 kPa", "-"),
        (Case(liver="1.1 Pa"), "liver's M$_0$ 1.1 Pa, as printed", (0, (1, 1))),
        (Case(modulus="shear"), "shear modulus", "--"),
        (Case(edge="sharp"), "sharp edge", "-"),
        (Case("semi-axes"), "table 3 as semi-axes", "-"),
        (Case("semi-axes", liver="1.1 Pa"), "semi-axes and 1.1 Pa", (0, (1, 1))),
        (Case("dose"), "lesion by dose", "-"),
    )
    colours = ("0.2", "0.2", "0.2", COLOURS[3], COLOURS[1], COLOURS[1], COLOURS[0])
    stated = suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT
    for axes, name in zip(panels, names, strict=True):
        for (case, label, line), colour in zip(cases, colours, strict=True):
            (found,) = (each for each in readings if each.beam == name and each.case == case)
            axes.plot(TEMPERATURES, found.percent, linestyle=line, color=colour, label=label)
        axes.plot(list(stated), list(stated.values()), "X", color="black", markersize=7, label="paper's simulation")
        axes.set_xlim(50.0, 71.0)
        axes.set_ylim(25.0, 115.0)
        tidy(axes, x="temperature [°C]", y="", title=name)
    panels[0].set_ylabel("displacement [% of 35 °C]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, fontsize="small", loc="outside lower center", ncols=4)
    return figure
