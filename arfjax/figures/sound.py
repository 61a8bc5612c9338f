"""Pictures of sound fields."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator

from arfjax.figures.style import COLOURS, draw_layers, mirrored, new_figure, tidy
from arfjax.model import Model

_DECIBEL_FLOOR = -30.0

_SHOWN_RADIUS = 15.0  # mm

_SPECTRUM_FLOOR = -100.0  # dB


def draw_field(dataset: xr.Dataset, model: Model) -> Figure:
    """The field in dB with the layers, its axial profile and its focal-plane profile.

    Of nonlinear sound the map is that of the peak positive pressure; the profiles show both peaks and the harmonics.
    """
    figure = new_figure(8.4, 6.6)
    panels = figure.subplot_mosaic([["map", "map"], ["axis", "plane"]], height_ratios=[1.35, 1.0])
    nonlinear = dataset.sizes["harmonic"] > 1
    shown = "peak_positive_pressure" if nonlinear else "pressure_amplitude"
    what = "peak positive pressure" if nonlinear else "pressure amplitude"
    z, both, values = mirrored(dataset if nonlinear else dataset.isel(harmonic=0), shown)
    focus = 1e3 * float(model.bowl.focal_length)
    decibel = 20.0 * np.log10(np.maximum(values / values.max(), 1e-6))
    image = panels["map"].pcolormesh(z, both, decibel, vmin=_DECIBEL_FLOOR, vmax=0.0, cmap="magma", shading="auto")
    image.set_rasterized(True)
    figure.colorbar(
        image, ax=panels["map"], label="pressure [dB re peak]", extend="min", location="bottom", shrink=0.5, aspect=40
    )
    tidy(panels["map"], x="axial distance z [mm]", y="r [mm]", title=what)
    panels["map"].set_aspect("equal")
    panels["map"].set_ylim(-_SHOWN_RADIUS, _SHOWN_RADIUS)
    draw_layers(panels["map"], model, colour="white")
    draw_layers(panels["axis"], model, colour="0.6")
    r = 1e3 * dataset["r"].to_numpy()
    near = r <= 6.0
    axis, plane = dataset.isel(r=0), dataset.sel(z=1e-3 * focus, method="nearest")
    for label, on_axis, off_axis in _profiles(axis, plane, nonlinear):
        panels["axis"].plot(z, 1e-6 * on_axis, label=label, **_LINES[label])
        profile = 1e-6 * off_axis[near]
        panels["plane"].plot(
            np.concatenate([-r[near][:0:-1], r[near]]), np.concatenate([profile[:0:-1], profile]), **_LINES[label]
        )
    if nonlinear:
        panels["axis"].legend(frameon=False, fontsize="small")
    panels["axis"].set_xlim(z[0], z[-1])
    for name in ("axis", "plane"):
        panels[name].set_ylim(bottom=0.0)
    tidy(panels["axis"], x="axial distance z [mm]", y="pressure [MPa]", title="on the axis")
    tidy(panels["plane"], x="radial distance r [mm]", y="pressure [MPa]", title=f"focal plane, z = {focus:.1f} mm")
    return figure


_LINES = {
    "$p_+$": {"color": "black", "linewidth": 1.6},
    "$-p_-$": {"color": "0.55", "linewidth": 1.6},
    **{f"$|p_{n}|$": {"color": COLOURS[n - 1], "linewidth": 1.0} for n in (1, 2, 3)},
}


def _profiles(axis: xr.Dataset, plane: xr.Dataset, nonlinear: bool) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, values on the axis and values in the focal plane of each line to be drawn [Pa]."""
    lines = []
    if nonlinear:
        for label, name, sign in (("$p_+$", "peak_positive_pressure", 1.0), ("$-p_-$", "peak_negative_pressure", -1.0)):
            lines.append((label, sign * axis[name].to_numpy(), sign * plane[name].to_numpy()))
    for n in (1, 2, 3) if nonlinear else (1,):
        pair = (each["pressure_amplitude"].sel(harmonic=n).to_numpy() for each in (axis, plane))
        lines.append((f"$|p_{n}|$", *pair))
    return lines


def draw_sound(dataset: xr.Dataset, model: Model) -> Figure:
    """Waveform and spectrum at the focus and at the highest peak, heat about it, and where the power goes."""
    figure = new_figure(9.2, 6.2)
    panels = figure.subplot_mosaic([["waveform", "spectrum"], ["heat", "power"]])
    place = dataset.attrs["peak_positive_pressure_r_m"], dataset.attrs["peak_positive_pressure_z_m"]
    labels = {
        "focal": "geometric focus",
        "peak": f"highest $p_+$ (z = {1e3 * place[1]:.1f} mm{f', r = {1e3 * place[0]:.1f} mm' if place[0] else ''})",
    }
    time = 1e6 * np.append(dataset["period_time"].to_numpy(), 1.0 / dataset.attrs["fundamental_hz"])
    for (name, label), colour in zip(labels.items(), COLOURS, strict=False):
        wave = 1e-6 * dataset[f"{name}_waveform"].to_numpy()
        # Shifted so that the crests stand in the middle.
        wave = np.roll(wave, len(wave) // 2 - int(np.argmax(wave)))
        panels["waveform"].plot(time, np.append(wave, wave[0]), color=colour, label=label)
        decibel = dataset[f"{name}_spectrum"].to_numpy()
        decibel = 20.0 * np.log10(np.maximum(decibel / decibel[0], 1e-9))
        seen = decibel > _SPECTRUM_FLOOR
        orders = dataset["carried_harmonic"].to_numpy()
        panels["spectrum"].plot(orders[seen], decibel[seen], "o-", markersize=3, color=colour, label=label)
        panels["spectrum"].set_xlim(0.0, max(orders[seen][-1] + 1.0, 5.0, panels["spectrum"].get_xlim()[1]))
    panels["waveform"].axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
    panels["waveform"].set_xlim(0.0, time[-1])
    panels["spectrum"].legend(frameon=False, fontsize="small")
    panels["spectrum"].xaxis.set_major_locator(MaxNLocator(integer=True))
    panels["spectrum"].set_ylim(_SPECTRUM_FLOOR, 5.0)
    tidy(panels["waveform"], x="time [µs]", y="pressure [MPa]", title="one period")
    tidy(panels["spectrum"], x="harmonic", y="amplitude [dB re fundamental]", title="spectrum")
    _draw_heat(figure, panels["heat"], dataset, model)
    _draw_power(panels["power"], dataset, model)
    return figure


def _draw_heat(figure: Figure, chart: Axes, dataset: xr.Dataset, model: Model) -> None:
    z, both, heat = mirrored(dataset, "heat_deposition")
    image = chart.pcolormesh(z, both, 1e-6 * heat, cmap="inferno", shading="gouraud")
    image.set_rasterized(True)
    figure.colorbar(image, ax=chart, label="heat [W/cm³]", shrink=0.8)
    chart.contour(z, both, heat, [0.5 * heat.max()], colors="white", linewidths=0.9, linestyles="--")
    peak = z[np.unravel_index(np.argmax(heat), heat.shape)[1]]
    chart.set_xlim(max(peak - 10.0, z[0]), min(peak + 10.0, z[-1]))
    chart.set_ylim(-5.0, 5.0)
    chart.set_aspect("equal")
    chart.xaxis.set_major_locator(MultipleLocator(5.0))
    draw_layers(chart, model, colour="white")
    tidy(chart, x="axial distance z [mm]", y="r [mm]", title="heat deposition; dashed: half of the highest")


def _draw_power(chart: Axes, dataset: xr.Dataset, model: Model) -> None:
    """Power along the axis: known at every layer's front and back, joined by straight lines."""
    entering, leaving = dataset["entering_power"].to_numpy(), dataset["leaving_power"].to_numpy()
    z = 1e3 * dataset["z"].to_numpy()
    backs = np.cumsum([1e3 * layer.thickness for layer in model.layers])[: len(entering)]
    fronts, backs = np.concatenate([z[:1], backs[:-1]]), np.minimum(backs, z[-1])
    depth, power = np.stack([fronts, backs], axis=1), np.stack([entering, leaving], axis=1)
    chart.plot(depth.ravel(), power.ravel(), "o-", markersize=4, color=COLOURS[0])
    for (front, back), lost in zip(depth, entering - leaving, strict=True):
        if back - front < 0.08 * (z[-1] - z[0]):
            continue  # no room for the number
        chart.annotate(
            f"{lost:.2g} W",
            (0.5 * (front + back), 0.0),
            (0.0, 4.0),
            textcoords="offset points",
            ha="center",
            fontsize="small",
        )
    chart.set_xlim(z[0], z[-1])
    chart.set_ylim(0.0, 1.08 * entering[0])
    draw_layers(chart, model, colour="0.6")
    tidy(chart, x="axial distance z [mm]", y="acoustic power [W]", title="power in the beam; below: lost in the layer")
