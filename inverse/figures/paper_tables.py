"""Figures of the paper's tables and fits: attenuation, modulus and phase."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from arfjax import suomi2016, tissues
from arfjax.figures import COLOURS, new_figure, tidy
from inverse.reproduction import TABLES, fitted_frequencies, loss_tangent, modulus_magnitude

_PANELS = ((21.0, 35.0), (50.0,), (65.0, 80.0))
"""Temperatures [degC] that share a panel in the paper."""

_STYLES = {"zener": ((0, (4, 2)), "conventional Zener"), "fractional-zener": ("-", "fractional Zener")}
_MARKERS = {"zener": "s", "fractional-zener": "o"}
_TEMPERATURES = tuple(temperature for panel in _PANELS for temperature in panel)
_FREQUENCY = np.geomspace(0.1, 200.0, 160)


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
    """Magnitude of the modulus of both models in the paper's three panels, with the values that the text reads off."""
    figure = new_figure(9.6, 3.5)
    for axes, temperatures in zip(figure.subplots(1, 3), _PANELS, strict=True):
        _curves(axes, temperatures, magnitude=True)
        for (model, temperature, frequency), stated in suomi2016.TEXT_MODULUS_KPA.items():
            if temperature in temperatures:
                marker = _MARKERS[model]
                axes.plot(frequency, stated, marker, markerfacecolor="white", color=_colour(temperature), zorder=4)
        axes.set_ylim(bottom=0.0)
    stated = [
        Line2D([], [], linestyle="", marker=marker, markerfacecolor="white", color="0.3", label=f"{name}, by the text")
        for name, marker in zip(("conventional", "fractional"), _MARKERS.values(), strict=True)
    ]
    _legend(figure, stated)
    figure.axes[0].set_ylabel("|M| [kPa]")
    return figure


def draw_loss_tangents() -> Figure:
    """Phase of both models in the paper's three panels, by table 2; the paper shows measured values only."""
    figure = new_figure(9.6, 3.5)
    panels = figure.subplots(1, 3, sharey=True)
    for axes, temperatures in zip(panels, _PANELS, strict=True):
        _curves(axes, temperatures, magnitude=False)
        axes.set_yscale("log")
        axes.set_ylim(3e-3, 6.0)
    _legend(figure, [])
    panels[0].set_ylabel("tan δ implied by table 2")
    return figure


def _curves(axes: Axes, temperatures: tuple[float, ...], *, magnitude: bool) -> None:
    for temperature in temperatures:
        for name, table in TABLES.items():
            row, line = table[temperature], _STYLES[name][0]
            fitted = fitted_frequencies(row)
            values = 1e-3 * modulus_magnitude(row, _FREQUENCY) if magnitude else loss_tangent(row, _FREQUENCY)
            inside = (_FREQUENCY >= 0.99 * fitted[0]) & (_FREQUENCY <= 1.01 * fitted[-1])
            # Thin where the model was not fitted.
            axes.plot(_FREQUENCY, values, linestyle=line, color=_colour(temperature), linewidth=0.7)
            axes.plot(_FREQUENCY[inside], values[inside], linestyle=line, color=_colour(temperature), linewidth=1.8)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    tidy(axes, x="frequency [Hz]", y="", title=" and ".join(f"{each:g}" for each in temperatures) + " °C")


def _legend(figure: Figure, more: list[Line2D]) -> None:
    models = [Line2D([], [], color="0.3", linestyle=line, label=label) for line, label in _STYLES.values()]
    colours = [Line2D([], [], color=_colour(each), label=f"{each:g} °C") for each in _TEMPERATURES]
    outside = Line2D([], [], color="0.3", linewidth=0.7, label="outside the fitted range")
    figure.legend(
        handles=[*colours, *models, outside, *more], frameon=False, fontsize="small", loc="outside right center"
    )


def _colour(temperature: float) -> str:
    return COLOURS[_TEMPERATURES.index(temperature)]
