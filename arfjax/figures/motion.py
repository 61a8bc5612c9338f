"""Pictures of displacement."""

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator

from arfjax.figures.style import COLOURS, mirrored, new_figure, tidy
from arfjax.model import Model


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
    z, both, values = mirrored(frame, "displacement_map")
    largest = max(1e6 * np.abs(values).max(), 1e-12)
    shown = chart.pcolormesh(
        both, z - 1e3 * focus, 1e6 * values.T, cmap="RdBu_r", vmin=-largest, vmax=largest, shading="gouraud"
    )
    chart.figure.colorbar(shown, ax=chart, orientation="horizontal", label="[µm]", ticks=MaxNLocator(3))
    across, along = _outline(frame)
    chart.plot(across, along - 1e3 * focus, color="black", linewidth=1.0)
    chart.set_aspect("equal")
    tidy(chart, x="r [mm]", y="z - focus [mm]", title=f"t = {1e3 * float(frame['push_time']):.2f} ms")


def draw_vibration(dataset: xr.Dataset, model: Model) -> Figure:
    """Map of peak-to-peak displacement with the lesion's outline; one period at the focus with the force's course."""
    figure = new_figure(9.4, 3.5)
    chart, course = figure.subplots(1, 2, width_ratios=[1.45, 1.0])
    focus = 1e3 * float(model.bowl.focal_length)
    z, both, values = mirrored(dataset, "peak_to_peak_displacement")
    shown = chart.pcolormesh(z, both, 1e6 * values, cmap="viridis", vmin=0.0, shading="gouraud")
    shown.set_rasterized(True)
    figure.colorbar(shown, ax=chart, label="peak-to-peak displacement [µm]")
    across, along = _outline(dataset)
    chart.plot(along, across, color="black", linewidth=1.2)
    chart.plot(focus, 0.0, "+", color="black", markersize=7)
    chart.set_xlim(max(focus - 15.0, z[0]), min(focus + 15.0, z[-1]))
    chart.set_ylim(-10.0, 10.0)
    chart.set_aspect("equal")
    chart.yaxis.set_major_locator(MultipleLocator(5.0))
    told = "black: lesion, +: geometric focus" if across.size else "+: geometric focus"
    tidy(chart, x="axial distance z [mm]", y="r [mm]", title=f"{dataset.attrs['modulation_frequency_hz']:g} Hz; {told}")
    time = 1e3 * dataset["modulation_time"].to_numpy()
    force, motion = dataset["relative_force"].to_numpy(), 1e6 * dataset["focal_vibration"].to_numpy()
    beside = course.twinx()
    beside.fill_between(time, force, color="0.88", linewidth=0.0)
    beside.set_ylim(0.0, 1.05)
    beside.set_ylabel("force / largest (grey)", color="0.4")
    beside.spines[["top"]].set_visible(False)
    course.set_zorder(beside.get_zorder() + 1)  # the motion in front of the force
    course.set_facecolor("none")
    course.plot(time, motion, color=COLOURS[0])
    course.axhline(0.0, color="0.7", linewidth=0.8, zorder=0)
    course.set_xlim(time[0], time[-1])
    tidy(course, x="time [ms]", y="displacement from its mean [µm]", title="one period at the geometric focus")
    return figure


def _outline(dataset: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Radial and axial positions [mm] around the lesion; none without one."""
    across, along = 500.0 * dataset.attrs["lesion_diameter_m"], 500.0 * dataset.attrs["lesion_length_m"]
    turn = np.linspace(0.0, 2.0 * np.pi, 181 if across > 0.0 else 0)
    return across * np.cos(turn), 1e3 * dataset.attrs["lesion_centre_m"] + along * np.sin(turn)


def draw_monitoring(dataset: xr.Dataset) -> Figure:
    """Displacement over time with temperature beside it, over temperature, and the lesion that grows meanwhile."""
    figure = new_figure(10.2, 3.3)
    course, curve, lesion = figure.subplots(1, 3)
    time = dataset["heating_time"].to_numpy()
    percent = dataset["tracked_displacement_percent"].to_numpy()
    temperature = dataset["thermocouple_temperature"].to_numpy()
    reference = dataset.attrs["reference_temperature_degc"]
    course.plot(time, percent, color=COLOURS[0])
    beside = course.twinx()
    beside.plot(time, temperature, color=COLOURS[3], linewidth=1.0)
    beside.set_ylabel("thermocouple [°C]", color=COLOURS[3])
    beside.spines[["top"]].set_visible(False)
    tidy(course, x="time [s]", y=f"displacement [% of {reference:.3g} °C]", title="as it is watched")
    heating = np.arange(len(time)) <= int(np.argmax(temperature))
    curve.plot(temperature[heating], percent[heating], color=COLOURS[0], label="heating")
    if not heating.all():
        curve.plot(temperature[~heating], percent[~heating], color=COLOURS[0], linestyle=":", label="cooling")
    curve.axhline(100.0, color="0.8", linewidth=0.8, zorder=0)
    lethal = np.flatnonzero(dataset["lesion_length"].to_numpy() > 0.0)
    if lethal.size:
        curve.plot(temperature[lethal[0]], percent[lethal[0]], "o", color=COLOURS[1], label="lesion appears")
    curve.legend(frameon=False)
    tidy(curve, x="thermocouple [°C]", y=f"displacement [% of {reference:.3g} °C]", title="over temperature")
    lesion.plot(time, 1e3 * dataset["lesion_length"], color=COLOURS[1], label="length")
    lesion.plot(time, 1e3 * dataset["lesion_diameter"], color=COLOURS[2], label="diameter")
    lesion.legend(frameon=False)
    tidy(lesion, x="time [s]", y="size [mm]", title="lesion by dose")
    return figure
