"""Strict reading of delimited text: every cell is what its column says, or the file is refused in one line.

A reader states its vocabulary, a tuple of `Quantity`; `read_columns` finds those quantities in the header whatever
they are called, converts them to the package's units and refuses anything that it would have to guess.
"""

import dataclasses
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from arfjax.units import ZERO_CELSIUS_IN_KELVIN
from inverse.datasets.delimited import Table, advice_on_commas, number_in, read_table, shortened

TEMPERATURE_UNITS = {
    **{name: (1.0, 0.0) for name in ("c", "degc", "°c", "ºc", "celsius", "deg c")},
    **{name: (1.0, -ZERO_CELSIUS_IN_KELVIN) for name in ("k", "kelvin")},
}
"""Factor and offset to degC by the unit's name in lower case."""
TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
"""Seconds per unit of time by the unit's name in lower case."""
_TOO_LARGE = 1e150  # squares of larger numbers overflow
NO_UNIT = ("", "-", "1", "none")


@dataclasses.dataclass(frozen=True)
class Quantity:
    """One thing that a column may hold.

    Attributes:
        name: What the reader calls it.
        example: The header to use in a new file, for error messages.
        aliases: Headers by which it is recognised, as `normalised` writes them.
        units: Factor, or factor and offset, to the package's unit, by the name of the unit in lower case.
        exact: Headers by which it is recognised with their case kept, such as T for temperature beside t for time.
        text: Whether its cells are labels rather than numbers.
    """

    name: str
    example: str
    aliases: frozenset[str]
    units: Mapping[str, float | tuple[float, float]] = dataclasses.field(default_factory=dict)
    exact: frozenset[str] = frozenset()
    text: bool = False


@dataclasses.dataclass(frozen=True)
class Column:
    """A recognised column: its place, its header and the unit found there (None where the file names none)."""

    quantity: Quantity
    index: int
    header: str
    unit: str | None


@dataclasses.dataclass(frozen=True)
class Columns:
    """What a reader found in a file: values in the package's units by the quantity's name.

    Attributes:
        table: The file.
        numbers: Values by quantity.
        labels: Cells of text columns by quantity.
        found: The columns that they came from, by quantity.
        ignored: Headers that no quantity claims.
    """

    table: Table
    numbers: dict[str, Float[np.ndarray, " n"]]
    labels: dict[str, tuple[str, ...]]
    found: dict[str, Column]
    ignored: tuple[str, ...]

    def header(self, name: str) -> str:
        """Header under which a quantity was found."""
        return self.found[name].header


def unused(headers: Sequence[str]) -> tuple[str, ...]:
    """What a report says of columns that were not used, misspelled ones perhaps; empty if there is none."""
    return (f"Columns not used: {', '.join(headers)}.",) if headers else ()


def read_columns(path: Path, vocabulary: Sequence[Quantity], required: Sequence[str]) -> Columns:
    """Read the quantities of a vocabulary from a file, in the package's units.

    A row of units below the header is recognised. Columns of no known quantity are left out and named in `ignored`.

    Args:
        path: The file.
        vocabulary: Quantities that the file may hold.
        required: Names of the quantities that it must hold.

    Raises:
        InputError: as `read_table`; and if a quantity is missing or there twice, a unit is unknown, or a cell is not
            a finite number.
    """
    table = read_table(path)
    units = _units_row(table, vocabulary)
    if units is not None:
        table = dataclasses.replace(table, rows=table.rows[1:], lines=table.lines[1:])
    found = _match(table, vocabulary, units)
    for quantity in vocabulary:
        if quantity.name in required and quantity.name not in found:
            table.refuse(
                f"no column for {quantity.name.replace('_', ' ')}; expected a header such as '{quantity.example}', "
                f"found {', '.join(repr(h) for h in table.header)}."
            )
    if not table.rows:
        table.refuse("there is a header but no rows; expected one row for each measurement.")
    claimed = {column.index for column in found.values()}
    return Columns(
        table=table,
        numbers={name: _numbers(table, column) for name, column in found.items() if not column.quantity.text},
        labels={
            name: tuple(row[column.index] for row in table.rows)
            for name, column in found.items()
            if column.quantity.text
        },
        found=found,
        ignored=tuple(h for index, h in enumerate(table.header) if index not in claimed),
    )


def normalised(name: str) -> str:
    """A header without case, blanks and punctuation; primes are kept, a double prime as two."""
    name = name.replace("′", "'").replace("″", "''").replace("’", "'").replace('"', "''").replace("ω", "omega")
    return re.sub(r"[^a-z0-9'*|]", "", name.lower())


def _split_unit(header: str) -> tuple[str, str | None]:
    """Name and unit of a header such as "Frequency (Hz)", "E' [MPa]", "temp, C"; no unit for a bare name."""
    bracket = re.fullmatch(r"(.*?)\s*[(\[{]([^)\]}]*)[)\]}]\s*", header)
    if bracket:
        return bracket[1], bracket[2].strip()
    comma = re.fullmatch(r"(.*\S)\s*[,/]\s*(\S+)", header)
    return (comma[1], comma[2]) if comma else (header, None)


def _recognise(
    header: str, vocabulary: Sequence[Quantity], below: str | None = None
) -> tuple[Quantity, str | None] | None:
    """The quantity that a header names, and its unit as written there or in the cell `below` it.

    Of two quantities of one name the unit decides, as between a displacement in micrometres and one in percent.
    """
    split, unit = _split_unit(header)
    for name, known in ((split, unit), (header, below)):
        for quantity in vocabulary:
            if known is not None and known.lower() in quantity.units and _names(name, quantity):
                return quantity, known
    for name, known in ((header, below), (split, unit)):
        for quantity in vocabulary:
            if _names(name, quantity):
                return quantity, known
    for name, unit in _suffixes(header):
        for quantity in vocabulary:
            if _names(name, quantity) and unit.lower() in quantity.units:
                return quantity, unit
    return None


def _names(name: str, quantity: Quantity) -> bool:
    return name in quantity.exact or normalised(name) in quantity.aliases


def _suffixes(header: str) -> Iterator[tuple[str, str]]:
    """Ways to read a unit behind an underscore or a blank: "Ep_MPa", "omega_rad_s", "E' MPa", "storage_sd_pa"."""
    for place in re.finditer(r"[_\s]", header):
        name, unit = header[: place.start()], header[place.end() :]
        if unit.lower().endswith("_sd"):
            name, unit = name + "_sd", unit[:-3]
        elif unit.lower().startswith("sd_"):
            name, unit = name + "_sd", unit[3:]
        yield name, unit.replace("_", "/")


def _match(table: Table, vocabulary: Sequence[Quantity], units: Sequence[str] | None) -> dict[str, Column]:
    found: dict[str, Column] = {}
    for index, header in enumerate(table.header):
        recognised = _recognise(header, vocabulary, None if units is None else units[index])
        if recognised is None:
            continue
        quantity, unit = recognised
        if quantity.name in found:
            other = found[quantity.name].header
            table.refuse(f"means the same as column '{other}'; remove one of the two.", column=header)
        if unit is not None and unit.lower() in NO_UNIT:
            unit = None
        if unit is not None and not quantity.text and unit.lower() not in quantity.units:
            known = ", ".join(quantity.units)
            table.refuse(f"the unit '{unit}' is not known here; expected one of {known}.", column=header)
        found[quantity.name] = Column(quantity, index, header, unit)
    return found


def _units_row(table: Table, vocabulary: Sequence[Quantity]) -> tuple[str, ...] | None:
    """The first row, if no recognised column holds a number there and at least one holds a unit."""
    if not table.rows:
        return None
    first, hits = table.rows[0], 0
    for header, cell in zip(table.header, first, strict=True):
        unit = cell.strip("()[]")
        recognised = _recognise(header, vocabulary, unit)
        if recognised is None or recognised[0].text:
            continue
        if number_in(cell, table) is not None:
            return None
        hits += unit.lower() in recognised[0].units
    return tuple(cell.strip("()[]") for cell in first) if hits else None


def _numbers(table: Table, column: Column) -> Float[np.ndarray, " n"]:
    values = np.empty(len(table.rows))
    for index, row in enumerate(table.rows):
        cell = row[column.index]
        value = number_in(cell, table)
        if value is None:
            shown = f"'{shortened(cell)}' is not a number" if cell else "the cell is empty"
            table.refuse(f"{shown}; expected a finite number{advice_on_commas(cell)}.", row=index, column=column.header)
        if not np.isfinite(value):
            table.refuse(f"'{shortened(cell)}' is not finite; remove the row.", row=index, column=column.header)
        values[index] = value
    conversion = 1.0 if column.unit is None else column.quantity.units[column.unit.lower()]
    factor, offset = conversion if isinstance(conversion, tuple) else (conversion, 0.0)
    with np.errstate(over="ignore"):
        converted = values * factor + offset
    too_large = ~(np.abs(converted) < _TOO_LARGE)
    if np.any(too_large):
        row = int(np.argmax(too_large))
        table.refuse(
            f"'{shortened(table.rows[row][column.index])}' is too large to be measured; correct or remove the row.",
            row=row,
            column=column.header,
        )
    return converted
