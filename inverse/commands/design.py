"""`arfjax design`: the measurement that would tell causes apart which the present one cannot."""

import dataclasses
from pathlib import Path
from typing import Annotated

import jax
import typer

from arfjax import InputError, read_experiment
from inverse.commands.console import show_lines, show_table, working
from inverse.commands.diagnose import NullModel, require_fittable
from inverse.commands.notes import grid_notes
from inverse.datasets.dma import read_dma
from inverse.datasets.hmi import read_hmi
from inverse.design import design_dma, design_hmi
from inverse.design.report import as_json, percent, report
from inverse.diagnosed import MODELS
from inverse.diagnosis.choice import LIBRARIES, find_causes, names_in
from inverse.diagnosis.hmi.diagnosis import require_diagnosable
from inverse.figures.design import design_figure
from inverse.output import output_directory, recorded, write_figures, write_json, write_summary
from inverse.seeds import HIGHEST_SEED


def design_command(
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    experiment: Annotated[Path | None, typer.Argument(help="Experiment file (TOML); needed for HMI.")] = None,
    dma: Annotated[
        Path | None, typer.Option(help="CSV file: frequency, temperature, storage and loss modulus.")
    ] = None,
    hmi: Annotated[Path | None, typer.Option(help="CSV file: sonication, time or temperature, displacement.")] = None,
    causes: Annotated[
        str, typer.Option(help="Causes to tell apart, by commas; what a diagnosis leaves, without.")
    ] = "",
    model: Annotated[NullModel, typer.Option(help="Solid behind DMA data.")] = NullModel.FRACTIONAL,
    check: Annotated[bool, typer.Option(help="Simulate the best measurement and diagnose it again.")] = True,
    seed: Annotated[int, typer.Option(help="Seed of orders and simulations.", min=0, max=HIGHEST_SEED)] = 0,
    trust_units: Annotated[bool, typer.Option("--trust-units", help="Believe units that look wrong.")] = False,
) -> None:
    """Say which further measurement would best tell the causes apart that a diagnosis leaves, and check it.

    Further sweeps after a DMA, or a further sonication after HMI. Writes design.json, report.md, a figure (PNG and PDF)
    and summary.json into the folder `out`.
    """
    jax.config.update("jax_enable_x64", True)
    if (dma is None) == (hmi is None):
        raise InputError("design follows one measurement: give --dma FILE, or --hmi FILE with an experiment file.")
    if hmi is not None and experiment is None:
        raise InputError("HMI is designed in its experiment: give the experiment file (TOML) before the options.")
    if dma is not None and experiment is not None:
        raise InputError("an experiment file is of HMI: leave it out with --dma.")
    if dma is None and (trust_units or model is not NullModel.FRACTIONAL):
        raise InputError("--trust-units and --model are of a DMA: leave them out with --hmi.")
    wanted = names_in(causes)
    find_causes(wanted, LIBRARIES["hmi" if dma is None else "dma"])
    given = {"dma": dma, "hmi": hmi, "experiment": experiment}
    with output_directory(out) as folder:
        with working("designing") as show:
            if dma is not None:
                file, solid = dma, MODELS[model.value]
                data, inputs = read_dma(dma, trust_units=trust_units), recorded(given)
                require_fittable(dma, data, solid)
                remarks = data.remarks
                found = design_dma(data, causes=wanted, model=solid, check=check, seed=seed, on_step=show)
            else:
                assert hmi is not None and experiment is not None  # see above
                file, described = hmi, read_experiment(experiment)
                curves, inputs = read_hmi(hmi), recorded(given)
                require_diagnosable(curves, described, str(experiment))
                remarks = (*curves.remarks, *grid_notes(described.model()))
                found = design_hmi(
                    curves, described, name=str(experiment), causes=wanted, check=check, seed=seed, on_step=show
                )
        if not found.rated:
            raise InputError(f"{file}: {' '.join(found.notes)}")
        found = dataclasses.replace(found, notes=(*remarks, *found.notes))
        write_json(folder / "design.json", as_json(found))
        figures = write_figures(folder, {"design": design_figure(found)})
        (folder / "report.md").write_text(report(found, file.name, figures), encoding="utf-8")
        write_summary(
            folder,
            command="design",
            inputs=inputs,
            seed=seed,
            settings={
                "causes": wanted,
                "check": check,
                **({} if dma is None else {"model": model.value, "trust_units": trust_units}),
            },
            results={"best": found.rated[0].proposal.name, "probability_right": found.rated[0].separation.worst},
        )
    rows = [[one.proposal.words, str(len(one.proposal)), percent(one.separation.worst)] for one in found.rated]
    rows.insert(0, ["nothing more", "", percent(found.now.worst)])
    show_lines(list(found.notes))
    show_table("to tell " + ", ".join(found.causes) + " apart", ("measurement", "readings", "right one"), rows)
    show_lines([f"written to {out}"])
