"""Figures of fields: the layered geometry with the beam, lesions on the force, and the second study's map."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Rectangle

from arfjax import Model, suomi2016
from arfjax.figures import COLOURS, new_figure, tidy
from inverse.reproduction import Bench, Case, SecondStudy, overview

_FLOOR = -30.0  # dB; the paper's threshold
_SHOWN_MODULUS_KPA = 10.0


def draw_geometry(bench: Bench, names: Sequence[str]) -> Figure:
    """Layers in grey, with their names, and the intensity down to -30 dB, as in the paper."""
    seen = overview(bench.model, bench.protocol, bench.settings)
    figure = new_figure(6.8, 4.6)
    axes = figure.subplots()
    edges = 1e3 * np.asarray([0.0, *seen.interfaces, float(seen.z[-1])])
    shown = 38.0
    greys = [f"{grey:.2f}" for grey in np.linspace(0.35, 0.93, len(names))]
    for left, right, grey, name in zip(edges[:-1], edges[1:], greys, names, strict=True):
        axes.add_patch(Rectangle((left, -shown), right - left, 2.0 * shown, color=grey, linewidth=0))
        axes.text(0.5 * (left + right), shown - 1.5, name, ha="center", va="top", fontsize="small", color=_ink(grey))
    decibel = 10.0 * np.log10(np.maximum(seen.intensity / seen.intensity.max(), 1e-6))
    both = np.concatenate([decibel[:0:-1], decibel])
    r = 1e3 * np.concatenate([-seen.r[:0:-1], seen.r])
    image = axes.pcolormesh(
        1e3 * seen.z, r, np.ma.masked_less(both, _FLOOR), vmin=_FLOOR, vmax=0.0, cmap="magma", shading="auto"
    )
    image.set_rasterized(True)
    figure.colorbar(image, ax=axes, label="intensity [dB re peak]", shrink=0.8)
    _draw_bowl(axes, bench.model)
    axes.set_xlim(-2.0, edges[-1])
    axes.set_ylim(-shown, shown)
    axes.set_aspect("equal")
    tidy(axes, x="axial distance z [mm]", y="r [mm]", title="layers and linear field at 35 °C, above −30 dB")
    return figure


def _ink(grey: str) -> str:
    return "white" if float(grey) < 0.6 else "black"


def _draw_bowl(axes: Axes, model: Model) -> None:
    focal, outer, inner = (
        1e3 * float(each) for each in (model.bowl.focal_length, model.bowl.aperture_radius, model.bowl.hole_radius)
    )
    radius = np.linspace(inner, outer, 60)
    for side in (1.0, -1.0):
        axes.plot(focal - np.sqrt(focal**2 - radius**2), side * radius, color="black", linewidth=2.5)


def draw_lesions_on_force(bench: Bench) -> Figure:
    """Force field with lesions of the table and of the dose at 55, 60 and 65 degC."""
    temperatures = (55.0, 60.0, 65.0)
    figure = new_figure(7.0, 4.6)
    panels = figure.subplots(1, 3, sharey=True)
    mesh, focus = bench.settings.mesh, 1e3 * bench.settings.focus
    r, z = 1e3 * mesh.gauss_r, 1e3 * mesh.gauss_z - focus
    both = np.concatenate([-r[::-1], r])
    start = float(bench.linear(bench.protocol.start_temperature).force.max())
    image = None
    for axes, temperature in zip(panels, temperatures, strict=True):
        force = np.asarray(bench.linear(temperature).force) / start
        mirrored = np.concatenate([force[::-1], force])
        # Across the page as in the paper: r to the right, sound upwards.
        image = axes.contourf(both, z, mirrored.T, np.linspace(0.0, 1.3, 14), cmap="Greys", extend="max")
        axes.contour(both, z, mirrored.T, [0.25 * force.max()], colors="black", linewidths=0.9, linestyles="--")
        share = np.asarray(bench.share(Case("dose", "dose"), temperature))
        outline = np.concatenate([share[::-1], share]).T
        if share.max() > 0.5:
            axes.contour(both, z, outline, [0.5], colors=COLOURS[0], linewidths=1.5)
        _draw_table_lesion(axes, temperature)
        axes.set_xlim(-2.5, 2.5)
        axes.set_ylim(-9.5, 6.5)
        axes.set_aspect("equal")
        tidy(axes, x="r [mm]", y="", title=f"{temperature:g} °C")
    panels[0].set_ylabel("z from the focus [mm]")
    assert image is not None
    figure.colorbar(image, ax=panels, label="force density over its peak at 35 °C", shrink=0.9)
    handles = [
        Line2D([], [], color="black", linestyle="--", linewidth=0.9, label="force at −6 dB"),
        Line2D([], [], color=COLOURS[1], label="lesion of table 3"),
        Line2D([], [], color=COLOURS[1], linestyle=":", label="its numbers as semi-axes"),
        Line2D([], [], color=COLOURS[0], label="lesion by dose, 240 min"),
    ]
    figure.legend(handles=handles, frameon=False, fontsize="small", loc="outside lower center", ncols=2)
    return figure


def _draw_table_lesion(axes: Axes, temperature: float) -> None:
    if temperature not in suomi2016.TABLE_3_LESION:
        return
    column = suomi2016.TABLE_3_LESION[temperature]
    for factor, line in ((1.0, "-"), (2.0, ":")):
        size = (factor * column.diameter_mm, factor * column.length_mm)
        axes.add_patch(Ellipse((0.0, 0.0), *size, fill=False, color=COLOURS[1], linewidth=1.5, linestyle=line))


def draw_second_study(study: SecondStudy) -> Figure:
    """Displacement every 5 um at the power that gives 9 um at one assumed average of fresh liver."""
    figure = new_figure(5.6, 4.4)
    axes = figure.subplots()
    attenuation = suomi2016.TABLE_1_ACOUSTIC["liver"].attenuation_db_per_cm_mhz
    power = study.power_for(1e-6 * suomi2016.SECOND_STUDY_UNABLATED_UM, _SHOWN_MODULUS_KPA)
    micrometres = 1e6 * power * study.displacement_per_watt
    levels = np.arange(5.0, 5.0 * np.ceil(micrometres.max() / 5.0) + 1.0, 5.0)
    greys = [f"{grey:.2f}" for grey in np.linspace(1.0, 0.7, len(levels) + 1)]
    x, y = study.attenuation_db_per_cm, study.modulus_kpa
    axes.contourf(x, y, micrometres, [0.0, *levels, 1e3], colors=greys)
    lines = axes.contour(x, y, micrometres, levels, colors="0.2", linewidths=0.9)
    column = int(np.argmin(np.abs(x - 1.15)))
    crossings = [
        (float(x[column]), float(np.interp(-level, -micrometres[:, column], y)))
        for level in levels
        if level < micrometres[0, column]
    ]
    axes.clabel(lines, fmt="%g µm", fontsize="small", manual=crossings)
    axes.plot(attenuation, _SHOWN_MODULUS_KPA, "x", color=COLOURS[0], markersize=9, markeredgewidth=2, label=_before())
    ablated = suomi2016.TEXT_ABLATION_ATTENUATION_RATIO * attenuation
    low, high = (_SHOWN_MODULUS_KPA * factor for factor in suomi2016.TEXT_ABLATION_MODULUS_RATIO)
    label = "after: + 110 %, four to eight times as stiff"
    axes.plot([ablated, ablated], [low, high], "-o", color=COLOURS[1], markersize=5, label=label)
    stated = suomi2016.SECOND_STUDY_ABLATED_UM / suomi2016.SECOND_STUDY_UNABLATED_UM
    needed = _SHOWN_MODULUS_KPA * study.factor_for(stated, _SHOWN_MODULUS_KPA)
    axes.plot(ablated, needed, "*", color=COLOURS[1], markersize=12, markeredgecolor="black", label="the paper's 6 µm")
    axes.legend(fontsize="x-small", loc="upper left", framealpha=0.9)
    title = f"homogeneous liver, {power:.0f} W (gives 9 µm at the cross)"
    tidy(axes, x="attenuation at 1 MHz [dB/cm]", y="$M_\\infty - M_0$ [kPa]", title=title)
    return figure


def _before() -> str:
    return f"before: table 1, and {_SHOWN_MODULUS_KPA:g} kPa assumed"
