"""Figures in the form of the paper's, from its own numbers and from this simulation."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from arfjax import StepwiseResult, suomi2016, tissues
from arfjax.figures import COLOURS, new_figure, tidy
from inverse.datasets.hmi import HmiData
from inverse.figures.calibration import draw_measured
from inverse.reproduction import modulus_magnitude

_TITLES = {"zener": "conventional Zener model", "fractional-zener": "fractional Zener model"}


def draw_attenuation() -> Figure:
    """The attenuation polynomial over its range and beyond, where it is extrapolated."""
    figure = new_figure(4.6, 3.2)
    axes = figure.subplots()
    low, high = suomi2016.FIGURE_ATTENUATION_RANGE
    attenuation = tissues.liver_attenuation()
    inside, outside = np.linspace(low, high, 200), np.linspace(high, 85.0, 50)
    axes.plot(inside, attenuation.percent(inside), color=COLOURS[0], label=f"fitted range, {low:g} to {high:g} °C")
    axes.plot(outside, attenuation.percent(outside), ":", color=COLOURS[0], label="extrapolated")
    axes.plot(37.0, 100.0, "o", color=COLOURS[1], label="normalisation, 100 % at 37 °C")
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize="small")
    tidy(axes, x="temperature [°C]", y="attenuation [% of 37 °C]", title="attenuation polynomial of liver")
    return figure


def draw_paper_moduli() -> Figure:
    """Magnitude of the modulus of both models at the five temperatures, with the values that the text reads off."""
    figure = new_figure(9.0, 3.6)
    tables = {"zener": suomi2016.TABLE_2_ZENER, "fractional-zener": suomi2016.TABLE_2_FRACTIONAL_ZENER}
    frequency = np.geomspace(0.1, 200.0, 120)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (name, table) in zip(panels, tables.items(), strict=True):
        for colour, (temperature, row) in zip(COLOURS, table.items(), strict=False):
            label = f"{temperature:g} °C"
            axes.loglog(frequency, 1e-3 * modulus_magnitude(row, frequency), color=colour, label=label)
        for (model, temperature, at), stated in suomi2016.TEXT_MODULUS_KPA.items():
            if model == name:
                colour = COLOURS[list(table).index(temperature)]
                axes.plot(at, stated, "o", markerfacecolor="white", color=colour)
        tidy(axes, x="frequency [Hz]", y="|M| [kPa]" if name == "zener" else "", title=_TITLES[name])
    panels[0].plot([], [], "o", markerfacecolor="white", color="0.3", label="stated in the text")
    figure.legend(*panels[0].get_legend_handles_labels(), frameon=False, fontsize="small", loc="outside right center")
    return figure


def draw_displacements(runs: Mapping[str, StepwiseResult], measured: HmiData) -> Figure:
    """Normalised displacement as simulated here, as the paper's text states its simulation, and as measured."""
    figure = new_figure(6.4, 4.0)
    axes = figure.subplots()
    for colour, (label, run) in zip(COLOURS, runs.items(), strict=False):
        percent = 100.0 * np.asarray(run.displacement) / float(run.displacement[0])
        axes.plot(np.asarray(run.temperature), percent, "-", color=colour, label=f"here, lesion by {label}")
    stated = suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT
    axes.plot(list(stated), list(stated.values()), "X", color="black", markersize=7, label="paper's simulation")
    assert measured.temperature is not None
    draw_measured(axes, measured, measured.temperature, measured.displacement)
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize="small", loc="lower left")
    tidy(
        axes,
        x="temperature [°C]",
        y="displacement [%]",
        title="normalised to 35 °C (simulated) and 37 °C (measured)",
    )
    return figure
