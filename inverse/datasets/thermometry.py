"""Reader of temperature over time: the mean of a region during and after heating, by magnetic-resonance thermometry."""

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from inverse.datasets.table import TEMPERATURE_UNITS, TIME_UNITS, Columns, Quantity, read_columns

KELVIN_FROM = 200.0
"""Lowest temperature [degC] of a file above which its temperatures are taken for kelvin."""
HOTTEST = 120.0
"""Temperature [degC] that heated tissue and phantoms do not reach."""
SHORTEST_FRAME, LONGEST_FRAME = 0.1, 600.0
"""Typical intervals between frames [s] that thermometry does not leave; minutes or milliseconds in "s" do."""

_KELVIN = {name: 1.0 for name in ("k", "kelvin", *TEMPERATURE_UNITS)}
_MEAN = frozenset(
    "temperature temp meantemperature temperaturemean meantemp tempmean tmean tavg temperatureavg averagetemperature "
    "roimean".split()
)
_SPREAD = frozenset(name + ending for name in _MEAN for ending in ("sd", "std", "stdev"))
_FLAGS = {"0": False, "false": False, "no": False, "1": True, "true": True, "yes": True}

_VOCABULARY = (
    Quantity("time", "time_s", frozenset({"time", "times"}), TIME_UNITS, frozenset({"t"})),
    Quantity("temperature", "temperature_c", _MEAN, TEMPERATURE_UNITS, frozenset({"T"})),
    Quantity("t10", "t10_c", frozenset({"t10"}), TEMPERATURE_UNITS),
    Quantity("t90", "t90_c", frozenset({"t90"}), TEMPERATURE_UNITS),
    Quantity("temperature_sd", "temperature_sd_c", _SPREAD, _KELVIN),
    Quantity("occluded", "occluded", frozenset({"occluded", "hidden", "excluded"}), text=True),
)


@dataclasses.dataclass(frozen=True)
class ThermometryData:
    """Mean temperature of a region over time, a frame a row.

    Attributes:
        path: The file.
        time: [s].
        temperature: [degC].
        t10: Temperature that the hottest tenth of the region exceeds [degC]; None where the file gives none.
        t90: Temperature that nine tenths of the region exceed [degC]; None where the file gives none.
        sd: Standard deviation of the mean's noise [K]; None where the file gives none.
        occluded: Rows that were not really seen, such as those behind another curve of a digitised plot.
        ignored: Headers of columns that were not used.
    """

    path: Path
    time: Float[np.ndarray, " n"]
    temperature: Float[np.ndarray, " n"]
    t10: Float[np.ndarray, " n"] | None
    t90: Float[np.ndarray, " n"] | None
    sd: Float[np.ndarray, " n"] | None
    occluded: Bool[np.ndarray, " n"]
    ignored: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.time)


def read_thermometry(path: str | Path, *, trust_units: bool = False) -> ThermometryData:
    """Read a file of columns `time_s` and `temperature_c`.

    Optional: `t10_c` and `t90_c` (exceeded by a tenth and by nine tenths of the region), `temperature_sd_c`,
    `occluded` (1 for a row that was not really seen). Other usual headers and units are recognised (t_s,
    "Time (min)", T_avg_C, ...).

    Args:
        path: CSV file, separated by commas, semicolons or tabs; `#` starts a comment line.
        trust_units: Believe the file's units even where the numbers look like other units.

    Raises:
        InputError: in one line, with file, row and column, if anything in the file cannot be used.
    """
    columns = read_columns(Path(path), _VOCABULARY, required=("time", "temperature"))
    if len(columns.table.rows) < 2:
        columns.table.refuse("there is only one row; a course needs at least two measurements.")
    _check_time(columns, trust_units)
    for name in ("temperature", "t10", "t90"):
        _check_temperature(columns, name, trust_units)
    _check_exceedance(columns)
    _check_deviations(columns)
    numbers = columns.numbers
    return ThermometryData(
        path=Path(path),
        time=numbers["time"],
        temperature=numbers["temperature"],
        t10=numbers.get("t10"),
        t90=numbers.get("t90"),
        sd=numbers.get("temperature_sd"),
        occluded=_occluded(columns),
        ignored=columns.ignored,
    )


def _check_time(columns: Columns, trust_units: bool) -> None:
    """Time runs forward, and in steps that seconds have."""
    time, header = columns.numbers["time"], columns.header("time")
    steps = np.diff(time)
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 1
        columns.table.refuse(
            f"time {columns.table.rows[row][columns.found['time'].index]} is not later than in the row before; sort "
            "the rows by time, one row for each.",
            row=row,
            column=header,
        )
    typical = float(np.median(steps))
    if not trust_units and not SHORTEST_FRAME <= typical <= LONGEST_FRAME:
        other = "minutes ('time_min')" if typical < SHORTEST_FRAME else "milliseconds ('time_ms')"
        columns.table.refuse(
            f"frames are typically {typical:.3g} s apart, which looks like {other}; correct the unit in the header, or "
            "trust the file's units (--trust-units).",
            column=header,
        )


def _check_temperature(columns: Columns, name: str, trust_units: bool) -> None:
    if name not in columns.numbers:
        return
    values, header = columns.numbers[name], columns.header(name)
    if values.min() > KELVIN_FROM and not trust_units:
        columns.table.refuse(
            f"the lowest temperature is {values.min():g} degC, which looks like kelvin; name the unit in the header "
            "('temperature_k'), or trust the file's units (--trust-units).",
            column=header,
        )
    wrong = values < -273.15 if trust_units else (values < 0.0) | (values > HOTTEST)
    if np.any(wrong):
        row = int(np.argmax(wrong))
        columns.table.refuse(
            f"{values[row]:g} degC is not a temperature of heated tissue; expected 0 to {HOTTEST:g}.",
            row=row,
            column=header,
        )


def _check_exceedance(columns: Columns) -> None:
    """T10 is not below T90, as dosimetry names them; rows that were not really seen may hold anything."""
    if not {"t10", "t90"} <= columns.numbers.keys():
        return
    crossed = (columns.numbers["t10"] < columns.numbers["t90"]) & ~_occluded(columns)
    if np.any(crossed):
        columns.table.refuse(
            "T10, exceeded by a tenth of the region, is below T90, exceeded by nine tenths; swap the two headers.",
            row=int(np.argmax(crossed)),
            column=columns.header("t10"),
        )


def _check_deviations(columns: Columns) -> None:
    for row, value in enumerate(columns.numbers.get("temperature_sd", ())):
        if value <= 0.0:
            columns.table.refuse(
                "a standard deviation must be positive.", row=row, column=columns.header("temperature_sd")
            )


def _occluded(columns: Columns) -> Bool[np.ndarray, " n"]:
    cells = columns.labels.get("occluded", ("0",) * len(columns.table.rows))
    for row, cell in enumerate(cells):
        if cell.lower() not in _FLAGS:
            columns.table.refuse(
                f"'{cell[:40]}' is not a flag; expected 0 or 1.", row=row, column=columns.header("occluded")
            )
    return np.asarray([_FLAGS[cell.lower()] for cell in cells])
