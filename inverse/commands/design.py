"""`arfjax design`: the measurement that would tell causes apart which the present one cannot."""

import json
from pathlib import Path
from typing import Annotated

import jax
import typer

from arfjax import InputError
from inverse.commands.console import show_lines, show_table, working
from inverse.commands.diagnose import NullModel
from inverse.commands.output import output_directory, write_summary
from inverse.datasets.dma import read_dma
from inverse.design import design_dma
from inverse.design.report import as_json, report
from inverse.diagnosis.diagnose import MODELS


def design_command(
    dma: Annotated[Path, typer.Option(help="CSV file: frequency, temperature, storage and loss modulus.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    causes: Annotated[
        str, typer.Option(help="Causes to tell apart, by commas; what a diagnosis leaves, without.")
    ] = "",
    model: Annotated[NullModel, typer.Option(help="Solid behind the data.")] = NullModel.FRACTIONAL,
    check: Annotated[bool, typer.Option(help="Simulate the best measurement and diagnose it again.")] = True,
    seed: Annotated[int, typer.Option(help="Seed of orders and simulations.", min=0)] = 0,
    trust_units: Annotated[bool, typer.Option("--trust-units", help="Believe units that look wrong.")] = False,
) -> None:
    """Say which further DMA would best tell the causes apart that a diagnosis leaves, and check it by simulation.

    Writes design.json, report.md and summary.json into the folder `out`.
    """
    jax.config.update("jax_enable_x64", True)
    data = read_dma(dma, trust_units=trust_units)
    wanted = [name.strip() for name in causes.split(",") if name.strip()]
    with output_directory(out) as folder:
        with working("designing") as show:
            try:
                found = design_dma(data, causes=wanted, model=MODELS[model.value], check=check, seed=seed, on_step=show)
            except ValueError as error:
                raise (error if isinstance(error, InputError) else InputError(f"{dma}: {error}")) from None
        content = as_json(found)
        (folder / "design.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        (folder / "report.md").write_text(report(found, dma.name), encoding="utf-8")
        write_summary(
            folder,
            command="design",
            inputs={"dma": dma},
            seed=seed,
            settings={"model": model.value, "causes": wanted, "check": check},
            results={"best": found.rated[0].proposal.name, "probability_right": found.rated[0].separation.worst},
        )
    rows = [
        [one.proposal.words, str(len(one.proposal)), f"{100.0 * one.separation.worst:.0f} %"] for one in found.rated
    ]
    rows.insert(0, ["nothing more", "", f"{100.0 * found.now.worst:.0f} %"])
    show_table("to tell " + ", ".join(found.causes) + " apart", ("measurement", "readings", "right one"), rows)
    show_lines([f"written to {out}"])
