"""`arfjax calibrate`: fit attenuation and lesion constants to HMI data and write what came out."""

import csv
import dataclasses
from pathlib import Path
from typing import Annotated

import jax.numpy as jnp
import numpy as np
import pydantic
import typer
import xarray as xr

import arfjax
from arfjax import (
    Discretisation,
    Experiment,
    InputError,
    Model,
    explain,
    range_notes,
    read_experiment,
    run_stepwise,
)
from arfjax.io import stepwise_dataset, write_netcdf
from arfjax.numerics.compiled import compiled
from inverse.commands.console import show_lines, show_table, working
from inverse.commands.notes import grid_notes, sound_notes
from inverse.datasets.hmi import HmiData, read_hmi
from inverse.figures import draw_calibration
from inverse.hmi_fit import CalibrationSettings, HmiFit, fit_hmi
from inverse.least_squares import Descent
from inverse.output import output_directory, quantity, recorded, write_figures, write_summary


def calibrate(
    experiment: Annotated[Path, typer.Argument(help="Experiment file (TOML).")],
    hmi: Annotated[Path, typer.Option(help="CSV file: sonication, time or temperature, displacement.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    max_steps: Annotated[int, typer.Option(help="Steps after which the optimisation stops.", min=1)] = 30,
) -> None:
    """Fit attenuation and lesion constants to HMI measurements.

    Writes parameters.csv, calibration.nc, figures (PNG and PDF), report.md and summary.json into the folder `out`.
    """
    described = read_experiment(experiment)
    settings = _settings(described, experiment)
    measured, inputs = read_hmi(hmi), recorded({"experiment": experiment, "hmi": hmi})
    model = described.model()
    with output_directory(out) as folder:
        with working("compiling the simulation chain and its gradient") as say:
            discretisation = described.discretised(model)
            fit = fit_hmi(
                model,
                measured,
                described.stepwise(),
                discretisation,
                settings,
                on_step=lambda step, cost: say(f"fitting: step {step}, cost {cost:.4g}"),
                max_steps=max_steps,
            )
            say("curves before and after")
            curves = _curves(model, fit, measured, described, settings, discretisation)
        _write_parameters(folder / "parameters.csv", fit)
        write_netcdf(curves, folder / "calibration.nc")
        figures = write_figures(folder, {"calibration": draw_calibration(measured, fit, curves)})
        notes = _notes(fit, measured, curves, discretisation)
        (folder / "report.md").write_text(_report(described, measured, fit, figures, notes), encoding="utf-8")
        write_summary(
            folder,
            command="calibrate",
            inputs=inputs,
            settings={"calibration": settings.model_dump(), "max_steps": max_steps},
            results=_results(fit, measured),
        )
    show_table("constants", _HEADER, _rows(fit))
    show_lines([*notes, f"written to {out}"])


def _settings(described: Experiment, path: Path) -> CalibrationSettings:
    try:
        return CalibrationSettings.model_validate(described.calibration)
    except pydantic.ValidationError as error:
        raise InputError(f"{path}: [calibration] {explain(error, CalibrationSettings)}") from None


def _curves(
    model: Model,
    fit: HmiFit,
    measured: HmiData,
    described: Experiment,
    settings: CalibrationSettings,
    discretisation: Discretisation,
) -> xr.Dataset:
    """Displacement before and after for a sonication to the highest temperature measured, with the constants.

    Sonications that end lower have heated longer at a given temperature, so that their curve is another.
    """
    protocol = described.stepwise()
    highest = protocol.final_temperature if measured.temperature is None else float(measured.temperature.max())
    protocol = dataclasses.replace(protocol, final_temperature=highest)
    reference = settings.reference_temperature_c
    temperatures = np.union1d(np.linspace(protocol.start_temperature, highest, 26), [reference])
    run = compiled(lambda model: run_stepwise(model, jnp.asarray(temperatures), protocol, discretisation))
    states = [stepwise_dataset(run(each), protocol, reference) for each in (model, fit.model)]
    curves = xr.concat(states, xr.DataArray(["before", "after"], dims="stage", name="stage"))
    curves.attrs |= {"title": described.title, "arfjax_version": arfjax.__version__}
    names = [parameter.name for parameter in fit.constants.parameters]
    units = [parameter.unit for parameter in fit.constants.parameters]
    label = {"long_name": "name of the fitted constant"}
    return curves.assign_coords(constant=("constant", names, label), constant_unit=("constant", units)).assign(
        constant_value=("constant", fit.values, {"long_name": "most probable value, in constant_unit"}),
        constant_standard_error=("constant", fit.standard_errors, {"long_name": "standard error, in constant_unit"}),
        constant_correlation=(("constant", "other_constant"), fit.correlation, {"units": "1"}),
    )


_SIMULATED = (
    "What is compared: one short push at each temperature, {kind} sound at {frequency:g} MHz, heat with the blood flow "
    "of the experiment file. Measured HMI is oscillation under modulated sound, often of another transducer: read the "
    "constants as those with which this simulation has the measured shape."
)
_HEADER = ("constant", "unit", "prior", "estimate", "standard error", "error / prior's")


def _rows(fit: HmiFit) -> list[tuple[str, ...]]:
    prior = np.asarray(fit.constants.values(jnp.zeros(len(fit.values))))
    return [
        (parameter.name, parameter.unit, f"{before:.4g}", f"{value:.4g}", f"{error:.2g}", f"{ratio:.2f}")
        for parameter, before, value, error, ratio in zip(
            fit.constants.parameters, prior, fit.values, fit.standard_errors, fit.shrinkage, strict=True
        )
    ]


def _coefficients(fit: HmiFit) -> list[tuple[str, str, float, float]]:
    units = ["percent", "percent/K", "percent/K^2", "percent/K^3", "percent/K^4"]
    return [
        (f"attenuation_p{order}", unit, value, error)
        for order, (unit, value, error) in enumerate(
            zip(units, fit.coefficients.tolist(), fit.coefficient_errors.tolist(), strict=True)
        )
    ]


def _write_parameters(path: Path, fit: HmiFit) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["constant", "unit", "estimate", "standard_error", "error_over_prior", "identified"])
        for parameter, value, error, ratio in zip(
            fit.constants.parameters, fit.values, fit.standard_errors, fit.shrinkage, strict=True
        ):
            identified = "no" if parameter.name in fit.not_identified else "yes"
            writer.writerow(
                [parameter.name, parameter.unit, f"{value:.8g}", f"{error:.4g}", f"{ratio:.4f}", identified]
            )
        for name, unit, value, error in _coefficients(fit):
            writer.writerow([name, unit, f"{value:.8g}", f"{error:.4g}", "", ""])


def _misfit(fit: HmiFit, measured: HmiData) -> tuple[float, float, str]:
    """Root mean square of measured minus simulated before and after, and its unit."""
    before = float(np.sqrt(np.mean((fit.before - measured.displacement) ** 2)))
    after = float(np.sqrt(np.mean((fit.after - measured.displacement) ** 2)))
    return (before, after, "percent") if measured.in_percent else (1e6 * before, 1e6 * after, "um")


def ending(descent: Descent) -> str:
    """How the optimisation ended, and what to do where it did not converge."""
    if descent.converged:
        return f"The optimisation {descent.message}."
    more = ", or allow more by --max-steps" if descent.out_of_steps else ""
    return f"THE OPTIMISATION DID NOT CONVERGE: it {descent.message}{more}."


def _notes(fit: HmiFit, measured: HmiData, curves: xr.Dataset, settings: Discretisation) -> list[str]:
    before, after, unit = _misfit(fit, measured)
    notes = [
        ending(fit.descent),
        f"Root-mean-square misfit {before:.3g} {unit} before, {after:.3g} {unit} after; "
        f"the data determine {fit.determined:.1f} of {len(fit.values)} constants.",
    ]
    if fit.noise_estimated:
        scale = 1.0 if measured.in_percent else 1e6
        notes.append(
            f"The file gives no standard deviations; {scale * float(fit.noise_sd[0]):.3g} {unit} was estimated with "
            "the fit, differences between sonications included."
        )
    notes += fit.not_identified.values()
    after = curves.sel(stage="after")
    notes += sound_notes(settings) + grid_notes(fit.model)
    notes += range_notes(fit.model, after["step_temperature"].to_numpy(), after["lesion_length"].to_numpy())
    if not fit.noise_settled:
        notes.append("THE ESTIMATE OF THE SCATTER DID NOT SETTLE; give standard deviations in the file.")
    kind = "linear" if settings.march.n_harmonics == 1 else "nonlinear"
    notes.append(_SIMULATED.format(kind=kind, frequency=1e-6 * float(fit.model.drive.frequency)))
    return [*notes, *measured.remarks]


def _results(fit: HmiFit, measured: HmiData) -> dict[str, object]:
    before, after, unit = _misfit(fit, measured)
    constants = {
        parameter.name: quantity(float(value), parameter.unit, float(error)) | {"error_over_prior": float(ratio)}
        for parameter, value, error, ratio in zip(
            fit.constants.parameters, fit.values, fit.standard_errors, fit.shrinkage, strict=True
        )
    }
    coefficients = {name: quantity(value, unit, error) for name, unit, value, error in _coefficients(fit)}
    return {
        "constants": constants,
        "attenuation_coefficients": coefficients,
        "correlation": fit.correlation.tolist(),
        "not_identified": list(fit.not_identified),
        "converged": fit.descent.converged,
        "status": fit.descent.message,
        "rms_misfit_before": quantity(before, unit),
        "rms_misfit_after": quantity(after, unit),
        "noise_estimated": fit.noise_estimated,
        "noise_settled": fit.noise_settled,
        "determined_constants": fit.determined,
        "attenuation_level_error_over_prior": fit.level_shrinkage,
        "rows": [
            {
                "sonication": label,
                "temperature_degc": None if measured.temperature is None else float(measured.temperature[row]),
                "time_s": None if measured.time is None else float(measured.time[row]),
                "measured": float(measured.displacement[row]),
                "standard_deviation": float(fit.noise_sd[row]),
                "before": float(fit.before[row]),
                "after": float(fit.after[row]),
                "unit": "percent" if measured.in_percent else "m",
            }
            for row, label in enumerate(measured.sonication)
        ],
    }


def _report(described: Experiment, measured: HmiData, fit: HmiFit, figures: list[str], notes: list[str]) -> str:
    names = [parameter.name for parameter in fit.constants.parameters]
    lines = [
        f"# Calibration: {described.title}",
        "",
        f"{len(measured.displacement)} values from {len(measured.labels)} sonications ({measured.path.name}).",
        "",
        *(f"- {note}" for note in notes),
        "",
        "## Constants",
        "",
        "| " + " | ".join(_HEADER) + " |",
        "| --- | --- |" + " ---: |" * 4,
        *("| " + " | ".join(row) + " |" for row in _rows(fit)),
        "",
        "Attenuation is fitted through its values at five temperatures, in percent of the tissue's 1 MHz value; they "
        "make the coefficients of the polynomial, whose errors are strongly correlated:",
        "",
        "| coefficient | unit | estimate | standard error |",
        "| --- | --- | ---: | ---: |",
        *(f"| {name} | {unit} | {value:.5g} | {error:.2g} |" for name, unit, value, error in _coefficients(fit)),
        "",
        "## Correlations",
        "",
        "| | " + " | ".join(str(number) for number in range(1, len(names) + 1)) + " |",
        "| --- |" + " ---: |" * len(names),
        *(
            f"| {number} {name} | " + " | ".join(f"{value:+.2f}" for value in row) + " |"
            for number, (name, row) in enumerate(zip(names, fit.correlation, strict=True), start=1)
        ),
        "",
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n".join(lines) + "\n"
