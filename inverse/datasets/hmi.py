"""Reader of harmonic-motion-imaging measurements: displacement against temperature or time, by sonication."""

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from arfjax.units import LENGTH_IN_METRE
from inverse.datasets.copies import distinct_rows, said_of_copies
from inverse.datasets.table import TEMPERATURE_UNITS, TIME_UNITS, Columns, Quantity, read_columns, unused

_PERCENT = {"%": 1.0, "percent": 1.0, "pct": 1.0}
_SPREAD = frozenset({"displacementsd", "dispsd", "displacementstd", "displacementstandarddeviation"})

_VOCABULARY = (
    Quantity("sonication", "sonication", frozenset({"sonication", "exposure", "run", "shot"}), text=True),
    Quantity("time", "time_s", frozenset({"time", "times"}), TIME_UNITS, frozenset({"t"})),
    Quantity("temperature", "temperature_c", frozenset({"temperature", "temp"}), TEMPERATURE_UNITS, frozenset({"T"})),
    Quantity("displacement", "displacement_um", frozenset({"displacement", "disp"}), LENGTH_IN_METRE),
    Quantity(
        "displacement_percent",
        "displacement_percent",
        # The first two need a unit beside or below them; without one they are the length above.
        frozenset({"displacement", "disp", "displacementpercent", "normaliseddisplacement", "normalizeddisplacement"}),
        _PERCENT,
    ),
    Quantity("displacement_sd", "displacement_um_sd", _SPREAD, LENGTH_IN_METRE),
    Quantity("displacement_percent_sd", "displacement_percent_sd", _SPREAD, _PERCENT),
)

_KELVIN_FROM = 200.0  # degC; the coldest tissue in kelvin is 273, the hottest in degC is 120
_FRACTION_BELOW = 3.0  # percent; a displacement normalised to 100 does not stay below 3, one normalised to 1 does
_LARGEST_PERCENT = 1000.0  # heating changes the displacement by less than a factor of ten
_LARGEST_DISPLACEMENT = 1e-2  # m; HMI moves tissue by micrometres
_SMALLEST_DISPLACEMENT = 1e-10  # m


@dataclasses.dataclass(frozen=True)
class HmiData:
    """Displacement measured during sonications, a value a row.

    Attributes:
        path: The file.
        sonication: Label of the sonication of each row.
        temperature: [degC]; None where the file gives only times.
        time: Since the start of the sonication [s]; None where the file gives only temperatures.
        displacement: In percent of its value at a reference temperature, or in metres.
        in_percent: Which of the two.
        sd: Standard deviation in the same unit; None where the file gives none.
        ignored: Headers of columns that were not used.
        n_copies: Rows of the file that were left out because others say the same.
        lines: Line of each row in the file, counted from 1; empty for data that are of no file.
    """

    path: Path
    sonication: tuple[str, ...]
    temperature: Float[np.ndarray, " n"] | None
    time: Float[np.ndarray, " n"] | None
    displacement: Float[np.ndarray, " n"]
    in_percent: bool
    sd: Float[np.ndarray, " n"] | None
    ignored: tuple[str, ...]
    n_copies: int = 0
    lines: tuple[int, ...] = ()

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a report says of what was not used."""
        return (*unused(self.ignored), *said_of_copies(self.n_copies))

    @property
    def labels(self) -> tuple[str, ...]:
        """The sonications, in the order of the file."""
        return tuple(dict.fromkeys(self.sonication))

    def without_copies(self) -> "HmiData":
        """Without rows of which another one says the same in all that is used: they are no readings."""
        kept = distinct_rows([self.sonication, self.temperature, self.time, self.displacement, self.sd])
        copies = len(self.sonication) - len(kept)
        return dataclasses.replace(self.select(kept), n_copies=self.n_copies + copies) if copies else self

    def select(self, rows: Int[np.ndarray, " m"]) -> "HmiData":
        """Some of the rows."""
        chosen = {
            name: None if values is None else values[rows]
            for name in ("temperature", "time", "displacement", "sd")
            for values in (getattr(self, name),)
        }
        lines = tuple(self.lines[row] for row in rows) if self.lines else ()
        return dataclasses.replace(self, sonication=tuple(self.sonication[row] for row in rows), lines=lines, **chosen)

    def place(self, row: int) -> str:
        """A row as messages name it: by its line in the file, or by its number from 1 where there is no file."""
        return f"{self.path}, line {self.lines[row]}" if self.lines else f"{self.path}: row {row + 1}"

    def rows_of(self, label: str) -> list[int]:
        """Rows of one sonication."""
        return [row for row, name in enumerate(self.sonication) if name == label]


def read_hmi(path: str | Path) -> HmiData:
    """Read a file of columns `sonication`, `time_s` and/or `temperature_c`, and a displacement.

    The displacement is `displacement_um` or `displacement_percent` (of its value at a reference temperature), with an
    optional `displacement_um_sd` or `displacement_percent_sd` (also `displacement_sd_um`, `displacement_sd_percent`).
    Other usual headers and units are recognised. Without a column `sonication` all rows are one.

    Raises:
        InputError: in one line, if the file cannot be read as that (see `inverse.datasets.table`).
    """
    columns = read_columns(Path(path), _VOCABULARY, required=())
    table, numbers = columns.table, columns.numbers
    if "time" not in numbers and "temperature" not in numbers:
        table.refuse(
            f"no column for time or temperature; expected 'time_s' or 'temperature_c', found {_named(columns)}."
        )
    name = _displacement_column(columns)
    sonication = columns.labels.get("sonication", ("1",) * len(table.rows))
    if "" in sonication:
        table.refuse(
            "the cell is empty; name the row's sonication.",
            row=sonication.index(""),
            column=columns.header("sonication"),
        )
    _check_temperature(columns)
    _check_displacement(columns, name)
    sd = _standard_deviation(columns, name)
    data = HmiData(
        path=Path(path),
        sonication=sonication,
        temperature=numbers.get("temperature"),
        time=numbers.get("time"),
        displacement=numbers[name],
        in_percent=name == "displacement_percent",
        sd=sd,
        ignored=columns.ignored,
        lines=table.lines,
    )
    data = data.without_copies()
    if len(data.sonication) < 2:
        written = f", written {len(table.rows)} times" if data.n_copies else ""
        table.refuse(f"only one row{written}; a curve needs at least two measurements.")
    _check_time(columns, data)
    return data


def _named(columns: Columns) -> str:
    return ", ".join(repr(header) for header in columns.table.header)


def _displacement_column(columns: Columns) -> str:
    present = [name for name in ("displacement", "displacement_percent") if name in columns.numbers]
    if not present:
        columns.table.refuse(
            "no column for displacement; expected 'displacement_um' or 'displacement_percent', "
            f"found {_named(columns)}."
        )
    if len(present) == 2:
        columns.table.refuse("displacement is given both in percent and as a length; keep one of the two columns.")
    name = present[0]
    if name == "displacement" and _bare(columns, name):
        columns.table.refuse(
            "the displacement has no unit; call the column 'displacement_um'.", column=columns.header(name)
        )
    return name


def _check_temperature(columns: Columns) -> None:
    if "temperature" not in columns.numbers:
        return
    values, header = columns.numbers["temperature"], columns.header("temperature")
    if values.min() > _KELVIN_FROM:
        columns.table.refuse(
            f"temperatures of {values.min():g} and more look like kelvin; convert them to degC or call the column "
            "'temperature_k'.",
            column=header,
        )
    for row, value in enumerate(values):
        if not 0.0 <= value <= 120.0:
            columns.table.refuse(
                f"{value:g} degC is not a temperature of tissue; expected 0 to 120.", row=row, column=header
            )


def _check_displacement(columns: Columns, name: str) -> None:
    values, header = columns.numbers[name], columns.header(name)
    for row, value in enumerate(values):
        if value <= 0.0:
            columns.table.refuse("the displacement must be positive.", row=row, column=header)
    highest = float(values.max())
    if name == "displacement_percent" and highest < _FRACTION_BELOW:
        columns.table.refuse(f"values up to {highest:g} look like fractions; multiply them by 100.", column=header)
    if name == "displacement_percent" and highest > _LARGEST_PERCENT:
        columns.table.refuse(
            f"a displacement of {highest:g} percent of its reference is not plausible; is it a length? Then call the "
            "column 'displacement_um'.",
            column=header,
        )
    if name == "displacement" and not _SMALLEST_DISPLACEMENT < highest < _LARGEST_DISPLACEMENT:
        columns.table.refuse(
            f"a largest displacement of {highest:.3g} m is not one of HMI (nanometres to millimetres); "
            "is the unit in the header right?",
            column=header,
        )


def _standard_deviation(columns: Columns, displacement: str) -> Float[np.ndarray, " n"] | None:
    """Standard deviation of a displacement, in the displacement's own unit."""
    in_percent = displacement == "displacement_percent"
    expected = "displacement_percent_sd" if in_percent else "displacement_um_sd"
    wanted, other = f"{displacement}_sd", "displacement_sd" if in_percent else "displacement_percent_sd"
    without_unit = wanted in columns.found and not in_percent and _bare(columns, wanted)
    if other in columns.found or without_unit:
        columns.table.refuse(
            f"the standard deviation must be in the unit of the displacement, '{columns.header(displacement)}'; call "
            f"the column '{expected}', or remove it.",
            column=columns.header(wanted if without_unit else other),
        )
    if wanted not in columns.found:
        return None
    for row, value in enumerate(columns.numbers[wanted]):
        if value <= 0.0:
            columns.table.refuse("a standard deviation must be positive.", row=row, column=columns.header(wanted))
    return columns.numbers[wanted]


def _bare(columns: Columns, name: str) -> bool:
    return columns.found[name].unit is None


def _check_time(columns: Columns, data: HmiData) -> None:
    if data.time is None:
        return
    # Copies are left out of the data, not of the table.
    header, row_of = columns.header("time"), {line: row for row, line in enumerate(columns.table.lines)}
    for label in data.labels:
        rows = data.rows_of(label)
        for earlier, later in zip(rows, rows[1:], strict=False):
            if data.time[later] > data.time[earlier]:
                continue
            row = row_of[data.lines[later]]
            if data.time[later] == data.time[earlier]:
                columns.table.refuse(
                    f"the time is that of the row before in sonication {label}, of another reading; give time that "
                    "runs on, or leave one of the two out.",
                    row=row,
                    column=header,
                )
            columns.table.refuse(
                f"time does not increase within sonication {label}; sort the rows.", row=row, column=header
            )
        if data.time[rows[0]] < 0.0:
            columns.table.refuse("time must not be negative.", row=row_of[data.lines[rows[0]]], column=header)
