"""Pictures of fields, heating and displacement; the only file of the package that draws."""

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator

from arfjax.laws import SMALLEST_DAMAGE
from arfjax.model import Model
from arfjax.thermal.dose import LETHAL_DOSE_MINUTES

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colours that colour-blind readers can tell apart (Okabe and Ito)."""

_DECIBEL_FLOOR = -30.0
_SHOWN_RADIUS = 15.0  # mm
_SPECTRUM_FLOOR = -100.0  # dB


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inches] in the style of all figures here."""
    return Figure(figsize=(width, height), layout="constrained", dpi=160)


def tidy(axes: Axes, *, x: str, y: str, title: str = "") -> None:
    """Label axes and take away what a reader does not need."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, fontsize="medium", loc="left")
    axes.spines[["top", "right"]].set_visible(False)


def draw_field(dataset: xr.Dataset, model: Model) -> Figure:
    """The field in dB with the layers, its axial profile and its focal-plane profile.

    Of nonlinear sound the map is that of the peak positive pressure; the profiles show both peaks and the harmonics.
    """
    figure = new_figure(8.4, 6.6)
    panels = figure.subplot_mosaic([["map", "map"], ["axis", "plane"]], height_ratios=[1.35, 1.0])
    nonlinear = dataset.sizes["harmonic"] > 1
    shown = "peak_positive_pressure" if nonlinear else "pressure_amplitude"
    what = "peak positive pressure" if nonlinear else "pressure amplitude"
    z, both, values = _mirrored(dataset if nonlinear else dataset.isel(harmonic=0), shown)
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
    _draw_layers(panels["map"], model, colour="white")
    _draw_layers(panels["axis"], model, colour="0.6")
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
    z, both, heat = _mirrored(dataset, "heat_deposition")
    image = chart.pcolormesh(z, both, 1e-6 * heat, cmap="inferno", shading="gouraud")
    image.set_rasterized(True)
    figure.colorbar(image, ax=chart, label="heat [W/cm³]", shrink=0.8)
    chart.contour(z, both, heat, [0.5 * heat.max()], colors="white", linewidths=0.9, linestyles="--")
    peak = z[np.unravel_index(np.argmax(heat), heat.shape)[1]]
    chart.set_xlim(max(peak - 10.0, z[0]), min(peak + 10.0, z[-1]))
    chart.set_ylim(-5.0, 5.0)
    chart.set_aspect("equal")
    chart.xaxis.set_major_locator(MultipleLocator(5.0))
    _draw_layers(chart, model, colour="white")
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
    _draw_layers(chart, model, colour="0.6")
    tidy(chart, x="axial distance z [mm]", y="acoustic power [W]", title="power in the beam; below: lost in the layer")


def draw_heating(dataset: xr.Dataset, model: Model) -> Figure:
    """Temperature at the focus over time, and temperature with the lethal-dose contour at the end."""
    figure = new_figure(9.0, 3.4)
    curve, chart = figure.subplots(1, 2, width_ratios=[1.0, 1.3])
    curve.plot(dataset["heating_time"], dataset["focal_temperature"], color=COLOURS[1])
    tidy(curve, x="time [s]", y="temperature [°C]", title="at the geometric focus")
    r, z = 1e3 * dataset["heat_r"].to_numpy(), 1e3 * dataset["heat_z"].to_numpy()
    both = np.concatenate([-r[::-1], r])
    temperature = dataset["temperature"].to_numpy()
    dose = np.maximum(dataset["thermal_dose"].to_numpy(), 1e-30)
    levels = np.arange(np.floor(temperature.min()), np.ceil(temperature.max()) + 1.0)
    filled = chart.contourf(z, both, np.concatenate([temperature[::-1], temperature]), levels, cmap="inferno")
    figure.colorbar(filled, ax=chart, label="temperature [°C]", ticks=MultipleLocator(5.0))
    lethal = np.log(np.concatenate([dose[::-1], dose]))
    chart.contour(z, both, lethal, [np.log(LETHAL_DOSE_MINUTES)], colors="white", linewidths=1.2)
    focus = 1e3 * float(model.bowl.focal_length)
    chart.set_xlim(focus - 12.0, focus + 12.0)
    chart.set_ylim(-8.0, 8.0)
    chart.set_aspect("equal")
    _draw_layers(chart, model, colour="white")
    tidy(chart, x="axial distance z [mm]", y="r [mm]", title=f"at the end; white: {LETHAL_DOSE_MINUTES:g} min at 43 °C")
    return figure


def draw_displacement(dataset: xr.Dataset) -> Figure:
    """Displacement by temperature, the lesion that goes with it, and the pushes themselves."""
    figure = new_figure(10.0, 3.2)
    curve, lesion, pushes = figure.subplots(1, 3)
    temperature = dataset["step_temperature"].to_numpy()
    curve.plot(temperature, dataset["displacement_percent"], "o-", color=COLOURS[0])
    curve.axhline(100.0, color="0.8", linewidth=0.8, zorder=0)
    reference = dataset.attrs["reference_temperature_degc"]
    tidy(curve, x="temperature [°C]", y=f"displacement [% of {reference:g} °C]", title="at the end of the push")
    lesion.plot(temperature, 1e3 * dataset["lesion_length"], "o-", color=COLOURS[1], label="length")
    lesion.plot(temperature, 1e3 * dataset["lesion_diameter"], "s-", color=COLOURS[2], label="diameter")
    lesion.legend(frameon=False)
    tidy(lesion, x="temperature [°C]", y="size [mm]", title="lesion")
    times = 1e3 * dataset["push_time"].to_numpy()
    histories = 1e6 * dataset["focal_displacement"].to_numpy()
    for row, degrees in zip(histories, temperature, strict=True):
        shade = 0.85 * (degrees - temperature[0]) / max(temperature[-1] - temperature[0], 1e-9)
        pushes.plot(times, row, color=colormaps["plasma"](shade), label=f"{degrees:g} °C")
    pushes.legend(frameon=False, fontsize="x-small")
    tidy(pushes, x="time [ms]", y="displacement [µm]", title="at the geometric focus")
    return figure


def draw_push(dataset: xr.Dataset, model: Model, *, push_duration: float) -> Figure:
    """Maps of displacement at four times with the lesion's outline, the course at the focus, the wave running out."""
    figure = new_figure(10.5, 6.4)
    top, bottom = figure.subfigures(2, 1, height_ratios=[1.3, 1.0], squeeze=False)[:, 0]
    time, focus = dataset["push_time"].to_numpy(), float(model.bowl.focal_length)
    for chart, at in zip(top.subplots(1, 4, sharey=True), _telling_times(time, push_duration), strict=True):
        _draw_frame(chart, dataset.sel(push_time=at, method="nearest"), focus)
    course, running = bottom.subplots(1, 2)
    course.plot(1e3 * dataset["course_time"], 1e6 * dataset["focal_displacement"], color=COLOURS[0])
    course.axvspan(0.0, 1e3 * push_duration, color="0.92", zorder=0)
    tidy(course, x="time [ms]", y="displacement [µm]", title="at the geometric focus; shaded: the push")
    plane = dataset["displacement_map"].sel(z=focus, method="nearest").to_numpy()
    r, arrived = 1e3 * dataset["r"].to_numpy(), np.isfinite(dataset["shear_wave_arrival"].to_numpy())
    largest = np.maximum(np.abs(plane).max(axis=0), 1e-30)
    if arrived.any():  # beyond, the largest is none of the wave's
        largest[np.flatnonzero(arrived)[-1] :] = largest[arrived][-1]
    relative = plane / largest
    shown = running.pcolormesh(1e3 * time, r, relative.T, cmap="RdBu_r", vmin=-1.0, vmax=1.0, shading="gouraud")
    bottom.colorbar(shown, ax=running, label="displacement / largest at r (followed)")
    running.plot(1e3 * dataset["shear_wave_arrival"], r, color="black", linewidth=1.2)
    speed = dataset.attrs["shear_wave_speed_m_s"]
    told = f"black: arrival, {speed:.2f} m/s" if np.isfinite(speed) else "no wave has passed"
    tidy(running, x="time [ms]", y="radial distance r [mm]", title=f"in the focal plane; {told}")
    return figure


def _telling_times(time: np.ndarray, push_duration: float) -> np.ndarray:
    """The end of the push, and three times at which the wave has run on."""
    return push_duration + (time[-1] - push_duration) * np.array([0.0, 0.15, 0.4, 0.8])


def _draw_frame(chart: Axes, frame: xr.Dataset, focus: float) -> None:
    z, both, values = _mirrored(frame, "displacement_map")
    largest = max(1e6 * np.abs(values).max(), 1e-12)
    shown = chart.pcolormesh(
        both, z - 1e3 * focus, 1e6 * values.T, cmap="RdBu_r", vmin=-largest, vmax=largest, shading="gouraud"
    )
    chart.figure.colorbar(shown, ax=chart, orientation="horizontal", label="[µm]", ticks=MaxNLocator(3))
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    across, along = 500.0 * frame.attrs["lesion_diameter_m"], 500.0 * frame.attrs["lesion_length_m"]
    centre = 1e3 * (frame.attrs["lesion_centre_m"] - focus)
    if across > 0.0:
        chart.plot(across * np.cos(turn), centre + along * np.sin(turn), color="black", linewidth=1.0)
    chart.set_aspect("equal")
    tidy(chart, x="r [mm]", y="z - focus [mm]", title=f"t = {1e3 * float(frame['push_time']):.2f} ms")


def draw_temperature_maps(dataset: xr.Dataset, model: Model, times: list[float]) -> Figure:
    """Temperature at some times [s], with the contour of the lethal dose in white."""
    figure = new_figure(9.6, 2.2 + 1.9 * (len(times) > 3))
    columns = min(len(times), 3)
    charts = figure.subplots(-(-len(times) // columns), columns, sharex=True, sharey=True, squeeze=False)
    shown = dataset.sel(heating_time=times, method="nearest")
    temperature = shown["temperature"].to_numpy()
    lowest = np.floor(temperature.min())
    levels = np.linspace(lowest, max(np.ceil(temperature.max()), lowest + 1.0), 36)
    filled = ScalarMappable(Normalize(levels[0], levels[-1]), "inferno")
    for index, chart in enumerate(charts.flat):
        if index >= len(times):
            chart.set_visible(False)
            continue
        at = shown.isel(heating_time=index)
        z, both, values = _mirrored(at, "temperature")
        chart.contourf(z, both, values, levels, cmap="inferno")
        _draw_lesion(chart, at, colour="white")
        _draw_layers(chart, model, colour="0.7")
        _centre(chart, model)
        tidy(chart, x="z [mm]", y="r [mm]", title=f"{float(at['heating_time']):g} s")
        chart.label_outer()
    figure.suptitle(f"white: {LETHAL_DOSE_MINUTES:g} min at 43 °C; dashed: interfaces", fontsize="small", x=0.45)
    figure.colorbar(filled, ax=charts, label="temperature [°C]", ticks=MultipleLocator(5.0))
    return figure


def draw_sonication(dataset: xr.Dataset) -> Figure:
    """Temperature and dose at the focus, and the lesion's growth."""
    figure = new_figure(10.0, 3.3)
    curve, dose, lesion = figure.subplots(1, 3)
    time = dataset["heating_time"].to_numpy()
    curve.plot(time, dataset["peak_temperature"], color="0.6", label="anywhere")
    curve.plot(time, dataset["focal_temperature"], color=COLOURS[1], label="at the focus")
    curve.plot(time, dataset["thermocouple_temperature"], "--", color=COLOURS[0], label="thermocouple")
    for at in time[1:][np.diff(dataset["field_updates"].to_numpy()) > 0.0]:
        curve.axvline(at, ymax=0.03, color="0.3", linewidth=0.7)
    curve.legend(frameon=False, fontsize="small")
    tidy(curve, x="time [s]", y="temperature [°C]", title="ticks: field computed again")
    dose.semilogy(time[1:], dataset["focal_dose"][1:], color=COLOURS[1])
    dose.axhline(LETHAL_DOSE_MINUTES, color="0.6", linewidth=0.8, linestyle="--")
    dose.set_ylim(bottom=1e-2)
    tidy(dose, x="time [s]", y="dose [min at 43 °C]", title=f"at the focus; dashed: {LETHAL_DOSE_MINUTES:g} min")
    lesion.plot(time, 1e3 * dataset["lesion_length"], color=COLOURS[1], label="length [mm]")
    lesion.plot(time, 1e3 * dataset["lesion_diameter"], color=COLOURS[2], label="diameter [mm]")
    lesion.plot(time, 1e8 * dataset["lesion_volume"], color=COLOURS[3], label="volume [10 mm³]")
    lesion.legend(frameon=False, fontsize="small")
    tidy(lesion, x="time [s]", y="size", title="lesion")
    return figure


def draw_lesion_on_force(field: xr.Dataset, sonication: xr.Dataset, model: Model) -> Figure:
    """Radiation force at full power with the lesion's contour, at one time (the paper's figure of both)."""
    figure = new_figure(6.4, 3.4)
    chart = figure.subplots()
    z, both, force = _mirrored(field, "radiation_force_density")
    image = chart.pcolormesh(z, both, 1e-3 * force, cmap="viridis", shading="gouraud")
    image.set_rasterized(True)
    figure.colorbar(image, ax=chart, label="radiation force density at full power [kN/m³]")
    half = 0.5 * force.max()
    chart.contour(z, both, force, [half], colors="white", linewidths=1.0, linestyles="--")
    _draw_lesion(chart, sonication, colour=COLOURS[4])
    _centre(chart, model)
    title = f"t = {float(sonication['heating_time']):g} s; dashed: half the force; orange: {LETHAL_DOSE_MINUTES:g} min"
    tidy(chart, x="axial distance z [mm]", y="r [mm]", title=title)
    return figure


def _mirrored(dataset: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axial and radial positions [mm] and values of a map, with its mirror image below the axis."""
    radial, axial = (str(dimension) for dimension in dataset[name].dims)
    r, z = 1e3 * dataset[radial].to_numpy(), 1e3 * dataset[axial].to_numpy()
    values = dataset[name].to_numpy()
    first = 1 if r[0] == 0.0 else 0  # the axis itself has no mirror image
    return z, np.concatenate([-r[first:][::-1], r]), np.concatenate([values[first:][::-1], values])


def _draw_lesion(axes: Axes, dataset: xr.Dataset, *, colour: str) -> None:
    z, both, dose = _mirrored(dataset, "thermal_dose")
    level = np.log(np.maximum(dose, SMALLEST_DAMAGE) / LETHAL_DOSE_MINUTES)
    if level.max() > 0.0:
        axes.contour(z, both, level, [0.0], colors=colour, linewidths=1.3)


def _centre(axes: Axes, model: Model) -> None:
    focus = 1e3 * float(model.bowl.focal_length)
    axes.set_xlim(focus - 12.0, focus + 12.0)
    axes.set_ylim(-6.0, 6.0)
    axes.set_aspect("equal")


def _draw_layers(axes: Axes, model: Model, *, colour: str) -> None:
    depth = 0.0
    for layer in model.path:
        depth += 1e3 * layer.thickness
        axes.axvline(depth, color=colour, linewidth=0.7, linestyle="--")
