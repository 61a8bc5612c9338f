"""Figures of a posterior: pairs of parameters, predictions on the data, what was learnt, and whether chains mixed."""

import dataclasses
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from scipy import ndimage, stats

from arfjax.figures import COLOURS, new_figure, tidy
from inverse.datasets.dma import Sweep
from inverse.datasets.hmi import HmiData
from inverse.sampling.overlap import Column, record_columns

_LEVELS = (0.5, 0.9)
_PREFIXES = {"Pa": ((1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa")), "s": ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))}
_MOST_CHAINS = 4
_BINS = 48
_DASHED = (0, (4, 2))


@dataclasses.dataclass(frozen=True)
class Panel:
    """A part of a measurement that is drawn in one pair of axes.

    Attributes:
        rows: Of the measurement's data.
        title: Above.
        x: Where the data lie.
        x_label: With unit.
        y_label: With unit.
        shown: From the data's unit to the one of the axis.
        logarithmic: Whether the ordinate is.
        frequency: Whether the abscissa is a frequency, on a logarithmic axis.
    """

    rows: Int[np.ndarray, " row"]
    title: str
    x: Float[np.ndarray, " row"]
    x_label: str
    y_label: str
    shown: Callable[[np.ndarray], np.ndarray]
    logarithmic: bool = False
    frequency: bool = True


def dma_panels(sweeps: Sequence[Sweep]) -> list[Panel]:
    """Modulus, and loss angle where it was measured, of each sweep, in the order of `dma_measurement`."""
    lengths = [len(sweep.data) for sweep in sweeps]
    starts, total = np.cumsum([0, *lengths[:-1]]), sum(lengths)
    panels = []
    for sweep, start, length in zip(sweeps, starts, lengths, strict=True):
        rows, frequency = np.arange(start, start + length), sweep.data.frequency_hz
        factor, unit = _prefix("Pa", float(np.median(sweep.data.modulus_magnitude)))
        label = sweep.label.replace(" degC", " °C")
        panels.append(
            Panel(
                rows,
                f"Modulus, {label}",
                frequency,
                "Frequency [Hz]",
                f"$|M|$ [{unit}]",
                lambda values, factor=factor: np.exp(values) / factor,
                True,
            )
        )
        if sweep.data.has_phase:
            angle = Panel(
                rows + total, f"Loss angle, {label}", frequency, "Frequency [Hz]", r"$\delta$ [mrad]", lambda v: 1e3 * v
            )
            panels.append(angle)
    return panels


def hmi_panels(data: HmiData, rows: Int[np.ndarray, " n"]) -> list[Panel]:
    """The curve of each sonication, of those rows of the file that a measurement holds, in their order."""
    known = data.temperature is not None
    place = np.asarray(data.temperature if known else data.time)[rows]
    labels = np.asarray(data.sonication)[rows]
    factor, unit = (1.0, "%") if data.in_percent else (1e-6, "µm")
    return [
        Panel(
            np.flatnonzero(labels == label),
            f"Sonication {label}",
            place[labels == label],
            "Temperature at the focus [°C]" if known else "Time [s]",
            f"Displacement [{unit}]",
            lambda values: values / factor,
            frequency=False,
        )
        for label in dict.fromkeys(labels)
    ]


def draw_predictions(data: Any, measurement: str, panels: Sequence[Panel], *, columns: int = 2) -> Figure:
    """Data on the bands within which the posterior predicts them, noise included.

    Args:
        data: From `posterior_record`.
        measurement: Its name.
        panels: What is drawn where, such as `dma_panels`.
        columns: Of panels.
    """
    rows = int(np.ceil(len(panels) / columns))
    figure = new_figure(4.3 * columns, 3.9 * rows + 0.5)
    axes = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=[2.2, 1.0] * rows)
    for spare in range(len(panels), rows * columns):
        for below in (0, 1):
            axes[2 * (spare // columns) + below, spare % columns].remove()
    drawn, means = (_all_draws(data["posterior_predictive"][f"{measurement}{end}"]) for end in ("", "_mean"))
    observed = data["observed_data"][measurement].to_numpy()
    for number, panel in enumerate(panels):
        upper, lower = axes[2 * (number // columns) : 2 * (number // columns) + 2, number % columns]
        order = np.argsort(panel.x)
        one, values = panel.rows[order], panel.shown(drawn[:, panel.rows[order]])
        centre = np.median(panel.shown(means[:, one]), axis=0)
        _draw_bands(upper, panel.x[order], values, centre, panel.shown(observed[one]))
        tidy(upper, x="", y=panel.y_label, title=panel.title)
        # Bands are mostly too narrow to be seen beside the course of the data: below, all less the median.
        scale, unit = (0.01 * centre, "%") if panel.logarithmic else (1.0, panel.y_label.split("[")[-1].rstrip("]"))
        departures = ((values - centre) / scale, np.zeros_like(centre), (panel.shown(observed[one]) - centre) / scale)
        _draw_bands(lower, panel.x[order], *departures)
        tidy(lower, x=panel.x_label, y=rf"$\Delta$ [{unit}]")
        for axis in (upper, lower) if panel.frequency else ():
            _frequency_axis(axis)
        upper.tick_params(labelbottom=False)
        if panel.logarithmic and np.all(values > 0.0):
            upper.set_yscale("log")
            _plain_logarithm(upper)
    figure.align_ylabels()
    handles = [
        Line2D(
            [], [], marker="o", linestyle="none", markerfacecolor="white", markeredgecolor="black", label="measured"
        ),
        Line2D([], [], color=COLOURS[0], label="median, without noise"),
        Patch(color=COLOURS[0], alpha=0.5, label="50 % of new data", linewidth=0.0),
        Patch(color=COLOURS[0], alpha=0.18, label="90 % of new data", linewidth=0.0),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize="small")
    return figure


def _draw_bands(axis: Axes, x: np.ndarray, values: np.ndarray, centre: np.ndarray, measured: np.ndarray) -> None:
    for level, alpha in zip(reversed(_LEVELS), (0.18, 0.38), strict=True):
        low, high = np.quantile(values, [0.5 - 0.5 * level, 0.5 + 0.5 * level], axis=0)
        axis.fill_between(x, low, high, color=COLOURS[0], alpha=alpha, linewidth=0.0)
    axis.plot(x, centre, color=COLOURS[0], linewidth=1.4)
    axis.plot(x, measured, "o", markersize=4.2, markerfacecolor="white", markeredgecolor="black")


def draw_corner(data: Any, names: Sequence[str] | None = None) -> Figure:
    """Every parameter, with its prior, and every pair of them: regions that hold 50 % and 90 % of the posterior.

    Args:
        data: From `posterior_record`.
        names: Of the values to show, groups in brackets; all if not given.
    """
    shown = [_Shown(column) for column in record_columns(data) if names is None or column.name in names]
    count = len(shown)
    figure = new_figure(1.55 * count + 1.2, 1.5 * count + 0.9)
    axes = figure.subplots(count, count, squeeze=False)
    for row in range(count):
        for column in range(count):
            axis = axes[row, column]
            if column > row:
                axis.remove()
                continue
            if row == column:
                _draw_marginal(axis, shown[row])
            else:
                _draw_pair(axis, shown[column], shown[row])
            shown[column].dress(axis, horizontal=True, labelled=row == count - 1)
            if row != column:
                shown[row].dress(axis, horizontal=False, labelled=column == 0)
            axis.spines[["top", "right"]].set_visible(False)
    figure.align_labels(list(axes[-1, :]))
    handles = [
        Line2D([], [], color=COLOURS[0], label="posterior"),
        Line2D([], [], color="0.45", linestyle=_DASHED, label="prior"),
        Patch(color=COLOURS[0], alpha=0.75, label="50 % of the posterior", linewidth=0.0),
        Patch(color=COLOURS[0], alpha=0.3, label="90 %", linewidth=0.0),
    ]
    figure.legend(handles=handles, loc="upper right", bbox_to_anchor=(0.98, 0.97), frameon=False, fontsize="small")
    return figure


def draw_overlap(data: Any, *, columns: int = 3) -> Figure:
    """Prior and posterior of every value, with the area that both share: near 1 where the data said nothing."""
    shown = [_Shown(column, whole=True) for column in record_columns(data)]
    rows = int(np.ceil(len(shown) / columns))
    figure = new_figure(3.0 * columns, 2.1 * rows + 0.5)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for spare in axes[len(shown) :]:
        spare.remove()
    for axis, one in zip(axes, shown, strict=False):
        grid = np.linspace(*one.limits, 400)
        prior, posterior = _density(one.prior, grid), _density(one.posterior.ravel(), grid)
        axis.fill_between(grid, prior, color="0.75", alpha=0.6, linewidth=0.0)
        axis.plot(grid, posterior, color=COLOURS[0], linewidth=1.3)
        axis.fill_between(grid, np.minimum(prior, posterior), color=COLOURS[1], alpha=0.7, linewidth=0.0)
        one.dress(axis, horizontal=True, labelled=True)
        axis.set_yticks([])
        axis.set_ylim(bottom=0.0, top=1.08 * max(posterior.max(), prior.max()))
        axis.spines[["top", "right", "left"]].set_visible(False)
        overlap = one.column.overlap
        said = "< 0.01" if overlap < 0.01 else f"= {overlap:.2f}"
        axis.set_title(f"overlap {said}", fontsize="small", loc="left")
    handles = [
        Patch(color="0.75", alpha=0.6, label="prior", linewidth=0.0),
        Line2D([], [], color=COLOURS[0], label="posterior"),
        Patch(color=COLOURS[1], alpha=0.7, label="in both", linewidth=0.0),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize="small")
    return figure


def draw_traces(data: Any) -> Figure:
    """Draws of each chain one after the other, and the ranks of each among all: flat where chains agree.

    Grey is what chance makes of ranks in 95 % of bins. Of many chains, four that are spread over all are shown.
    """
    shown = [_Shown(column) for column in record_columns(data)]
    figure = new_figure(8.6, 1.35 * len(shown) + 0.7)
    axes = figure.subplots(len(shown), 2, squeeze=False, width_ratios=(2.2, 1.0), sharex="col")
    for row, one in enumerate(shown):
        chains = one.posterior
        picked = np.unique(np.linspace(0, len(chains) - 1, min(len(chains), _MOST_CHAINS)).astype(int))
        for colour, chain in zip(COLOURS, picked, strict=False):
            axes[row, 0].plot(chains[chain], color=colour, linewidth=0.5, alpha=0.8)
        one.dress(axes[row, 0], horizontal=False, labelled=True)
        _draw_ranks(axes[row, 1], chains, picked)
        for axis in axes[row]:
            axis.spines[["top", "right"]].set_visible(False)
    axes[-1, 0].set_xlabel("draw")
    axes[-1, 1].set_xlabel("rank among all draws [%]")
    axes[0, 0].set_title("chains", fontsize="medium", loc="left")
    axes[0, 1].set_title("ranks over those expected", fontsize="medium", loc="left")
    figure.align_ylabels(list(axes[:, 0]))
    return figure


def _draw_ranks(axis: Axes, chains: Float[np.ndarray, "chain draw"], picked: np.ndarray) -> None:
    ranks = stats.rankdata(chains.ravel()).reshape(chains.shape) / chains.size
    bins, count = 20, chains.shape[1]
    chance = 1.96 * np.sqrt((1.0 - 1.0 / bins) * bins / count)
    axis.axhspan(1.0 - chance, 1.0 + chance, color="0.9", linewidth=0.0)
    edges = np.linspace(0.0, 1.0, bins + 1)
    for colour, chain in zip(COLOURS, picked, strict=False):
        share = np.histogram(ranks[chain], edges)[0] * bins / count
        axis.stairs(share, 100.0 * edges, color=colour, linewidth=1.0, baseline=None)
    axis.set_ylim(0.0, 2.0)
    axis.set_yticks([0.0, 1.0, 2.0])
    axis.tick_params(labelsize=8)


class _Shown:
    """A column as it is drawn: by its logarithm where it spans factors, in a handy unit."""

    def __init__(self, column: Column, *, whole: bool = False) -> None:
        self.column = column
        low, middle, high = np.quantile(column.posterior, [0.002, 0.5, 0.998])
        if whole:
            below, above = np.quantile(column.prior, [0.01, 0.99])
            low, high = min(low, below), max(high, above)
        self.logarithmic = bool(low > 0.0 and high / low > (300.0 if whole else 5.0))
        factor, unit = _prefix(column.unit, float(middle)) if not self.logarithmic or not whole else (1.0, column.unit)
        self.unit = unit
        convert = (lambda v: np.log10(v / factor)) if self.logarithmic else (lambda v: v / factor)
        with np.errstate(divide="ignore"):
            self.posterior, self.prior = convert(column.posterior), convert(column.prior)
        margin = 0.04 * (convert(high) - convert(low))
        self.limits = (float(convert(low) - margin), float(convert(high) + margin))

    def dress(self, axis: Axes, *, horizontal: bool, labelled: bool) -> None:
        """Limits, ticks and label of one axis."""
        side = axis.xaxis if horizontal else axis.yaxis
        (axis.set_xlim if horizontal else axis.set_ylim)(*self.limits)
        if self.logarithmic:
            side.set_major_locator(FixedLocator(_logarithmic_ticks(*self.limits)))
            side.set_major_formatter(FuncFormatter(_power))
        else:
            side.set_major_locator(MaxNLocator(3, prune="both"))
        axis.tick_params(labelsize=7)
        if not labelled:
            side.set_tick_params(labelleft=False, labelbottom=False)
            return
        unit = "" if self.unit in ("", "1") else f" [{self.unit}]"
        (axis.set_xlabel if horizontal else axis.set_ylabel)(_wrapped(f"{self.column.title}{unit}"), fontsize=8)


def _wrapped(text: str) -> str:
    """In lines that fit beside small axes, the unit in one of its own where the label is long."""
    if len(text) <= 14:
        return text
    title, _, unit = text.partition(" [")
    lines = textwrap.wrap(title, 18)
    return "\n".join([*lines, f"[{unit}"] if unit else lines)


def _logarithmic_ticks(low: float, high: float) -> list[float]:
    """Logarithms of 1, 2 and 5 times powers of ten, or of a few of those powers."""
    decades = np.arange(np.floor(low), np.ceil(high) + 1.0)
    if high - low < 1.7:
        fine = np.add.outer(decades, np.log10([1.0, 2.0, 5.0])).ravel()
        return [float(tick) for tick in fine if low < tick < high]
    return [float(tick) for tick in decades[:: max(int(np.ceil((high - low) / 4.5)), 1)] if low < tick < high]


def _power(exponent: float, _: int) -> str:
    value = float(f"{10.0**exponent:.3g}")
    return f"{value:g}" if 0.001 <= value < 10_000.0 else f"$10^{{{exponent:g}}}$"


def _prefix(unit: str, size: float) -> tuple[float, str]:
    for factor, name in _PREFIXES.get(unit, ()):
        if abs(size) >= factor:
            return factor, name
    return 1.0, unit


def _density(values: Float[np.ndarray, " draw"], grid: Float[np.ndarray, " place"]) -> Float[np.ndarray, " place"]:
    """By a histogram finer than the kernel that then smooths it; what lies beside the grid is smoothed into it."""
    finite = values[np.isfinite(values)]
    beside = len(grid) // 4
    step = (grid[-1] - grid[0]) / (len(grid) - 1)
    edges = grid[0] + step * (np.arange(-beside, len(grid) + beside + 1) - 0.5)
    spread = min(float(np.std(finite)), float(np.ptp(np.quantile(finite, [0.25, 0.75]))) / 1.34)
    width = 0.9 * max(spread, 1e-12) * min(len(finite), 1000) ** -0.2
    counts = np.histogram(finite, edges)[0] / (len(values) * step)
    smooth = ndimage.gaussian_filter1d(counts, max(width / step, 0.5), mode="nearest")
    return smooth[beside : beside + len(grid)]


def _draw_marginal(axis: Axes, one: _Shown) -> None:
    grid = np.linspace(*one.limits, 300)
    posterior = _density(one.posterior.ravel(), grid)
    axis.fill_between(grid, posterior, color=COLOURS[0], alpha=0.25, linewidth=0.0)
    axis.plot(grid, posterior, color=COLOURS[0], linewidth=1.3)
    axis.plot(grid, _density(one.prior, grid), color="0.45", linewidth=1.0, linestyle=_DASHED)
    axis.set_ylim(0.0, 1.1 * posterior.max())
    axis.set_yticks([])
    axis.spines["left"].set_visible(False)


def _draw_pair(axis: Axes, across: _Shown, up: _Shown) -> None:
    """Regions of highest density that hold the shares of the posterior, from a smoothed histogram."""
    counts, x, y = np.histogram2d(
        across.posterior.ravel(), up.posterior.ravel(), bins=_BINS, range=[across.limits, up.limits]
    )
    smooth = ndimage.gaussian_filter(counts, 1.6)
    ordered = np.sort(smooth.ravel())[::-1]
    held = np.cumsum(ordered) / ordered.sum()
    levels = [float(ordered[np.searchsorted(held, share)]) for share in reversed(_LEVELS)]
    centres = (0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1]))
    if levels[0] < levels[1] < smooth.max():
        colours = [to_rgba(COLOURS[0], alpha) for alpha in (0.3, 0.75)]
        axis.contourf(*centres, smooth.T, levels=[*levels, smooth.max()], colors=colours)
        axis.contour(*centres, smooth.T, levels=levels, colors=[COLOURS[0]], linewidths=0.7)


def _frequency_axis(axis: Axes) -> None:
    axis.set_xscale("log")
    axis.xaxis.set_major_locator(LogLocator(base=10.0, numticks=12))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


def _plain_logarithm(axis: Axes) -> None:
    axis.yaxis.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 3.0, 5.0), numticks=20))
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.yaxis.set_minor_formatter(NullFormatter())


def _all_draws(values: Any) -> np.ndarray:
    array = values.to_numpy()
    return array.reshape(-1, array.shape[-1])
