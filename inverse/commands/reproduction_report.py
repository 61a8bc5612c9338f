"""Tables and report of `arfjax reproduce`."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

from arfjax import suomi2016
from inverse.reproduction import TEMPERATURES, Reading, Row, Variation

_SHOWN_READINGS = 12


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """The main table: a row a number of the paper; empty where the paper gives none."""
    header = ["section", "quantity", "unit", "paper", "here", "difference", "verdict", "why"]
    _write(path, header, ([row.section, row.quantity, row.unit, *_numbers(row), row.verdict, row.why] for row in rows))


def write_readings(path: Path, readings: Sequence[Reading]) -> None:
    """Displacement in percent of 35 degC at every temperature, a row a reading; the paper's values first."""
    header = ["beam", "lesion", "edge", "modulus", "liver_m0"]
    header += [f"percent_at_{temperature:g}_degc" for temperature in TEMPERATURES]
    header += ["rms_difference_from_text", "displacement_at_35_degc_um"]
    stated = suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT
    paper = ["paper's text", "", "", "", "", *(f"{stated[t]:g}" if t in stated else "" for t in TEMPERATURES), "", ""]
    rows = (
        [
            each.beam,
            *each.case,
            *(f"{value:.2f}" for value in each.percent),
            f"{each.misfit:.2f}",
            f"{1e6 * each.first_displacement:.4g}",
        ]
        for each in readings
    )
    _write(path, header, [paper, *rows])


def write_variations(path: Path, variations: Sequence[Variation]) -> None:
    """Change of the displacement in points of that at 35 degC, a row a change of the lesion."""
    header = ["lesion", "temperature_degc", "what", "change_percent", "points"]
    rows = (
        [each.lesion, f"{each.temperature:g}", each.what, f"{100.0 * each.change:+g}", f"{each.points:+.3f}"]
        for each in variations
    )
    _write(path, header, rows)


def report(rows: Sequence[Row], readings: Sequence[Reading], figures: Sequence[str], notes: Sequence[str]) -> str:
    """report.md: sections as in the paper, then the readings, then the figures."""
    stated = [row for row in rows if row.paper is not None]
    agreeing = sum(row.verdict == "agrees" for row in stated)
    lines = [
        "# Suomi et al. 2016, recomputed",
        "",
        f"{agreeing} of {len(stated)} numbers agree within the paper's rounding. Nothing is tuned to agree.",
        "",
    ]
    for section in dict.fromkeys(row.section for row in rows):
        lines += [
            f"## {section.capitalize() if section.islower() else section}",
            "",
            "| quantity | paper | here | difference | unit | verdict | why |",
            "| --- | ---: | ---: | ---: | --- | --- | --- |",
            *(_markdown(row) for row in rows if row.section == section),
            "",
        ]
    lines += [*_readings(readings), *(f"- {note}" for note in notes), "", *(f"![{name}]({name})" for name in figures)]
    return "\n".join(lines) + "\n"


def _markdown(row: Row) -> str:
    paper, here, difference = ("" if text == "" else f"{float(text):.4g}" for text in _numbers(row))
    sign = "+" if row.difference is not None and row.difference >= 0.0 else ""
    return (
        f"| {row.quantity.replace('|', chr(92) + '|')} | {paper} | {here} | {sign}{difference} | {row.unit} "
        f"| {row.verdict} | {row.why.replace('|', chr(92) + '|')} |"
    )


def _readings(readings: Sequence[Reading]) -> list[str]:
    nearest = sorted(readings, key=lambda each: each.misfit)[:_SHOWN_READINGS]
    shown = (60.0, 65.0, 70.0)
    stated = suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT
    return [
        "## Readings",
        "",
        f"What the paper leaves open can be read in {len(readings)} ways that were computed (readings.csv); the "
        f"nearest {len(nearest)} to its text are listed, with the root mean square of five differences. To be near "
        "does not make it the paper's: several are.",
        "",
        "| beam | lesion | edge | modulus | liver's M_0 | 60 | 65 | 70 degC | difference [points] |",
        "| --- | --- | --- | --- | --- | ---: | ---: | ---: | ---: |",
        "| paper's text | | | | | " + " | ".join(f"{stated[t]:g}" if t in stated else "" for t in shown) + " | |",
        *(
            f"| {each.beam} | {' | '.join(each.case)} | {' | '.join(f'{each.at(t):.1f}' for t in shown)} "
            f"| {each.misfit:.1f} |"
            for each in nearest
        ),
        "",
    ]


def _numbers(row: Row) -> list[str]:
    values = (row.paper, row.here, row.difference)
    return ["" if value is None else f"{value:.6g}" for value in values]


def _write(path: Path, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
