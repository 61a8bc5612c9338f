"""Figures of a calibration to HMI data."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from arfjax.figures import COLOURS, new_figure, tidy
from inverse.datasets.hmi import HmiData
from inverse.hmi_fit import HmiFit

MARKERS = "os^Dv<>p"


def draw_calibration(measured: HmiData, fit: HmiFit, curves: xr.Dataset) -> Figure:
    """Data with the curves before and after, the fitted attenuation, and how far each constant moved."""
    figure = new_figure(10.5, 3.6)
    data, attenuation, constants = figure.subplots(1, 3, width_ratios=[1.35, 1.0, 0.9])
    _draw_data(data, measured, fit, curves)
    _draw_attenuation(attenuation, fit)
    _draw_constants(constants, fit)
    return figure


def draw_measured(axes: Axes, measured: HmiData, temperature: np.ndarray, values: np.ndarray) -> None:
    """The measured values, a marker a sonication."""
    for number, label in enumerate(measured.labels):
        rows = measured.rows_of(label)
        axes.plot(
            temperature[rows],
            values[rows],
            MARKERS[number % len(MARKERS)],
            color="0.25",
            markerfacecolor="white",
            markersize=5.5,
            zorder=4,
            label=f"sonication {label}",
        )


def _draw_data(axes: Axes, measured: HmiData, fit: HmiFit, curves: xr.Dataset) -> None:
    name, unit, scale = ("displacement_percent", "%", 1.0) if measured.in_percent else ("displacement", "µm", 1e6)
    temperature = curves["step_temperature"].to_numpy()
    rows = temperature_of_rows(measured, curves)
    noise = scale * float(np.mean(fit.noise_sd))
    after = scale * curves[name].sel(stage="after").to_numpy()
    before = scale * curves[name].sel(stage="before").to_numpy()
    label = f"± {noise:.2g} {unit}, {'estimated' if fit.noise_estimated else 'stated'} scatter"
    axes.fill_between(temperature, after - noise, after + noise, color=COLOURS[0], alpha=0.15, linewidth=0, label=label)
    axes.plot(temperature, before, "--", color="0.55", label="before")
    axes.plot(temperature, after, color=COLOURS[0], label="calibrated")
    draw_measured(axes, measured, rows, scale * measured.displacement)
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize="x-small", loc="lower left")
    reference = curves.attrs.get("reference_temperature_degc")
    of = f" of {reference:g} °C" if measured.in_percent and reference is not None else ""
    tidy(axes, x="temperature [°C]", y=f"displacement [{unit}{of}]", title="HMI displacement")


def temperature_of_rows(measured: HmiData, curves: xr.Dataset) -> np.ndarray:
    """Temperature of every row [degC], that of the simulated heating where the file gives only times."""
    if measured.temperature is not None:
        return measured.temperature
    assert measured.time is not None  # the reader asks for time or temperature
    after = curves.sel(stage="after")
    return np.interp(measured.time, after["sonication_time"].to_numpy(), after["step_temperature"].to_numpy())


def _draw_attenuation(axes: Axes, fit: HmiFit) -> None:
    anchors = fit.constants.anchors
    temperature = np.linspace(anchors[0], anchors[-1], 200)
    number = len(anchors)
    prior = np.asarray([float(parameter.transform.forward(0.0)) for parameter in fit.constants.parameters[:number]])
    before = np.polynomial.Polynomial(np.linalg.solve(np.vander(anchors, increasing=True), prior))
    axes.plot(temperature, before(temperature), "--", color="0.55", label="before")
    axes.plot(
        temperature, np.polynomial.Polynomial(fit.coefficients)(temperature), color=COLOURS[1], label="calibrated"
    )
    axes.errorbar(
        anchors,
        fit.values[:number],
        fit.standard_errors[:number],
        fmt="o",
        color=COLOURS[1],
        markersize=4.0,
        capsize=2.0,
    )
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize="x-small", loc="upper left")
    tidy(axes, x="temperature [°C]", y="attenuation [% of tabulated]", title="attenuation of liver")


def _draw_constants(axes: Axes, fit: HmiFit) -> None:
    """Shift of each constant's logarithm in prior standard deviations, with its error: all at 0 ± 1 before."""
    prior = np.asarray([float(parameter.transform.forward(0.0)) for parameter in fit.constants.parameters])
    prior_sd = np.linalg.norm(fit.constants.prior_factor, axis=1)
    shift = np.log(fit.values / prior) / prior_sd
    places = np.arange(len(shift))[::-1]
    axes.axvspan(-1.0, 1.0, color="0.93", zorder=0)
    axes.axvline(0.0, color="0.75", linewidth=0.8, zorder=1)
    axes.errorbar(shift, places, xerr=fit.shrinkage, fmt="o", color=COLOURS[2], markersize=4.0, capsize=2.0)
    axes.set_yticks(places, [parameter.label for parameter in fit.constants.parameters], fontsize="x-small")
    tidy(axes, x="shift [prior standard deviations]", y="", title="constants, prior shaded")
