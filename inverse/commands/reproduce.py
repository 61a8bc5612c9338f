"""`arfjax reproduce`: the paper's own numbers beside what comes out here."""

import csv
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import typer

from arfjax import (
    DoseSize,
    Experiment,
    InputError,
    Model,
    StepwiseResult,
    TabulatedSize,
    range_notes,
    read_experiment,
    run_stepwise,
    tabulated_size,
)
from arfjax.io import stepwise_dataset, write_netcdf
from inverse import reproduction
from inverse.commands.console import progress_bar, show_lines, show_table
from inverse.commands.output import output_directory, write_figures, write_summary
from inverse.datasets.hmi import read_hmi
from inverse.datasets.shipped import shipped
from inverse.figures import draw_attenuation, draw_displacements, draw_paper_moduli
from inverse.reproduction import Row

_TEMPERATURES = (35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0)


def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    experiment: Annotated[Path | None, typer.Option(help="Experiment file; the shipped one of the paper.")] = None,
) -> None:
    """Recompute the numbers that Suomi et al. 2016 state, and say where they differ and why.

    Writes reproduction.csv, a NetCDF file for each reading of the lesion's size, figures (PNG and PDF), report.md and
    summary.json into the folder `out`.
    """
    path = shipped("suomi2016_experiment") if experiment is None else experiment
    described = read_experiment(path)
    steps = described.protocol.temperatures_c
    if steps[0] != _TEMPERATURES[0] or steps[-1] != _TEMPERATURES[-1]:
        raise InputError(
            f"{path}: the paper's protocol goes from 35 to 70 degC, this one from {steps[0]:g} to {steps[-1]:g}; "
            "set `protocol.temperatures_c`, or use `arfjax simulate`."
        )
    sizes: dict[str, DoseSize | TabulatedSize] = {"dose": DoseSize(), "table 3": tabulated_size()}
    with output_directory(out) as folder:
        with progress_bar(1 + len(sizes)) as step:
            step("tables and text")
            rows = [
                *reproduction.attenuation_rows(),
                *reproduction.modulus_rows(),
                *reproduction.lesion_constant_rows(),
                *reproduction.dose_rows(),
            ]
            runs = {}
            for label, size in sizes.items():
                step(f"simulation, lesion by {label}")
                model = dataclasses.replace(
                    described.model(), lesion=dataclasses.replace(described.model().lesion, size=size)
                )
                runs[label] = _run(model, described)
                rows += reproduction.displacement_rows(runs[label], size)
            rows += reproduction.lesion_size_rows(runs["dose"])
        _write_rows(folder / "reproduction.csv", rows)
        for label, run in runs.items():
            dataset = stepwise_dataset(run, described.stepwise(), _TEMPERATURES[0])
            write_netcdf(dataset, folder / f"reproduction_lesion_by_{label.replace(' ', '_')}.nc")
        measured = read_hmi(shipped("suomi2016_hmi"))
        figures = write_figures(
            folder,
            {
                "attenuation": draw_attenuation(),
                "moduli": draw_paper_moduli(),
                "displacement": draw_displacements(runs, measured),
            },
        )
        notes = range_notes(described.model(), np.asarray(_TEMPERATURES), np.asarray(runs["dose"].lesion_length))
        (folder / "report.md").write_text(_report(rows, figures, notes), encoding="utf-8")
        write_summary(
            folder,
            command="reproduce",
            inputs={"experiment": path},
            settings={"temperatures_degc": list(_TEMPERATURES)},
            results={"rows": [_as_json(row) for row in rows]},
        )
    show_table("the paper and this package", _HEADER, [_cells(row) for row in rows])
    show_lines([*notes, f"written to {out}"])


def _run(model: Model, described: Experiment) -> StepwiseResult:
    protocol, settings = described.stepwise(), described.discretised(model)
    return eqx.filter_jit(lambda model: run_stepwise(model, jnp.asarray(_TEMPERATURES), protocol, settings))(model)


_HEADER = ("quantity", "unit", "verdict", "paper", "here", "difference")


def _cells(row: Row) -> tuple[str, ...]:
    return (row.quantity, row.unit, row.verdict, f"{row.paper:.4g}", f"{row.here:.4g}", f"{row.difference:+.3g}")


def _as_json(row: Row) -> dict[str, object]:
    return {**dataclasses.asdict(row), "difference": row.difference, "verdict": row.verdict}


def _write_rows(path: Path, rows: Sequence[Row]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["quantity", "unit", "paper", "here", "difference", "verdict", "why"])
        for row in rows:
            numbers = (f"{value:.6g}" for value in (row.paper, row.here, row.difference))
            writer.writerow([row.quantity, row.unit, *numbers, row.verdict, row.why])


def _report(rows: Sequence[Row], figures: Sequence[str], notes: Sequence[str]) -> str:
    agreeing = sum(row.verdict == "agrees" for row in rows)
    lines = [
        "# Suomi et al. 2016, recomputed",
        "",
        f"{agreeing} of {len(rows)} numbers agree within the paper's rounding. Nothing is tuned to agree.",
        "",
        "| quantity | paper | here | difference | unit | verdict | why |",
        "| --- | ---: | ---: | ---: | --- | --- | --- |",
        *(
            f"| {row.quantity} | {row.paper:.4g} | {row.here:.4g} | {row.difference:+.3g} | {row.unit} | {row.verdict} "
            f"| {row.why} |"
            for row in rows
        ),
        "",
        *(f"- {note}" for note in notes),
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n".join(lines) + "\n"
