"""How the fitted constants move when causes are put into the model."""

import dataclasses
from collections.abc import Sequence

_LEGEND = "`?` marks a constant at an end of the range of the fit: the data do not fix it."


@dataclasses.dataclass(frozen=True)
class FittedConstant:
    """One of them.

    Attributes:
        name: As the fits call it.
        unit: Of both values.
        of: What it belongs to: the label of a sweep; empty where there is one of the name.
        without: Its value without causes.
        with_causes: Its value with what the verdict names, or with the first of its explanations.
        without_at_end: Whether the first is at an end of the range of the fit, which sets it then, not the data.
        with_causes_at_end: Whether the second is.
    """

    name: str
    unit: str
    of: str
    without: float
    with_causes: float
    without_at_end: bool = False
    with_causes_at_end: bool = False


def as_table(constants: Sequence[FittedConstant]) -> list[str]:
    """Lines of Markdown: a row for each constant, or for each of what has several of the same names."""
    unsure = any(one.without_at_end or one.with_causes_at_end for one in constants)
    return [*_rows(constants), *(["", _LEGEND] if unsure else [])]


def _rows(constants: Sequence[FittedConstant]) -> list[str]:
    if not any(one.of for one in constants):
        return [
            "| constant | without | with it |",
            "| --- | ---: | ---: |",
            *(f"| {_title(one)} | {' | '.join(_values(one))} |" for one in constants),
        ]
    titles = list(dict.fromkeys(_title(one) for one in constants))
    cells: dict[str, list[str]] = {}
    for one in constants:
        cells.setdefault(one.of, []).append(" → ".join(_values(one)))
    return [
        f"| sweep | {' | '.join(titles)} |",
        f"| --- |{' ---: |' * len(titles)}",
        *(f"| {of} | {' | '.join(row)} |" for of, row in cells.items()),
    ]


def _values(one: FittedConstant) -> tuple[str, str]:
    without, after = f"{one.without:.4g}", f"{one.with_causes:.4g}"
    return f"{without} ?" if one.without_at_end else without, f"{after} ?" if one.with_causes_at_end else after


def _title(one: FittedConstant) -> str:
    return one.name if one.unit == "1" else f"{one.name} [{one.unit}]"
