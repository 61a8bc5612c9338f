"""Delimited text as cells: which lines are data, what separates them, and how their numbers are written."""

import codecs
import csv
import dataclasses
import io
import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from arfjax import InputError

DELIMITERS = (",", ";", "\t")
_WITH_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
_WITH_POINT = re.compile(r"[-+]?\d+\.\d+([eE][-+]?\d+)?")
_WITH_THOUSANDS = re.compile(r"[-+]?\d{1,3}((,\d{3})+\.\d+|(,\d{3}){2,})")
_THOUSANDS_OR_DECIMALS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
_NUMBER = re.compile(r"\s*[-+]?\d[\d.,]*([eE][-+]?\d+)?\s*")


@dataclasses.dataclass(frozen=True)
class Table:
    """The cells of a delimited text file, comments and blank lines left out.

    Attributes:
        path: The file.
        header: Names of the columns.
        rows: Cells, stripped of blanks.
        lines: Line number of each row in the file, counted from 1.
        decimal_comma: Whether numbers are written as 1,5: the file has semicolons between cells and no number as 1.5.
    """

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    decimal_comma: bool = False

    def refuse(self, problem: str, *, row: int | None = None, column: str | None = None) -> NoReturn:
        """Raise `InputError` about a place in this file, in one line."""
        refuse(self.path, problem, line=None if row is None else self.lines[row], column=column)


def refuse(path: Path, problem: str, *, line: int | None = None, column: str | None = None) -> NoReturn:
    """Raise `InputError` about a place in a file, in one line."""
    place = str(path)
    if line is not None:
        place += f", line {line}"
    if column is not None:
        place += f", column '{column}'"
    raise InputError(f"{place}: {problem}")


def read_table(path: Path) -> Table:
    """Read a delimited text file: UTF-8, separated by commas, semicolons or tabs, `#` for comments.

    Columns without a name and without a single entry are left out: instruments end each line with a comma.

    Raises:
        InputError: if the file is missing, a folder, empty, not text, or its rows differ in length.
    """
    lines = [
        (number, line)
        for number, line in enumerate(_read_text(path).split("\n"), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        refuse(path, "the file holds no data; expected a header line and rows of numbers.")
    delimiter = _delimiter([line for _, line in lines])
    if delimiter not in lines[0][1]:
        later = any(one in line for one in DELIMITERS for _, line in lines[1:])
        mend = "begin lines before the header with '#', or remove them" if later else "save the table as CSV"
        refuse(path, f"no comma, semicolon or tab in the header; {mend}.", line=lines[0][0])
    try:
        cells = [tuple(c.strip() for c in row) for row in csv.reader((t for _, t in lines), delimiter=delimiter)]
    except csv.Error as error:
        refuse(path, f"not readable as CSV ({error}); save the table as CSV.")
    cells = _without_empty_columns(cells)
    table = Table(path, cells[0], tuple(cells[1:]), tuple(number for number, _ in lines[1:]))
    _check_shape(table, [number for number, _ in lines], len(cells))
    filled = [place for place, row in enumerate(table.rows) if any(row)]
    rows = tuple(table.rows[place] for place in filled)
    numbers = [cell for row in rows for cell in row]
    return dataclasses.replace(
        table,
        rows=rows,
        lines=tuple(table.lines[place] for place in filled),
        decimal_comma=delimiter == ";"
        and any(_WITH_COMMA.fullmatch(cell) for cell in numbers)
        and not any(_WITH_POINT.fullmatch(cell) for cell in numbers),
    )


def number_in(cell: str, table: Table) -> float | None:
    """The number that a cell holds, or None."""
    if table.decimal_comma and _WITH_COMMA.fullmatch(cell):
        cell = cell.replace(",", ".")
    try:
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def advice_on_commas(cell: str) -> str:
    """What to do about the commas of a number that cannot be read; empty where there are none."""
    if _THOUSANDS_OR_DECIMALS.fullmatch(cell):
        whole, decimal = cell.replace(",", ""), cell.replace(",", ".")
        return f"; write {whole} if the comma is between thousands, {decimal} if it is before decimals"
    if _WITH_THOUSANDS.fullmatch(cell):
        return "; write numbers without commas between thousands"
    return "; write decimals with a point" if _WITH_COMMA.fullmatch(cell) else ""


def shortened(cell: str, length: int = 40) -> str:
    """The beginning of a cell, for messages."""
    return cell if len(cell) <= length else f"{cell[:length]}..."


def _read_text(path: Path) -> str:
    try:
        if path.is_dir():
            refuse(path, "is a folder; give the CSV file inside it.")
        content = path.read_bytes()
    except FileNotFoundError:
        refuse(path, "no such file; check the path.")
    except OSError as error:
        refuse(path, f"cannot be read ({error.strerror}); check its permissions.")
    if content.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        refuse(path, "is a spreadsheet, not text; export the sheet as CSV.")
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        refuse(path, "is UTF-16 text; save it as CSV in UTF-8.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        refuse(path, f"is not UTF-8 text (byte {error.start}); save it as CSV in UTF-8.")
    if "\0" in text:
        refuse(path, "is not text (it holds null bytes); save the table as CSV in UTF-8.")
    return io.StringIO(text, newline=None).read()


def _delimiter(lines: Sequence[str]) -> str:
    """What cuts most rows into as many cells as the header, then most of them into numbers.

    The header alone does not tell: "Frequency, Hz;Temperature, C" has more commas than semicolons.
    """

    def cut(delimiter: str) -> tuple[int, int, int]:
        try:
            header, *rows = csv.reader(lines, delimiter=delimiter)
        except csv.Error:
            return 0, 0, lines[0].count(delimiter)
        alike = [row for row in rows if len(row) == len(header) > 1]
        numbers = sum(_NUMBER.fullmatch(cell) is not None for row in alike for cell in row)
        return len(alike), numbers, lines[0].count(delimiter)

    return max(DELIMITERS, key=cut)


def _without_empty_columns(cells: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """The same without columns of which nothing is written, if all rows are of one length."""
    if len({len(row) for row in cells}) > 1 or not any(cells[0]):
        return cells
    written = [any(column) for column in zip(*cells, strict=True)]
    return [tuple(itertools.compress(row, written)) for row in cells]


def _check_shape(table: Table, lines: list[int], n_parsed: int) -> None:
    if n_parsed != len(lines):
        table.refuse("a quotation mark is not closed, so rows run together; remove quotation marks from the cells.")
    for name in table.header:
        if not name:
            refuse(table.path, f"column {table.header.index('') + 1} has no name; give it one or remove it.")
        if table.header.count(name) > 1:
            refuse(table.path, "this header occurs twice; remove or rename one of the columns.", column=name)
    for index, row in enumerate(table.rows):
        if len(row) != len(table.header):
            table.refuse(f"{len(row)} cells where the header has {len(table.header)}; complete the row.", row=index)
