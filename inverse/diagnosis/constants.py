"""How the fitted constants move when causes are put into the model."""

import dataclasses
from collections.abc import Sequence


@dataclasses.dataclass(frozen=True)
class FittedConstant:
    """One of them.

    Attributes:
        name: As the fits call it.
        unit: Of both values.
        of: What it belongs to: the label of a sweep; empty where there is one of the name.
        without: Its value without causes.
        with_causes: Its value with what the verdict names, or with the first of its explanations.
    """

    name: str
    unit: str
    of: str
    without: float
    with_causes: float


def as_table(constants: Sequence[FittedConstant]) -> list[str]:
    """Lines of Markdown: a row for each constant, or for each of what has several of the same names."""
    if not any(one.of for one in constants):
        return [
            "| constant | without | with it |",
            "| --- | ---: | ---: |",
            *(f"| {_title(one)} | {one.without:.4g} | {one.with_causes:.4g} |" for one in constants),
        ]
    titles = list(dict.fromkeys(_title(one) for one in constants))
    cells: dict[str, list[str]] = {}
    for one in constants:
        cells.setdefault(one.of, []).append(f"{one.without:.4g} → {one.with_causes:.4g}")
    return [
        f"| sweep | {' | '.join(titles)} |",
        f"| --- |{' ---: |' * len(titles)}",
        *(f"| {of} | {' | '.join(row)} |" for of, row in cells.items()),
    ]


def _title(one: FittedConstant) -> str:
    return one.name if one.unit == "1" else f"{one.name} [{one.unit}]"
