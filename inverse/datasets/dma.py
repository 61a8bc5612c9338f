"""Dynamic mechanical analysis: modulus over frequency and temperature, read from CSV and grouped into sweeps."""

import dataclasses
import math
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from arfjax import InputError
from arfjax.units import MODULUS_IN_PASCAL
from inverse.datasets.copies import distinct_rows, said_of_copies
from inverse.datasets.dma_checks import SWEEP_GAP, check_magnitudes, check_samples, check_signs, check_time, check_units
from inverse.datasets.dma_moduli import moduli, unused_columns
from inverse.datasets.table import TEMPERATURE_UNITS, TIME_UNITS, Columns, Quantity, read_columns, unused

_SAME_FREQUENCY = 1e-3
"""Step between sorted logarithms of frequency that starts a new one."""

_PASCAL = MODULUS_IN_PASCAL


def _aliases(names: str) -> frozenset[str]:
    return frozenset(names.split())


_STORAGE = _aliases("storagemodulus storage estorage gstorage estor gstor mstor e' g' m' ep gp eprime gprime")
_LOSS = _aliases("lossmodulus loss eloss gloss mloss e'' g'' m'' epp gpp edoubleprime gdoubleprime")
_TANGENT = _aliases("tan tand tandelta losstangent lossfactor dampingfactor")
_MAGNITUDE = _aliases(
    "modulusmagnitude magnitude dynamicmodulus complexmodulus modulus absmodulus e* g* m* |e*| |g*| |m*| |e| |g| |m|"
)


def _spread(aliases: frozenset[str]) -> frozenset[str]:
    return frozenset(name + ending for name in aliases for ending in ("sd", "std", "stdev"))


_VOCABULARY = (
    Quantity(
        "frequency",
        "frequency_hz",
        _aliases("frequency freq"),
        {"hz": 1.0, "khz": 1e3, "1/s": 1.0, "rad/s": 0.5 / math.pi},
        exact=frozenset({"f"}),
    ),
    Quantity(
        "angular_frequency", "omega_rad_s", _aliases("omega angularfrequency angfreq"), {"rad/s": 1.0, "1/s": 1.0}
    ),
    Quantity("temperature", "temperature_c", _aliases("temperature temp"), TEMPERATURE_UNITS, exact=frozenset({"T"})),
    Quantity("storage_modulus", "storage_modulus_pa", _STORAGE, _PASCAL),
    Quantity("loss_modulus", "loss_modulus_pa", _LOSS, _PASCAL),
    Quantity("modulus_magnitude", "modulus_magnitude_pa", _MAGNITUDE, _PASCAL),
    Quantity("loss_tangent", "tan_delta", _TANGENT, {"delta": 1.0, "δ": 1.0}),
    Quantity("storage_modulus_sd", "storage_modulus_sd_pa", _spread(_STORAGE), _PASCAL),
    Quantity("loss_modulus_sd", "loss_modulus_sd_pa", _spread(_LOSS), _PASCAL),
    Quantity("modulus_magnitude_sd", "modulus_magnitude_sd_pa", _spread(_MAGNITUDE), _PASCAL),
    Quantity("sample", "sample", _aliases("sample specimen sampleid specimenid"), text=True),
    Quantity("time", "time_s", _aliases("time"), TIME_UNITS, exact=frozenset({"t"})),
)


@dataclasses.dataclass(frozen=True)
class DmaData:
    """Measured modulus, one entry a row.

    Attributes:
        frequency_hz: [Hz].
        temperature_c: [degC].
        modulus_magnitude: [Pa].
        storage_modulus: [Pa]; None where only the magnitude was measured.
        loss_modulus: [Pa]; None where only the magnitude was measured.
        storage_modulus_sd: Standard deviation [Pa], or None.
        loss_modulus_sd: Standard deviation [Pa], or None.
        modulus_magnitude_sd: Standard deviation [Pa], or None.
        time_s: [s], or None.
        sample: Label of the sample; empty where the file names none.
        ignored_columns: Headers of the file that were not used.
        n_copies: Rows of the file that were left out because others say the same.
    """

    frequency_hz: Float[np.ndarray, " n"]
    temperature_c: Float[np.ndarray, " n"]
    modulus_magnitude: Float[np.ndarray, " n"]
    storage_modulus: Float[np.ndarray, " n"] | None = None
    loss_modulus: Float[np.ndarray, " n"] | None = None
    storage_modulus_sd: Float[np.ndarray, " n"] | None = None
    loss_modulus_sd: Float[np.ndarray, " n"] | None = None
    modulus_magnitude_sd: Float[np.ndarray, " n"] | None = None
    time_s: Float[np.ndarray, " n"] | None = None
    sample: tuple[str, ...] = ()
    ignored_columns: tuple[str, ...] = ()
    n_copies: int = 0

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a report says of what was not used."""
        return (*unused(self.ignored_columns), *said_of_copies(self.n_copies))

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.frequency_hz)

    @property
    def has_phase(self) -> bool:
        """Whether storage and loss modulus are known, not just the magnitude."""
        return self.storage_modulus is not None and self.loss_modulus is not None

    @property
    def distinct_frequencies(self) -> int:
        """Number of frequencies that differ by more than a thousandth."""
        return len(np.unique(frequency_groups(self.frequency_hz)))

    def without_copies(self) -> "DmaData":
        """Without rows of which another one says the same in all that is used: they are no readings."""
        others = (getattr(self, field.name) for field in dataclasses.fields(self))
        kept = distinct_rows([*(each for each in others if isinstance(each, np.ndarray)), self.sample or None])
        copies = len(self) - len(kept)
        return dataclasses.replace(self.select(kept), n_copies=self.n_copies + copies) if copies else self

    def without_phase(self) -> "DmaData":
        """The magnitude alone, with the deviations stated for it, or else with those of both moduli to first order."""
        deviation, storage_sd, loss_sd = self.modulus_magnitude_sd, self.storage_modulus_sd, self.loss_modulus_sd
        if deviation is None and self.has_phase and storage_sd is not None and loss_sd is not None:
            along = np.hypot(self.storage_modulus * storage_sd, self.loss_modulus * loss_sd)
            deviation = along / self.modulus_magnitude
        return dataclasses.replace(
            self,
            storage_modulus=None,
            loss_modulus=None,
            storage_modulus_sd=None,
            loss_modulus_sd=None,
            modulus_magnitude_sd=deviation,
        )

    def select(self, rows: Int[np.ndarray, " m"] | Bool[np.ndarray, " n"]) -> "DmaData":
        """Some of the rows."""
        chosen = {
            field.name: getattr(self, field.name)[rows]
            for field in dataclasses.fields(self)
            if isinstance(getattr(self, field.name), np.ndarray)
        }
        labels = tuple(np.asarray(self.sample, dtype=object)[rows]) if self.sample else ()
        return dataclasses.replace(self, sample=labels, **chosen)


def frequency_groups(frequency: Float[np.ndarray, " row"]) -> Int[np.ndarray, " row"]:
    """Number of each row's frequency in ascending order: those within a thousandth of the next lower one are the same.

    Args:
        frequency: Of each row, in any unit.
    """
    order = np.argsort(frequency, kind="stable")
    steps = np.diff(np.log(frequency[order])) > _SAME_FREQUENCY
    group = np.zeros(len(order), dtype=int)
    group[order[1:]] = np.cumsum(steps)
    return group


@dataclasses.dataclass(frozen=True)
class Sweep:
    """The rows of one sample at one temperature.

    Attributes:
        sample: Its label; empty where the file names none.
        temperature_c: Mean temperature [degC].
        data: The rows, by ascending frequency.
    """

    sample: str
    temperature_c: float
    data: DmaData

    @property
    def label(self) -> str:
        """Sample and temperature in words."""
        place = f"{round(self.temperature_c, 1) + 0.0:.1f} degC"
        return f"{self.sample}, {place}" if self.sample else place


def dma_data(
    frequency_hz: Float[np.ndarray, " n"],
    temperature_c: Float[np.ndarray, " n"],
    modulus: Float[np.ndarray, " n"] | Float[np.ndarray, "n 2"],
) -> DmaData:
    """Data from arrays: magnitudes [Pa], or storage and loss modulus [Pa] as two columns."""
    if modulus.ndim == 1:
        return DmaData(frequency_hz, temperature_c, modulus)
    storage, loss = modulus.T
    return DmaData(frequency_hz, temperature_c, np.hypot(storage, loss), storage, loss)


def read_dma(path: Path | str, *, trust_units: bool = False, magnitude_only: bool = False) -> DmaData:
    """Read a measurement file.

    Columns: `frequency_hz`, `temperature_c`, `storage_modulus_pa` and `loss_modulus_pa` (or `modulus_magnitude_pa`; or
    `tan_delta` beside one of the three); optional `storage_modulus_sd_pa`, `loss_modulus_sd_pa`,
    `modulus_magnitude_sd_pa`, `sample`, `time_s`. Other usual headers and units are recognised ("Frequency (Hz)",
    omega_rad_s, "E' (MPa)", temp_C, ...), as is a row of units.

    Args:
        path: CSV file, separated by commas, semicolons or tabs; `#` starts a comment line.
        trust_units: Believe the file's units even where the numbers look like other units.
        magnitude_only: Leave the phase out, see `DmaData.without_phase`.

    Returns:
        The rows in SI units and degC, in the file's order.

    Raises:
        InputError: in one line, with file, row and column, if anything in the file cannot be used.
    """
    columns = read_columns(Path(path), _VOCABULARY, required=("temperature",))
    numbers, table = columns.numbers, columns.table
    frequency = _frequency(columns)
    storage, loss, magnitude = moduli(columns)
    check_signs(columns)
    check_units(columns)
    if not trust_units:
        check_magnitudes(columns)
    check_samples(columns)
    check_time(columns)
    data = DmaData(
        frequency_hz=frequency,
        temperature_c=numbers["temperature"],
        modulus_magnitude=magnitude,
        storage_modulus=storage,
        loss_modulus=loss,
        storage_modulus_sd=numbers.get("storage_modulus_sd"),
        loss_modulus_sd=numbers.get("loss_modulus_sd"),
        modulus_magnitude_sd=numbers.get("modulus_magnitude_sd"),
        time_s=numbers.get("time"),
        sample=columns.labels.get("sample", ()),
        ignored_columns=(*columns.ignored, *unused_columns(columns, magnitude_only=magnitude_only)),
    ).without_copies()
    if len(data) < 2:
        written = f" that is written {len(table.rows)} times" if data.n_copies else ""
        table.refuse(f"there is only one row{written}; expected a measurement at two frequencies or more.")
    return data.without_phase() if magnitude_only else data


def require_loss(data: DmaData, name: str) -> None:
    """Refuse phases that are all 0, by the name of the data: a column of a file that has none, as it seems.

    A solid without loss can be fitted; to say what its model lacks is to examine a column that nobody measured.

    Raises:
        InputError: in one line, if no row has a loss.
    """
    if data.loss_modulus is not None and not np.any(data.loss_modulus):
        raise InputError(
            f"{name}: the loss is 0 in every row; if the phase was not measured, give 'modulus_magnitude_pa' alone."
        )


def group_sweeps(data: DmaData) -> tuple[Sweep, ...]:
    """Group rows by sample and temperature; a gap above 1 K between sorted temperatures starts a new sweep.

    Returns:
        Sweeps by sample in the order of the file, then by ascending temperature.

    Raises:
        InputError: if temperatures lie so close that sweeps at several of them would be one.
    """
    labels = data.sample or ("",) * len(data)
    sweeps = []
    for sample in dict.fromkeys(labels):
        rows = np.flatnonzero([label == sample for label in labels])
        rows = rows[np.argsort(data.temperature_c[rows], kind="stable")]
        breaks = np.flatnonzero(np.diff(data.temperature_c[rows]) > SWEEP_GAP) + 1
        for group in np.split(rows, breaks):
            ordered = data.select(group[np.argsort(data.frequency_hz[group], kind="stable")])
            _require_one_sweep(ordered, sample)
            sweeps.append(Sweep(sample, float(np.mean(data.temperature_c[group])), ordered))
    return tuple(sweeps)


def sweeps_of_file(path: Path, data: DmaData) -> tuple[Sweep, ...]:
    """`group_sweeps`, with the file that the data are of in what it complains of."""
    try:
        return group_sweeps(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _require_one_sweep(data: DmaData, sample: str) -> None:
    """Refuse rows of one frequency that no gap divides and that are yet at different temperatures."""
    groups, temperature = frequency_groups(data.frequency_hz), data.temperature_c
    apart = max(float(np.ptp(temperature[groups == one])) for one in range(1 + int(groups.max())))
    if apart > 2.0 * SWEEP_GAP:
        raise InputError(
            f"{f'sample {sample}: ' if sample else ''}sweeps from {temperature.min():g} to {temperature.max():g} degC "
            f"cannot be told apart, because no two neighbouring temperatures are more than {SWEEP_GAP:g} K apart; give "
            "the rows of each sweep one temperature and leave out sweeps in between, or tell sweeps apart by a column "
            "'sample'."
        )


def _frequency(columns: Columns) -> Float[np.ndarray, " n"]:
    for name, factor in (("frequency", 1.0), ("angular_frequency", 0.5 / math.pi)):
        if name not in columns.numbers:
            continue
        values = columns.numbers[name] * factor
        if np.any(values <= 0.0):
            row = int(np.argmax(values <= 0.0))
            shown = columns.table.rows[row][columns.found[name].index]
            columns.table.refuse(
                f"frequency {shown} is not positive; remove the row.", row=row, column=columns.header(name)
            )
        return values
    found = ", ".join(repr(header) for header in columns.table.header)
    columns.table.refuse(
        f"no column for frequency; expected a header such as 'frequency_hz' or 'omega_rad_s', found {found}."
    )
