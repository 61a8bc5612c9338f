"""`arfjax design`: the measurement that would tell causes apart which the present one cannot."""

import json
from pathlib import Path
from typing import Annotated

import jax
import typer

from arfjax import InputError, read_experiment
from inverse.commands.console import show_lines, show_table, working
from inverse.commands.diagnose import NullModel
from inverse.commands.output import output_directory, write_summary
from inverse.datasets.dma import read_dma
from inverse.datasets.hmi import read_hmi
from inverse.design import design_dma, design_hmi
from inverse.design.report import as_json, report
from inverse.diagnosis.diagnose import MODELS


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
    seed: Annotated[int, typer.Option(help="Seed of orders and simulations.", min=0)] = 0,
    trust_units: Annotated[bool, typer.Option("--trust-units", help="Believe units that look wrong.")] = False,
) -> None:
    """Say which further measurement would best tell the causes apart that a diagnosis leaves, and check it.

    Further sweeps after a DMA, or a further sonication after HMI. Writes design.json, report.md and summary.json into
    the folder `out`.
    """
    jax.config.update("jax_enable_x64", True)
    if (dma is None) == (hmi is None):
        raise InputError("design follows one measurement: give --dma FILE, or --hmi FILE with an experiment file.")
    if hmi is not None and experiment is None:
        raise InputError("HMI is designed in its experiment: give the experiment file (TOML) before the options.")
    wanted = [name.strip() for name in causes.split(",") if name.strip()]
    file = dma or hmi
    assert file is not None  # one of both, see above
    given = {"dma": dma, "hmi": hmi, "experiment": experiment if dma is None else None}
    with output_directory(out) as folder:
        with working("designing") as show:
            try:
                if dma is not None:
                    data = read_dma(dma, trust_units=trust_units)
                    found = design_dma(
                        data, causes=wanted, model=MODELS[model.value], check=check, seed=seed, on_step=show
                    )
                else:
                    assert experiment is not None
                    found = design_hmi(
                        read_hmi(file), read_experiment(experiment), name=str(experiment), causes=wanted, check=check,
                        seed=seed, on_step=show,
                    )  # fmt: skip
            except ValueError as error:
                raise (error if isinstance(error, InputError) else InputError(f"{file}: {error}")) from None
        content = as_json(found)
        (folder / "design.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        (folder / "report.md").write_text(report(found, file.name), encoding="utf-8")
        write_summary(
            folder,
            command="design",
            inputs={kind: path for kind, path in given.items() if path is not None},
            seed=seed,
            settings={"model": model.value, "causes": wanted, "check": check},
            results={"best": found.rated[0].proposal.name, "probability_right": found.rated[0].separation.worst},
        )
    rows = [
        [one.proposal.words, str(len(one.proposal)), f"{100.0 * one.separation.worst:.0f} %"] for one in found.rated
    ]
    rows.insert(0, ["nothing more", "", f"{100.0 * found.now.worst:.0f} %"])
    show_lines(list(found.notes))
    show_table("to tell " + ", ".join(found.causes) + " apart", ("measurement", "readings", "right one"), rows)
    show_lines([f"written to {out}"])
