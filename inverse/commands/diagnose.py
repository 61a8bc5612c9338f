"""`arfjax diagnose`: what the simulation gets wrong, by name, and what mending it is worth."""

import enum
from pathlib import Path
from typing import Annotated, Any

import jax
import typer

from arfjax import InputError, read_experiment
from inverse.commands.console import show_lines, show_table, staged_bar
from inverse.commands.notes import grid_notes
from inverse.datasets.dma import DmaData, read_dma, require_loss
from inverse.datasets.hmi import read_hmi
from inverse.design.report import percent
from inverse.diagnosed import CONTENT, FILES, MODELS, Diagnosed, diagnose
from inverse.diagnosis.cause import Cause
from inverse.diagnosis.choice import LIBRARIES, find_causes, names_in, require_known
from inverse.diagnosis.dma.problem import usable_sweeps
from inverse.diagnosis.hmi.diagnosis import require_diagnosable
from inverse.diagnosis.level import HIGHEST_LEVEL, LOWEST_LEVEL, require_level
from inverse.diagnosis.report import pairs_in_question
from inverse.dma_fit import ZenerModel
from inverse.output import SUMMARY, output_directory, recorded, sha256, write_summary
from inverse.seeds import HIGHEST_SEED

STAGES = {
    "dma": {
        "fitting": 1.0,
        "testing all causes": 2.0,
        "refitting with": 1.0,
        "measuring the gain": 4.0,
        "refitting what else": 2.0,
        "rating": 10.0,
    },
    "hmi": {
        "fast simulation: draws": 15.0,
        "fast simulation: pushes": 30.0,
        "fast simulation: points": 15.0,
        "fitting": 20.0,
        "full simulation": 50.0,
        "testing all causes": 140.0,
        "refitting with": 10.0,
        "measuring the gain": 10.0,
        "refitting what else": 150.0,
        "rating": 40.0,
    },
}
"""About how many seconds each step of a diagnosis takes, for its bar."""


class NullModel(enum.StrEnum):
    """The solid that is fitted and examined."""

    FRACTIONAL = "fractional"
    ZENER = "zener"


def diagnose_command(
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    experiment: Annotated[Path | None, typer.Argument(help="Experiment file (TOML); needed for HMI.")] = None,
    dma: Annotated[
        Path | None, typer.Option(help="CSV file: frequency, temperature, storage and loss modulus.")
    ] = None,
    hmi: Annotated[Path | None, typer.Option(help="CSV file: sonication, time or temperature, displacement.")] = None,
    model: Annotated[NullModel, typer.Option(help="Solid to examine in a DMA, fitted at each temperature.")] = (
        NullModel.FRACTIONAL
    ),
    causes: Annotated[str, typer.Option(help="Names to look for, by commas; all without.")] = "",
    level: Annotated[
        float, typer.Option(help="Chance of finding fault with a right model.", min=LOWEST_LEVEL, max=HIGHEST_LEVEL)
    ] = 0.05,
    seed: Annotated[int, typer.Option(help="Seed of starts and replicates.", min=0, max=HIGHEST_SEED)] = 0,
    trust_units: Annotated[bool, typer.Option("--trust-units", help="Believe units that look wrong.")] = False,
) -> None:
    """Say whether the model of a DMA file or of HMI curves is wrong, by which cause, and what mending it is worth.

    Writes diagnosis.json, report.md and two figures (PNG and PDF) into the folder `out`, with both files into its
    folders `dma` and `hmi`; and summary.json into `out`.
    """
    jax.config.update("jax_enable_x64", True)
    if dma is None and hmi is None:
        raise InputError("diagnose needs data: --dma FILE, or --hmi FILE with an experiment file.")
    if hmi is not None and experiment is None:
        raise InputError("HMI is diagnosed in its experiment: give the experiment file (TOML) before the options.")
    wanted = names_in(causes)
    parts = {kind: file for kind, file in (("dma", dma), ("hmi", hmi)) if file is not None}
    chosen, places = _chosen(wanted, list(parts)), _places(list(parts))
    if dma is None and (trust_units or model is not NullModel.FRACTIONAL):
        raise InputError("--trust-units and --model are of a DMA: leave them out, or give --dma FILE.")
    require_level(level)
    _require_readable(dma, hmi, experiment, MODELS[model.value], trust_units)
    inputs = recorded({**parts, "experiment": experiment if hmi is not None else None})
    found: dict[str, Diagnosed] = {}
    with output_directory(out, replaces=_earlier(out)) as folder:
        for kind in parts:
            with staged_bar(f"diagnosing {kind}", STAGES[kind]) as show:
                measured: dict[str, Any] = (
                    {"dma": dma, "model": model.value, "trust_units": trust_units}
                    if kind == "dma"
                    else {"hmi": hmi, "experiment": experiment}
                )
                found[kind] = diagnose(**measured, causes=chosen[kind], level=level, seed=seed, on_step=show)
            if experiment is not None and kind == "hmi":
                found[kind] = found[kind].noting(grid_notes(read_experiment(experiment).model()))
            found[kind].write(folder / places[kind])
        results = {
            kind: {
                "verdict": one.verdict,
                "diagnosis_sha256": sha256(folder / places[kind] / CONTENT),
            }
            for kind, one in found.items()
        }
        write_summary(
            folder,
            command="diagnose",
            inputs=inputs,
            seed=seed,
            settings={
                "causes": [cause.name for kind in parts for cause in chosen[kind]],
                "level": level,
                **({} if dma is None else {"model": model.value, "trust_units": trust_units}),
            },
            results=results,
        )
    for kind, one in found.items():
        _show(one, out / places[kind])
    if experiment is not None and hmi is None:
        show_lines([f"{experiment}: plays no part in the diagnosis of a DMA"])


def _require_readable(
    dma: Path | None, hmi: Path | None, experiment: Path | None, model: ZenerModel, trust_units: bool
) -> None:
    """Read everything before anything takes minutes."""
    described = None if experiment is None else read_experiment(experiment)
    if dma is not None:
        require_fittable(dma, read_dma(dma, trust_units=trust_units), model)
    if hmi is not None and described is not None:
        require_diagnosable(read_hmi(hmi), described, str(experiment))


def require_fittable(file: Path, data: DmaData, model: ZenerModel) -> None:
    """Refuse a DMA file with too few data, or none of the phase, by its name."""
    require_loss(data, str(file))
    try:
        usable_sweeps(data, model)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def _places(kinds: list[str]) -> dict[str, str]:
    """Folder of each diagnosis below the one that was asked for."""
    return {kind: kind if len(kinds) > 1 else "" for kind in kinds}


def _earlier(out: Path) -> list[str]:
    """Files of diagnoses that are there: of one file in the folder itself, of two in those below.

    A folder below with a summary of its own is another run's, and is left alone.
    """
    below = [kind for kind in STAGES if not (out / kind / SUMMARY).exists()]
    there = [place for place in ("", *below) if (out / place / CONTENT).is_file()]
    return [str(Path(place) / name) for place in there for name in FILES]


def _chosen(wanted: list[str], kinds: list[str]) -> dict[str, tuple[Cause, ...]]:
    """Causes of each kind of data; with both, names of either.

    Raises:
        InputError: if a name is in no library.
    """
    if len(kinds) == 1:
        return {kinds[0]: find_causes(wanted or LIBRARIES[kinds[0]], LIBRARIES[kinds[0]])}
    require_known(wanted, [cause.name for kind in kinds for cause in LIBRARIES[kind]])
    chosen = {kind: tuple(c for c in LIBRARIES[kind] if not wanted or c.name in wanted) for kind in kinds}
    for kind, causes in chosen.items():
        if not causes:
            raise InputError(
                f"causes: none of {', '.join(wanted)} is one of {kind.upper()}: name one, or leave --{kind} out."
            )
    return chosen


def _show(diagnosed: Diagnosed, out: Path) -> None:
    found = diagnosed.details
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
    together = pairs_in_question(found)
    if together:
        lines[0] += f" (two together, which cannot be told apart: {'; '.join(together)})"
    elif found.confusable:
        lines[0] += f" ({', '.join(found.confusable[0])} cannot be told apart)"
    for one in diagnosed.content["separation"]:
        if one["measurement"] is not None:
            now, then = (part["probability_right"] for part in (one, one["measurement"]))
            best = f"{one['measurement']['words']} ({percent(now)} -> {percent(then)})"
            lines.append(
                f"to tell them apart: {best if then > now else 'none of the measurements rated does it better'}"
            )
    if found.not_testable:
        lines.append("not testable with these data: " + ", ".join(one.name for one in found.not_testable))
    show_lines([*lines, *diagnosed.remarks, f"written to {out}"])
