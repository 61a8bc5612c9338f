"""`arfjax fit-dma`: fit Zener solids to a dynamic mechanical analysis and write what came out."""

import csv
import enum
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import typer
import xarray as xr

from arfjax import InputError
from inverse.commands.console import show_lines, show_table, working
from inverse.datasets.dma import DmaData, read_dma, sweeps_of_file
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL, DmaFit, NoFit, SweepFit, fit_sweeps
from inverse.dma_residuals import LinearModulus, LogModulus, ModulusResidual
from inverse.figures import dma_figure
from inverse.output import figure_files, output_directory, quantity, recorded, write_figures, write_summary
from inverse.seeds import HIGHEST_SEED


class ModelChoice(enum.StrEnum):
    """Which solids to fit."""

    BOTH = "both"
    ZENER = "zener"
    FRACTIONAL = "fractional"


class ResidualChoice(enum.StrEnum):
    """How to compare model and measurement."""

    LOG = "log"
    LINEAR = "linear"
    BOTH = "both"


_MODELS = {
    ModelChoice.BOTH: (CONVENTIONAL, FRACTIONAL),
    ModelChoice.ZENER: (CONVENTIONAL,),
    ModelChoice.FRACTIONAL: (FRACTIONAL,),
}
_RESIDUALS: dict[ResidualChoice, tuple[ModulusResidual, ...]] = {
    ResidualChoice.BOTH: (LogModulus(), LinearModulus()),
    ResidualChoice.LOG: (LogModulus(),),
    ResidualChoice.LINEAR: (LinearModulus(),),
}
_MADE = figure_files(f"fit_{residual.name}" for residual in _RESIDUALS[ResidualChoice.BOTH])
"""What some runs make and others do not."""
_SUMS = (("sse_log", "1"), ("sse_linear", "Pa^2"), ("sse_relative", "1"))


def fit_dma(
    data: Annotated[Path, typer.Argument(help="CSV file: frequency, temperature, storage and loss modulus.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    model: Annotated[ModelChoice, typer.Option(help="Solid to fit.")] = ModelChoice.BOTH,
    residuals: Annotated[ResidualChoice, typer.Option(help="Compare log modulus or modulus.")] = ResidualChoice.BOTH,
    magnitude: Annotated[bool, typer.Option("--magnitude", help="Fit the magnitude alone, without phase.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of the starts.", min=0, max=HIGHEST_SEED)] = 0,
    starts: Annotated[int, typer.Option(help="Starts of each fit.", min=1)] = 16,
    trust_units: Annotated[bool, typer.Option("--trust-units", help="Believe units that look wrong.")] = False,
) -> None:
    """Fit the conventional and the fractional Zener solid to every temperature of a DMA file.

    Writes parameters.csv, fit.nc, figures (PNG and PDF), summary.json and report.md into the folder `out`.
    """
    jax.config.update("jax_enable_x64", True)
    measured = read_dma(data, trust_units=trust_units, magnitude_only=magnitude)
    inputs = recorded({"data": data})
    sweeps = sweeps_of_file(data, measured)
    chosen = _RESIDUALS[residuals]
    with output_directory(out, replaces=_MADE) as folder:
        with working(f"fitting {len(sweeps)} sweeps"):
            fit = fit_sweeps(sweeps, models=_MODELS[model], residuals=chosen, seed=seed, n_starts=starts)
        if not fit.fits and not any(one.means for one in fit.unfitted):
            raise InputError(f"{data}: nothing can be fitted. {fit.unfitted[0].sweep.label}: {fit.unfitted[0].reason}.")
        _write_parameters(folder / "parameters.csv", fit)
        _dataset(fit, chosen).to_netcdf(folder / "fit.nc", engine="h5netcdf")
        figures = write_figures(
            folder, {f"fit_{residual.name}": dma_figure(fit, residual) for residual in chosen if fit.fits}
        )
        (folder / "report.md").write_text(_report(data, measured, fit, figures), encoding="utf-8")
        write_summary(
            folder,
            command="fit-dma",
            inputs=inputs,
            seed=seed,
            settings={
                "model": model.value,
                "residuals": residuals.value,
                "magnitude": magnitude,
                "starts": starts,
                "trust_units": trust_units,
            },
            results=_results(fit),
        )
    _show(fit, measured, out)


def _write_parameters(path: Path, fit: DmaFit) -> None:
    columns = (
        "sample temperature_c model residuals parameter unit estimate standard_error identified "
        "sse_log sse_linear_pa2 sse_relative n_points n_starts n_agreeing converged"
    ).split()
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for one in fit.fits:
            for (name, unit, _), value, error in zip(
                one.model.constants(), one.values, one.uncertainty.standard_errors, strict=True
            ):
                place = [one.sweep.sample, f"{one.sweep.temperature_c:.3f}", one.model.name, one.residual.name]
                identified = str(name not in one.uncertainty.not_identified).lower()
                sums = [f"{getattr(one, kind):.6g}" for kind, _ in _SUMS]
                counts = [one.n_points, one.n_starts, one.n_agreeing, str(one.converged).lower()]
                writer.writerow([*place, name, unit, f"{value:.8g}", f"{error:.4g}", identified, *sums, *counts])


def _dataset(fit: DmaFit, residuals: tuple[ModulusResidual, ...]) -> xr.Dataset:
    """Measured and fitted modulus by sweep and point, fitted constants by sweep, all with units."""
    number, length = len(fit.sweeps), max(len(sweep.data) for sweep in fit.sweeps)
    index = {id(sweep): row for row, sweep in enumerate(fit.sweeps)}
    dataset = xr.Dataset(
        coords={
            "temperature": ("sweep", [s.temperature_c for s in fit.sweeps], {"units": "degC"}),
            "sample": ("sweep", np.array([s.sample for s in fit.sweeps], dtype=object)),
            "residuals": ("residuals", np.array([r.name for r in residuals], dtype=object)),
        },
        attrs={
            "title": "Zener solids fitted to dynamic mechanical analysis",
            "padding": "NaN where a sweep is shorter",
        },
    )

    def padded(name: str) -> np.ndarray:
        rows = np.full((number, length), np.nan)
        for row, sweep in enumerate(fit.sweeps):
            rows[row, : len(sweep.data)] = getattr(sweep.data, name)
        return rows

    kinds = ["modulus_magnitude"]
    kinds += ["storage_modulus", "loss_modulus"] if fit.sweeps[0].data.has_phase else []
    dataset["frequency"] = (("sweep", "point"), padded("frequency_hz"), {"units": "Hz"})
    for kind in kinds:
        dataset[f"measured_{kind}"] = (("sweep", "point"), padded(kind), {"units": "Pa"})
    for model in dict.fromkeys(one.model for one in fit.fits):
        shape = (len(residuals), number)
        constants = {name: np.full((2, *shape), np.nan) for name, _, _ in model.constants()}
        moduli = np.full((*shape, length), np.nan, dtype=complex)
        for one in fit.select(model=model):
            place = [r.name for r in residuals].index(one.residual.name), index[id(one.sweep)]
            moduli[*place, : len(one.sweep.data)] = one.modulus(one.sweep.data.frequency_hz)
            for name, value, error in zip(constants, one.values, one.uncertainty.standard_errors, strict=True):
                constants[name][:, *place] = value, error
        for name, unit, _ in model.constants():
            value, error = constants[name]
            dataset[f"{model.name}_{name}"] = (("residuals", "sweep"), value, {"units": unit})
            dataset[f"{model.name}_{name}_standard_error"] = (("residuals", "sweep"), error, {"units": unit})
        for kind, part in (("storage_modulus", np.real(moduli)), ("loss_modulus", np.imag(moduli))):
            dataset[f"{model.name}_{kind}"] = (("residuals", "sweep", "point"), part, {"units": "Pa"})
    return dataset


def _results(fit: DmaFit) -> dict:
    return {
        "fits": [
            {
                "sample": one.sweep.sample,
                "temperature": quantity(one.sweep.temperature_c, "degC"),
                "model": one.model.name,
                "residuals": one.residual.name,
                "parameters": {
                    name: quantity(float(value), unit, float(error))
                    for (name, unit, _), value, error in zip(
                        one.model.constants(), one.values, one.uncertainty.standard_errors, strict=True
                    )
                },
                "correlation": one.uncertainty.correlation.tolist(),
                **{kind: quantity(getattr(one, kind), unit) for kind, unit in _SUMS},
                "n_points": one.n_points,
                "converged": one.converged,
                "status": one.status,
                "warnings": list(one.warnings),
            }
            for one in fit.fits
        ],
        "not_fitted": [
            {
                "sample": one.sweep.sample,
                "temperature": quantity(one.sweep.temperature_c, "degC"),
                "models": list(one.models),
                "reason": one.reason,
                "mean_modulus": {kind: quantity(value, "Pa") for kind, value in one.means.items()},
                "repeat_scatter": {kind: quantity(value, "Pa") for kind, value in one.scatters.items()},
            }
            for one in fit.unfitted
        ],
    }


def _report(data: Path, measured: DmaData, fit: DmaFit, figures: list[str]) -> str:
    lines = [f"# Zener solids fitted to {data.name}", ""]
    lines += [f"{len(measured)} rows, {len(fit.sweeps)} sweeps.", ""]
    lines += [line for remark in measured.remarks for line in (remark, "")]
    if fit.fits:
        lines += [
            "Value ± standard error; `?` marks a constant that the data do not fix. SSE: of log modulus; of modulus; "
            "of relative error of the magnitude, as in Suomi et al. (2016).",
            "",
            "| sweep | model | residuals | M_0 [Pa] | M_inf [Pa] | tau [s] | alpha | SSE log | SSE [Pa^2] | SSE rel. |",
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
        ]
        lines += ["| " + " | ".join(_row(one)) + " |" for one in fit.fits]
    lines += ["", *(f"![{name}]({name})" for name in figures), ""]
    warned = [one for one in fit.fits if one.warnings]
    if warned:
        lines += ["## What these numbers cannot tell", ""]
    for one in warned:
        lines += [f"- {one.sweep.label}, {one.model.name}, {one.residual.name}: {' '.join(one.warnings)}"]
    if fit.unfitted:
        lines += ["", "## Not fitted", ""]
    for one in fit.unfitted:
        lines += [f"- {one.sweep.label} ({', '.join(one.models)}): {one.reason}.{_repeats(one)}"]
    return "\n".join(lines) + "\n"


def _repeats(one: NoFit) -> str:
    """Mean and scatter of rows at one frequency, or the reading that is the only one."""
    if not one.means:
        return ""
    if len(one.sweep.data) == 1:
        return " One reading: " + "; ".join(f"{kind} {value:.4g} Pa" for kind, value in one.means.items())
    return " Mean: " + "; ".join(f"{k} {value:.4g} ± {one.scatters[k]:.2g} Pa" for k, value in one.means.items())


def _row(one: SweepFit) -> list[str]:
    cells = [one.sweep.label, one.model.name, one.residual.name]
    for (name, _, _), value, error in zip(
        one.model.constants(), one.values, one.uncertainty.standard_errors, strict=True
    ):
        unsure = name in one.uncertainty.not_identified
        cells.append(f"{value:.3g} ?" if unsure else f"{value:.4g} ± {error:.2g}")
    cells += [""] * (7 - len(cells))
    return cells + [f"{getattr(one, kind):.3g}" for kind, _ in _SUMS]


def _show(fit: DmaFit, measured: DmaData, out: Path) -> None:
    """A table of the fits with the first of the residuals, and what needs attention."""
    shown = fit.select(residual=fit.fits[0].residual) if fit.fits else []
    if shown:
        columns = ("sweep", "model", "M_0 [Pa]", "M_inf [Pa]", "tau [s]", "alpha", "SSE", "SSE rel.")
        show_table(f"Zener solids, {shown[0].residual.name} residuals", columns, [_brief(o) for o in shown], left=2)
    failed = [one for one in fit.fits if not one.converged]
    unsure = [one for one in fit.fits if one.uncertainty.not_identified]
    lines = [
        f"{len(fit.fits)} fits, {len(failed)} did not converge; {len(unsure)} hold constants that the data do not fix "
        f"(marked ?, see report.md). Results in {out}"
    ]
    lines += [f"{one.sweep.label}, {one.model.name}, {one.residual.name}: {one.status}" for one in failed]
    if fit.unfitted:
        first = fit.unfitted[0]
        lines += [
            f"{len(fit.unfitted)} sweeps without a fit of some model, such as {first.sweep.label}: {first.reason}"
        ]
    show_lines([*measured.remarks, *lines])


def _brief(one: SweepFit) -> list[str]:
    unsure = one.uncertainty.not_identified
    cells = [
        f"{value:.3g}{' ?' if name in unsure else ''}"
        for (name, _, _), value in zip(one.model.constants(), one.values, strict=True)
    ]
    cells += [""] * (4 - len(cells))
    sse = {"log": one.sse_log, "linear": one.sse_linear}[one.residual.name]
    return [one.sweep.label, one.model.name, *cells, f"{sse:.2g}", f"{one.sse_relative:.2g}"]
