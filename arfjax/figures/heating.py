"""Pictures of heating and of the lesion that it makes."""

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from arfjax.figures.style import COLOURS, centre_on_focus, draw_layers, draw_lesion, mirrored, new_figure, tidy
from arfjax.model import Model
from arfjax.thermal.dose import LETHAL_DOSE_MINUTES


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
    draw_layers(chart, model, colour="white")
    tidy(chart, x="axial distance z [mm]", y="r [mm]", title=f"at the end; white: {LETHAL_DOSE_MINUTES:g} min at 43 °C")
    return figure


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
        z, both, values = mirrored(at, "temperature")
        chart.contourf(z, both, values, levels, cmap="inferno")
        draw_lesion(chart, at, colour="white")
        draw_layers(chart, model, colour="0.7")
        centre_on_focus(chart, model)
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
    z, both, force = mirrored(field, "radiation_force_density")
    image = chart.pcolormesh(z, both, 1e-3 * force, cmap="viridis", shading="gouraud")
    image.set_rasterized(True)
    figure.colorbar(image, ax=chart, label="radiation force density at full power [kN/m³]")
    half = 0.5 * force.max()
    chart.contour(z, both, force, [half], colors="white", linewidths=1.0, linestyles="--")
    draw_lesion(chart, sonication, colour=COLOURS[4])
    centre_on_focus(chart, model)
    title = f"t = {float(sonication['heating_time']):g} s; dashed: half the force; orange: {LETHAL_DOSE_MINUTES:g} min"
    tidy(chart, x="axial distance z [mm]", y="r [mm]", title=title)
    return figure
