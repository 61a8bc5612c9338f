"""`arfjax causes`: what a diagnosis looks for, by name."""

import math
import textwrap
from collections.abc import Sequence
from typing import Annotated

import typer

from inverse.commands.console import show_lines, show_table
from inverse.diagnosis.cause import Cause
from inverse.diagnosis.choice import LIBRARIES, require_known

_COLUMNS = ("cause", "where in the model", "plausible", "unit")
_WIDTH = 100


def causes_command(
    name: Annotated[str, typer.Argument(help="A cause, of which everything is said; none lists them all.")] = "",
    markdown: Annotated[bool, typer.Option("--markdown", help="List them as docs/diagnosis.md does.")] = False,
) -> None:
    """List the causes that `diagnose` looks for, or say what one is, what would show it, and where it is from."""
    if name:
        known = {one.name: one for library in LIBRARIES.values() for one in library}
        require_known([name], list(known))
        show_lines(_described(known[name]))
        return
    for kind, library in LIBRARIES.items():
        if markdown:
            show_lines([f"### {kind.upper()}", "", *_table(library), ""])
        else:
            rows = [[one.name, one.place, _plausible(one), one.unit] for one in library]
            show_table(f"causes of misfit of {kind.upper()}", _COLUMNS, rows, left=2)


def _plausible(cause: Cause) -> str:
    return f"{'' if cause.sign > 0 else '±'}{cause.plausible:.3g}"


def _described(cause: Cause) -> list[str]:
    unit = "" if cause.unit == "1" else f" {cause.unit}"
    shape = f"Second parameter: {cause.shape_means}." if cause.shape_means else ""
    parts = [
        f"{cause.name}: {cause.place}",
        cause.sentence,
        f"A strength of {_plausible(cause)}{unit} is plausible{_ends(cause, unit)}. {shape}",
        f"What would show it: {cause.helps}",
        f"Source: {cause.source}",
    ]
    return [line for part in parts for line in textwrap.wrap(part, _WIDTH)]


def _ends(cause: Cause, unit: str) -> str:
    """What it can be at least and at most, where that is known; none below 0 goes without saying."""
    below, above = cause.possible if cause.sign == 0 else (-math.inf, cause.largest)
    said = [f"none below {below:.3g}{unit}"] if math.isfinite(below) else []
    said += [f"none above {above:.3g}{unit}"] if math.isfinite(above) else []
    return "; there is " + ", and ".join(said) if said else ""


def _table(library: Sequence[Cause]) -> list[str]:
    return [
        "| cause | where in the model | plausible | unit | what it does |",
        "| --- | --- | ---: | --- | --- |",
        *(f"| `{one.name}` | {one.place} | {_plausible(one)} | {one.unit} | {one.sentence} |" for one in library),
    ]
