"""Figures of fits to a dynamic mechanical analysis."""

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from inverse.datasets.dma import Sweep
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL, DmaFit, SweepFit
from inverse.dma_residuals import ModulusResidual

MOST_CURVES = 6
"""Sweeps that one figure shows; more are thinned evenly over temperature."""

_STYLES = {CONVENTIONAL.name: ((0, (4, 2)), "conventional Zener"), FRACTIONAL.name: ("-", "fractional Zener")}
_MARKERS = {CONVENTIONAL.name: "s", FRACTIONAL.name: "o"}
_PREFIXES = ((1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa"), (1.0, "Pa"))


def dma_figure(fit: DmaFit, residual: ModulusResidual) -> Figure:
    """Storage and loss modulus (or the magnitude) over frequency with every fitted model, and the misfit below.

    Args:
        fit: From `fit_sweeps`.
        residual: Which of its fits to show; the lower panels show relative misfit whichever it was.

    Returns:
        A figure of two columns, or one where only the magnitude was measured.
    """
    fits = fit.select(residual=residual)
    sweeps = _thinned(_sweeps_of(fits))
    kinds = ("storage", "loss") if sweeps[0].data.has_phase else ("magnitude",)
    figure = Figure(figsize=(3.9 * len(kinds) + 1.5, 5.6), layout="constrained")
    axes = figure.subplots(2, len(kinds), sharex=True, height_ratios=(2.4, 1.0), squeeze=False)
    colours = _colours(sweeps)
    highest = max(float(np.max(sweep.data.modulus_magnitude)) for sweep in sweeps)
    factor, unit = next(pair for pair in _PREFIXES if highest >= pair[0] or pair[0] == 1.0)
    for column, kind in enumerate(kinds):
        upper, lower = axes[0, column], axes[1, column]
        for sweep in sweeps:
            _draw_sweep(upper, sweep, kind, factor, colours[id(sweep)])
        for one in (one for one in fits if id(one.sweep) in colours):
            _draw_fit(upper, lower, one, kind, factor, colours[id(one.sweep)])
        _dress(upper, lower, kind, unit)
        _frame(upper, [_measured(sweep, kind) / factor for sweep in sweeps])
    figure.align_ylabels(list(axes.ravel()))
    _legends(figure, axes[0, -1], sweeps, colours, fits)
    return figure


def _sweeps_of(fits: Sequence[SweepFit]) -> list[Sweep]:
    return list({id(fit.sweep): fit.sweep for fit in fits}.values())


def _thinned(sweeps: Sequence[Sweep]) -> list[Sweep]:
    if len(sweeps) <= MOST_CURVES:
        return list(sweeps)
    ordered = sorted(sweeps, key=lambda sweep: sweep.temperature_c)
    return [ordered[int(round(place))] for place in np.linspace(0, len(ordered) - 1, MOST_CURVES)]


def _colours(sweeps: Sequence[Sweep]) -> dict[int, tuple[float, float, float, float]]:
    places = np.linspace(0.02, 0.86, len(sweeps)) if len(sweeps) > 1 else [0.3]
    return {id(sweep): colormaps["plasma"](place) for sweep, place in zip(sweeps, places, strict=True)}


def _part(modulus, kind: str):
    return {"storage": np.real, "loss": np.imag, "magnitude": np.abs}[kind](modulus)


def _measured(sweep: Sweep, kind: str):
    data = sweep.data
    return {"storage": data.storage_modulus, "loss": data.loss_modulus, "magnitude": data.modulus_magnitude}[kind]


def _draw_sweep(upper: Axes, sweep: Sweep, kind: str, factor: float, colour) -> None:
    data = sweep.data
    deviation = getattr(data, f"modulus_{kind}_sd" if kind == "magnitude" else f"{kind}_modulus_sd")
    upper.errorbar(
        data.frequency_hz,
        _measured(sweep, kind) / factor,
        yerr=None if deviation is None else deviation / factor,
        fmt="o",
        markersize=4.2,
        markerfacecolor="white",
        markeredgecolor=colour,
        markeredgewidth=1.1,
        ecolor=colour,
        elinewidth=0.8,
        zorder=3,
    )


def _draw_fit(upper: Axes, lower: Axes, fit: SweepFit, kind: str, factor: float, colour) -> None:
    style, _ = _STYLES[fit.model.name]
    data = fit.sweep.data
    frequency = np.geomspace(data.frequency_hz.min() / 1.3, data.frequency_hz.max() * 1.3, 200)
    upper.plot(frequency, _part(fit.modulus(frequency), kind) / factor, linestyle=style, color=colour, linewidth=1.2)
    measured = _measured(fit.sweep, kind)
    misfit = 100.0 * (measured - _part(fit.modulus(data.frequency_hz), kind)) / data.modulus_magnitude
    lower.plot(
        data.frequency_hz,
        misfit,
        linestyle=style,
        linewidth=0.7,
        marker=_MARKERS[fit.model.name],
        markersize=2.8,
        color=colour,
        alpha=0.9 if fit.model.fractional else 0.55,
    )


def _dress(upper: Axes, lower: Axes, kind: str, unit: str) -> None:
    symbol = {"storage": "$M_S$", "loss": "$M_L$", "magnitude": "$|M|$"}[kind]
    name = {"storage": "Storage modulus", "loss": "Loss modulus", "magnitude": "Modulus magnitude"}[kind]
    upper.set_xscale("log")
    upper.set_yscale("log")
    upper.yaxis.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 5.0), numticks=20))
    upper.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    upper.yaxis.set_minor_formatter(NullFormatter())
    upper.set_ylabel(f"{name} {symbol} [{unit}]")
    lower.set_ylabel("measured − fit\n[% of $|M|$]")
    lower.set_xlabel("Frequency [Hz]")
    lower.axhline(0.0, color="0.4", linewidth=0.7, zorder=0)
    lower.set_yscale("symlog", linthresh=1.0, linscale=0.8)
    lower.margins(y=0.08)
    lower.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    lower.xaxis.set_major_locator(LogLocator(base=10.0, numticks=12))
    lower.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    lower.xaxis.set_minor_formatter(NullFormatter())
    for axis in (upper, lower):
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(which="both", direction="out", labelsize=8)
        axis.grid(which="major", color="0.92", linewidth=0.6)
        axis.set_axisbelow(True)


def _frame(upper: Axes, measured: Sequence[np.ndarray]) -> None:
    """Frame the measurements; a model that leaves them by far may leave the panel."""
    positive = np.concatenate(measured)
    positive = positive[positive > 0.0]
    if positive.size == 0:  # a solid without loss
        return
    margin = max((positive.max() / positive.min()) ** 0.12, 1.1)
    upper.set_ylim(positive.min() / margin, positive.max() * margin)


def _legends(figure: Figure, upper: Axes, sweeps: Sequence[Sweep], colours, fits: Sequence[SweepFit]) -> None:
    names = {fit.model.name for fit in fits}
    lines = [
        Line2D([], [], color="0.25", linestyle=style, linewidth=1.2, marker=_MARKERS[name], markersize=2.8, label=label)
        for name, (style, label) in _STYLES.items()
        if name in names
    ]
    circle = {"marker": "o", "markersize": 4.2, "markerfacecolor": "white", "linestyle": "none"}
    measured = Line2D([], [], markeredgecolor="0.25", label="measured", **circle)
    coloured = [
        Line2D([], [], color=colours[id(sweep)], linewidth=2.4, label=sweep.label.replace(" degC", " °C"))
        for sweep in sorted(sweeps, key=lambda sweep: -sweep.temperature_c)
    ]
    figure.legend(handles=[measured, *lines, *coloured], loc="outside right center", fontsize=8, frameon=False)
