"""`arfjax diagnose`: what the simulation gets wrong, by name, and what mending it is worth."""

import enum
from pathlib import Path
from typing import Annotated

import jax
import typer

from arfjax import InputError
from inverse.commands.console import show_lines, show_table, working
from inverse.commands.output import output_directory, sha256, write_summary
from inverse.diagnosis import DMA_CAUSES, Diagnosis
from inverse.diagnosis.diagnose import diagnose, find_causes


class NullModel(enum.StrEnum):
    """The solid that is fitted and examined."""

    FRACTIONAL = "fractional"
    ZENER = "zener"


def diagnose_command(
    dma: Annotated[Path, typer.Option(help="CSV file: frequency, temperature, storage and loss modulus.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    model: Annotated[NullModel, typer.Option(help="Solid to examine, fitted at each temperature.")] = (
        NullModel.FRACTIONAL
    ),
    causes: Annotated[str, typer.Option(help="Names to look for, by commas; all without.")] = "",
    level: Annotated[
        float, typer.Option(help="Chance of finding fault with a right model.", min=0.005, max=0.5)
    ] = 0.05,
    seed: Annotated[int, typer.Option(help="Seed of starts and replicates.", min=0)] = 0,
    trust_units: Annotated[bool, typer.Option("--trust-units", help="Believe units that look wrong.")] = False,
) -> None:
    """Say whether the model of a DMA file is wrong, by which named cause, and what mending it is worth.

    Writes diagnosis.json, report.md, a figure (PNG and PDF) and summary.json into the folder `out`.
    """
    jax.config.update("jax_enable_x64", True)
    wanted = [name.strip() for name in causes.split(",") if name.strip()]
    library = find_causes(wanted or DMA_CAUSES)
    with output_directory(out) as folder:
        with working("fitting") as show:
            try:
                found = diagnose(
                    dma,
                    model=model.value,
                    causes=library,
                    level=level,
                    seed=seed,
                    trust_units=trust_units,
                    on_step=show,
                )
            except ValueError as error:
                raise (error if isinstance(error, InputError) else InputError(f"{dma}: {error}")) from None
        found.write(folder)
        write_summary(
            folder,
            command="diagnose",
            inputs={"dma": dma},
            seed=seed,
            settings={"model": model.value, "causes": [c.name for c in library], "level": level},
            results={"verdict": found.verdict, "diagnosis_sha256": sha256(folder / "diagnosis.json")},
        )
    _show(found.details, out)


def _show(found: Diagnosis, out: Path) -> None:
    rows = [
        [
            one.cause.name,
            f"{one.p_value:.3g}",
            f"{one.estimate:.3g}",
            f"{one.interval[0]:.3g} to {one.interval[1]:.3g}",
            one.cause.unit,
            one.status,
        ]
        for one in found.causes[:6]
    ]
    if rows:
        show_table("causes, the likeliest first", ("cause", "p", "strength", "95 %", "unit", "status"), rows)
    lines = [f"verdict: {found.verdict}"]
    if found.named:
        lines[0] += f" ({', '.join(found.named)})"
    if found.confusable:
        lines[0] += f" ({', '.join(found.confusable[0])} cannot be told apart)"
    if found.not_testable:
        lines.append("not testable with these data: " + ", ".join(one.name for one in found.not_testable))
    show_lines([*lines, f"written to {out}"])
