"""`arfjax reproduce`: the paper's own numbers beside what comes out here."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from matplotlib.figure import Figure

from arfjax import Experiment, InputError, StepwiseResult, range_notes, read_experiment, suomi2016
from arfjax.io import stepwise_dataset, write_netcdf
from inverse import reproduction
from inverse.commands.console import progress_bar, show_lines, show_table
from inverse.commands.notes import grid_notes
from inverse.commands.reproduction_report import report, write_readings, write_rows, write_variations
from inverse.datasets.hmi import read_hmi
from inverse.datasets.shipped import shipped
from inverse.figures import paper
from inverse.output import output_directory, recorded, write_figures, write_summary
from inverse.reproduction import TEMPERATURES, Bench, Comparison, Reading, Row, SecondStudy, Variation

_LESIONS = ("table", "dose", "semi-axes")
_STEPS = 11


@dataclasses.dataclass(frozen=True)
class _Outcome:
    """All that was computed.

    Attributes:
        rows: Of the main table.
        runs: The protocol, by where the lesion's size comes from.
        readings: What every reading of the paper gives.
        variations: Of the lesion's constants, for every lesion.
        study: The second study's map.
        comparison: Of both protocols.
        figures: By name.
    """

    rows: list[Row]
    runs: dict[str, StepwiseResult]
    readings: list[Reading]
    variations: list[Variation]
    study: SecondStudy
    comparison: Comparison
    figures: dict[str, Figure]


def _require_paper_s_readings(described: Experiment, path: Path) -> None:
    """Refuse a file that decides what is tried here in every reading, or takes other sound than some rows are of."""
    stated = (
        ("mechanics.modulus", described.mechanics.modulus, "young"),
        ("lesion.edge", described.lesion.edge, "linear"),
        ("acoustics.nonlinear", bool(described.acoustics.nonlinear), False),
    )
    for key, value, expected in stated:
        if value != expected:
            raise InputError(
                f"{path}: {key} is {json.dumps(value)}; `arfjax reproduce` tries the readings of the paper itself and "
                f"compares them with {json.dumps(expected)}: leave it out, or use `arfjax simulate`."
            )


def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    experiment: Annotated[Path | None, typer.Option(help="Experiment file; the shipped one of the paper.")] = None,
) -> None:
    """Recompute the numbers that Suomi et al. 2016 state, and say where they differ and why.

    Writes reproduction.csv (the paper's numbers), readings.csv (what each reading of its silences gives),
    variations.csv (changes of the lesion's constants), NetCDF files of the protocol and of the second study, figures
    (PNG and PDF), report.md and summary.json into the folder `out`.
    """
    path = shipped("suomi2016_experiment") if experiment is None else experiment
    described, inputs = read_experiment(path), recorded({"experiment": path})
    steps = described.protocol.temperatures_c
    if steps[0] != TEMPERATURES[0] or steps[-1] != TEMPERATURES[-1]:
        raise InputError(
            f"{path}: the paper's protocol goes from 35 to 70 degC, this one from {steps[0]:g} to {steps[-1]:g}; "
            "set `protocol.temperatures_c`, or use `arfjax simulate`."
        )
    _require_paper_s_readings(described, path)
    with output_directory(out) as folder:
        with progress_bar(_STEPS) as step:
            outcome = _compute(described, step)
            step("figures")
            figures = write_figures(folder, outcome.figures)
        write_rows(folder / "reproduction.csv", outcome.rows)
        write_readings(folder / "readings.csv", outcome.readings)
        write_variations(folder / "variations.csv", outcome.variations)
        for label, run in outcome.runs.items():
            dataset = stepwise_dataset(run, described.stepwise(), TEMPERATURES[0])
            write_netcdf(dataset, folder / f"reproduction_lesion_by_{label}.nc")
        write_netcdf(outcome.study.dataset(), folder / "second_study.nc")
        write_netcdf(outcome.comparison.dataset(), folder / "protocols.nc")
        lengths = np.asarray(outcome.runs["dose"].lesion_length)
        notes = range_notes(described.model(), np.asarray(TEMPERATURES), lengths) + grid_notes(described.model())
        (folder / "report.md").write_text(report(outcome.rows, outcome.readings, figures, notes), encoding="utf-8")
        write_summary(
            folder,
            command="reproduce",
            inputs=inputs,
            settings={"temperatures_degc": list(TEMPERATURES)},
            results={
                "rows": [_as_json(row) for row in outcome.rows],
                "readings": [dataclasses.asdict(each) | {"misfit": each.misfit} for each in outcome.readings],
                "variations": [dataclasses.asdict(each) for each in outcome.variations],
            },
        )
    show_table("the paper and this package", _HEADER, [_cells(row) for row in outcome.rows])
    show_lines([*notes, f"written to {out}"])


def _compute(described: Experiment, step: Callable[[str], None]) -> _Outcome:
    measured, bench = read_hmi(shipped("suomi2016_hmi")), Bench.of(described)
    step("tables and text")
    rows = [*reproduction.attenuation_rows(), *reproduction.modulus_rows(), *reproduction.zener_rows()]
    rows += [*reproduction.lesion_constant_rows(), *reproduction.dose_rows(), *reproduction.layer_rows()]
    rows += reproduction.count_rows(measured)
    step("heating")
    rows += reproduction.simulated_dose_rows(bench.heating)
    step("the protocol")
    runs = {lesion: bench.run(lesion) for lesion in ("dose", "table")}
    for lesion, run in runs.items():
        rows += reproduction.displacement_rows(run, "table 3" if lesion == "table" else lesion)
    power = float(bench.model.drive.acoustic_power) * _share_of_stated(runs["dose"])
    step("sound with harmonics")
    rows += reproduction.beam_rows(reproduction.beam_sizes(bench, power))
    sizes = [reproduction.sizes_by_dose(bench, nonlinear=nonlinear) for nonlinear in (False, True)]
    rows += reproduction.lesion_size_rows(sizes[0], sizes[1])
    step("readings")
    readings = reproduction.all_readings(bench, reproduction.beams(bench, power))
    variations: list[Variation] = []
    for lesion in _LESIONS:
        step(f"variations, lesion by {lesion}")
        varied = reproduction.lesion_variations(bench, lesion)
        rows += reproduction.variation_rows(varied)
        variations += varied
    step("second study")
    study = reproduction.run_second_study(bench.model, bench.protocol, bench.coarse)
    rows += [*reproduction.second_study_rows(study), *reproduction.insensitivity_rows(bench)]
    step("both protocols")
    comparison = reproduction.compare_protocols(bench)
    rows += reproduction.comparison_rows(comparison)
    rows += reproduction.measured_rows(measured, runs["dose"], comparison.curve())
    figures = {
        "attenuation": paper.draw_attenuation(),
        "moduli": paper.draw_paper_moduli(),
        "loss_tangent": paper.draw_loss_tangents(),
        "geometry": paper.draw_geometry(bench, [layer.tissue for layer in described.layers]),
        "displacement": paper.draw_displacements(runs, readings, variations, measured, comparison),
        "protocols": paper.draw_ladder(comparison),
        "readings": paper.draw_readings(readings),
        "lesion_on_force": paper.draw_lesions_on_force(bench),
        "second_study": paper.draw_second_study(study),
    }
    return _Outcome(rows, runs, readings, variations, study, comparison, figures)


def _share_of_stated(run: StepwiseResult) -> float:
    """By how much more power fresh liver would move as far as the paper's second study says, 9 um."""
    return 1e-6 * suomi2016.SECOND_STUDY_UNABLATED_UM / float(run.displacement[0])


_HEADER = ("quantity", "unit", "verdict", "paper", "here", "difference")


def _cells(row: Row) -> tuple[str, ...]:
    printed = ("", f"{row.here:.4g}", "")
    if row.paper is not None and row.difference is not None:
        printed = (f"{row.paper:.4g}", f"{row.here:.4g}", f"{row.difference:+.3g}")
    return (row.quantity, row.unit, row.verdict, *printed)


def _as_json(row: Row) -> dict[str, object]:
    return {**dataclasses.asdict(row), "difference": row.difference, "verdict": row.verdict}
