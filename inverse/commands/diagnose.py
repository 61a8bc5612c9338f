"""`arfjax diagnose`: what the simulation gets wrong, by name, and what mending it is worth."""

import enum
import json
from pathlib import Path
from typing import Annotated

import jax
import typer

from arfjax import InputError
from inverse.commands.console import show_lines, show_table, working
from inverse.commands.diagnosis_report import as_json, report
from inverse.commands.output import output_directory, sha256, write_figures, write_summary
from inverse.datasets.dma import read_dma
from inverse.diagnosis import DMA_CAUSES, Diagnosis, DmaCause, diagnose_dma
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL
from inverse.figures import diagnosis_figure


class NullModel(enum.StrEnum):
    """The solid that is fitted and examined."""

    FRACTIONAL = "fractional"
    ZENER = "zener"


_MODELS = {NullModel.FRACTIONAL: FRACTIONAL, NullModel.ZENER: CONVENTIONAL}


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
    library = _library(causes)
    data = read_dma(dma, trust_units=trust_units)
    with output_directory(out) as folder:
        with working("fitting") as show:
            try:
                found = diagnose_dma(data, model=_MODELS[model], causes=library, level=level, seed=seed, on_step=show)
            except ValueError as error:
                raise InputError(f"{dma}: {error}") from None
        text = json.dumps(as_json(found), indent=2, ensure_ascii=False, allow_nan=False)
        (folder / "diagnosis.json").write_text(text + "\n", encoding="utf-8")
        figures = write_figures(folder, {"diagnosis": diagnosis_figure(found)})
        (folder / "report.md").write_text(report(found, dma.name, figures), encoding="utf-8")
        write_summary(
            folder,
            command="diagnose",
            inputs={"dma": dma},
            seed=seed,
            settings={"model": model.value, "causes": [c.name for c in library], "level": level},
            results={"verdict": found.verdict, "diagnosis_sha256": sha256(folder / "diagnosis.json")},
        )
    _show(found, out)


def _library(names: str) -> tuple[DmaCause, ...]:
    """The causes of these names."""
    wanted = list(dict.fromkeys(name.strip() for name in names.split(",") if name.strip()))
    known = {cause.name: cause for cause in DMA_CAUSES}
    for name in wanted:
        if name not in known:
            raise InputError(f"--causes: there is no cause '{name}'; there are {', '.join(known)}.")
    return tuple(known[name] for name in wanted) if wanted else DMA_CAUSES


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
