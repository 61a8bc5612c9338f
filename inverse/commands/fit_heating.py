"""`arfjax fit-heating`: fit heating and cooling to a course of temperature and write what came out."""

import csv
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import typer
import xarray as xr

import arfjax
from arfjax import InputError
from inverse.commands.console import show_lines, show_table, working
from inverse.datasets.table import unused
from inverse.datasets.thermometry import HOTTEST, read_thermometry
from inverse.figures import heating_figure
from inverse.output import output_directory, quantity, recorded, write_figures, write_summary
from inverse.seeds import HIGHEST_SEED
from inverse.thermometry_fit import HeatingFit, fit_heating
from inverse.thermometry_model import CONSTANTS, COURSE_ACCURACY

_HEADER = ("constant", "unit", "estimate", "standard error")
_MEANING = {
    "amplitude": "rise of the mean when the heat is switched off",
    "diffusion_time": "a²/(4κ), from the squared radius of source and region over the diffusivity",
    "diffusion_time_ratio": "b²/a², the same along the beam over that across it",
    "start": "when the heat is switched on",
    "duration": "for how long it is on",
}
_LIMITS = (
    "Radius and diffusivity enter only as a²/(4κ): the diffusion time fixes neither of them by itself. The region over "
    "which the mean is taken and the source widen the course alike: a is that of both together.",
    "The medium is taken to be uniform, without blood flow and without walls, the source to be Gaussian.",
)


def fit_heating_command(
    data: Annotated[Path, typer.Argument(help="CSV file: time and mean temperature of a heated region.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    baseline: Annotated[
        float | None, typer.Option(help="Temperature before heating [degC]; that of the first row if not given.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the starts.", min=0, max=HIGHEST_SEED)] = 0,
    starts: Annotated[int, typer.Option(help="Starts of the fit.", min=1)] = 4,
    trust_units: Annotated[bool, typer.Option("--trust-units", help="Believe units that look wrong.")] = False,
) -> None:
    """Fit amplitude, width, start and duration of heating to a course of temperature.

    Writes parameters.csv, fit.nc, a figure (PNG and PDF), summary.json and report.md into the folder `out`.
    """
    jax.config.update("jax_enable_x64", True)
    if baseline is not None and not 0.0 <= baseline <= HOTTEST:
        raise InputError(f"`--baseline` must be a temperature from 0 to {HOTTEST:g} degC, got {baseline}.")
    measured, inputs = read_thermometry(data, trust_units=trust_units), recorded({"data": data})
    with output_directory(out) as folder:
        with working("compiling the simulation and its derivatives") as say:
            fit = fit_heating(measured, baseline=baseline, seed=seed, n_starts=starts, on_step=say)
            say("figure")
            figures = write_figures(folder, {"heating": heating_figure(fit)})
        _write_parameters(folder / "parameters.csv", fit)
        _dataset(fit).to_netcdf(folder / "fit.nc", engine="h5netcdf")
        (folder / "report.md").write_text(_report(fit, figures), encoding="utf-8")
        write_summary(
            folder,
            command="fit-heating",
            inputs=inputs,
            seed=seed,
            settings={"baseline": baseline, "starts": starts, "trust_units": trust_units},
            results=_results(fit),
        )
    show_table("heating", _HEADER, _rows(fit), left=2)
    show_lines([*_notes(fit), *fit.warnings, f"written to {out}"])


def _rows(fit: HeatingFit) -> list[tuple[str, ...]]:
    """Name, unit, estimate and standard error; an estimate that the data do not fix is marked."""
    unsure = fit.uncertainty.not_identified
    return [
        (name, unit, f"{value:.4g}{' ?' if name in unsure else ''}", f"{error:.2g}")
        for (name, unit, _), value, error in zip(CONSTANTS, fit.values, fit.uncertainty.standard_errors, strict=True)
    ]


def _write_parameters(path: Path, fit: HeatingFit) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["constant", "unit", "estimate", "standard_error", "identified"])
        for (name, unit, _), value, error in zip(CONSTANTS, fit.values, fit.uncertainty.standard_errors, strict=True):
            identified = str(name not in fit.uncertainty.not_identified).lower()
            writer.writerow([name, unit, f"{value:.8g}", f"{error:.4g}", identified])


def _dataset(fit: HeatingFit) -> xr.Dataset:
    """Measured and fitted temperature by row, constants with errors and correlations, all with units."""
    names = [name for name, _, _ in CONSTANTS]
    dataset = xr.Dataset(
        coords={
            "time": ("time", fit.data.time, {"units": "s"}),
            "constant": ("constant", np.array(names, dtype=object), {"long_name": "name of the fitted constant"}),
            "constant_unit": ("constant", np.array([unit for _, unit, _ in CONSTANTS], dtype=object)),
        },
        attrs={
            "title": "heating and cooling fitted to a course of temperature",
            "arfjax_version": arfjax.__version__,
            "baseline_degc": fit.baseline,
        },
    )
    dataset["measured_temperature"] = ("time", fit.data.temperature, {"units": "degC"})
    dataset["fitted_temperature"] = ("time", fit.fitted, {"units": "degC"})
    dataset["residual"] = ("time", fit.residuals, {"units": "K", "long_name": "measured minus fitted"})
    dataset["fitted_row"] = ("time", fit.used.astype(np.int8), {"long_name": "1 where the row was fitted"})
    dataset["value"] = ("constant", fit.values, {"long_name": "estimate, in constant_unit"})
    dataset["standard_error"] = (
        "constant",
        fit.uncertainty.standard_errors,
        {"long_name": "standard error, in constant_unit"},
    )
    dataset["correlation"] = (("constant", "other_constant"), fit.uncertainty.correlation, {"units": "1"})
    return dataset


def _notes(fit: HeatingFit) -> list[str]:
    left_out = int(np.sum(~fit.used))
    notes = [
        f"The fit {fit.status}." if fit.converged else f"THE FIT DID NOT CONVERGE: {fit.status}.",
        f"{int(np.sum(fit.used))} rows fitted, {left_out} left out as occluded; rises are counted from "
        f"{fit.baseline:g} degC; data minus fit {fit.rms:.3g} K root mean square, noise {fit.noise_sd:.3g} K.",
    ]
    return [*notes, *unused(fit.data.ignored)]


def _results(fit: HeatingFit) -> dict[str, object]:
    return {
        "constants": {
            name: quantity(float(value), unit, float(error))
            for (name, unit, _), value, error in zip(
                CONSTANTS, fit.values, fit.uncertainty.standard_errors, strict=True
            )
        },
        "correlation": fit.uncertainty.correlation.tolist(),
        "diffusion_time_ratio_95_percent": {"lower": fit.ratio_range[0], "upper": fit.ratio_range[1], "unit": "1"},
        "not_identified": list(fit.uncertainty.not_identified),
        "baseline": quantity(fit.baseline, "degC"),
        "rms": quantity(fit.rms, "K"),
        "noise_sd": quantity(fit.noise_sd, "K"),
        "residual_autocorrelation": quantity(fit.autocorrelation, "1"),
        "course_accuracy": quantity(COURSE_ACCURACY, "1"),
        "n_rows": len(fit.data),
        "n_fitted": int(np.sum(fit.used)),
        "n_starts": fit.n_starts,
        "n_agreeing": fit.n_agreeing,
        "converged": fit.converged,
        "status": fit.status,
        "warnings": list(fit.warnings),
    }


def _report(fit: HeatingFit, figures: list[str]) -> str:
    names = [name for name, _, _ in CONSTANTS]
    lines = [
        f"# Heating fitted to {fit.data.path.name}",
        "",
        *(f"- {note}" for note in _notes(fit)),
        "",
        "## Constants",
        "",
        "Value and standard error; `?` marks a constant that the data do not fix.",
        "",
        "| " + " | ".join(_HEADER) + " | meaning |",
        "| --- | --- | ---: | ---: | --- |",
        *("| " + " | ".join((*row, _MEANING[row[0]])) + " |" for row in _rows(fit)),
        "",
        "## Correlations",
        "",
        "| | " + " | ".join(names) + " |",
        "| --- |" + " ---: |" * len(names),
        *(
            f"| {name} | " + " | ".join(f"{value:+.2f}" for value in row) + " |"
            for name, row in zip(names, fit.uncertainty.correlation, strict=True)
        ),
        "",
        "## What these numbers cannot tell",
        "",
        *(f"- {sentence}" for sentence in (*fit.warnings, *_LIMITS)),
        f"- The simulated course is within {100.0 * COURSE_ACCURACY:g} % of the amplitude of the exact one.",
        "",
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n".join(lines) + "\n"
