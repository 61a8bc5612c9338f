"""What a table of dynamic mechanical analysis cannot hold: signs, magnitudes and times that no measurement has."""

import numpy as np
from jaxtyping import Float

from inverse.datasets.dma_moduli import saying_both, with_both
from inverse.datasets.table import Columns

SOFTEST_PLAUSIBLE = 500.0
"""Modulus [Pa] below which all values of a file in "Pa" are taken for another unit."""
STIFFEST_PLAUSIBLE = 1.2e12
"""Young's modulus of diamond [Pa]; nothing measured by dynamic mechanical analysis is stiffer."""
SMALLEST_LOSS_TANGENT, LARGEST_LOSS_TANGENT = 1e-3, 1e2
"""Typical ratios of loss to storage modulus that tissue, gels and polymers do not leave; kPa beside Pa does."""
LARGEST_STATED_TANGENT, RIGHT_ANGLE = 5.0, 90.0
"""Typical loss tangent of a column that tissue, gels and polymers below their flow do not exceed; a phase in degrees
does, up to the right angle."""
HOTTEST_START = 200.0
"""Lowest temperature [degC] of a file above which its temperatures are taken for kelvin."""
SWEEP_GAP = 1.0
"""Gap between sorted temperatures [K] that starts a new sweep."""


def check_signs(columns: Columns) -> None:
    """Moduli are not negative, standard deviations and magnitudes positive, temperatures above absolute zero."""
    for name, values in columns.numbers.items():
        if "modulus" in name:
            strict = name.endswith("_sd") or name != "loss_modulus"
            bad = values <= 0.0 if strict else values < 0.0
            expected = "positive" if strict else "zero or positive"
        elif name == "loss_tangent":
            bad, expected = values < 0.0, "zero or positive"
        elif name == "temperature":
            bad, expected = values < -273.15, "above absolute zero, -273.15 degC"
        else:
            continue
        if np.any(bad):
            row = int(np.argmax(bad))
            shown = columns.table.rows[row][columns.found[name].index]
            # Without those rows alone the others show too much loss.
            mend = (
                "leave out the range of frequencies or temperatures where noise is as large as the loss, or give "
                "magnitudes"
                if name in ("loss_modulus", "loss_tangent")
                else "remove or correct the row"
            )
            columns.table.refuse(
                f"{name.replace('_', ' ')} {shown} must be {expected}; {mend}.",
                row=row,
                column=columns.header(name),
            )


def check_magnitudes(columns: Columns) -> None:
    """Refuse numbers that look like kelvin, kPa, MPa or degrees of phase under headers that say otherwise."""
    table = columns.table
    lowest = float(np.min(columns.numbers["temperature"]))
    if lowest > HOTTEST_START:
        table.refuse(
            f"the lowest temperature is {lowest:g} degC, which looks like kelvin; rename the column "
            f"'temperature_k', or trust the file's units (--trust-units).",
            column=columns.header("temperature"),
        )
    _check_tangent(columns)
    for name, values in _stiffnesses(columns).items():
        highest = float(np.max(values))
        in_pascal = (columns.found[name].unit or "pa").lower() == "pa"
        # A loss modulus alone may be small; with its tangent it says how stiff the sample is.
        whole = name != "loss_modulus" or saying_both(columns.numbers) == "loss"
        if highest < SOFTEST_PLAUSIBLE and in_pascal and whole:
            table.refuse(
                f"no modulus is above {highest:g} Pa, which looks like kPa or MPa; name the unit in the header "
                f"('{name}_kpa'), or trust the file's units (--trust-units).",
                column=columns.header(name),
            )
        if highest > STIFFEST_PLAUSIBLE:
            table.refuse(
                f"{highest:.3g} Pa is stiffer than diamond; correct the unit in the header, or trust the file's "
                f"units (--trust-units).",
                column=columns.header(name),
            )
    _check_ratio(columns)


def _stiffnesses(columns: Columns) -> dict[str, Float[np.ndarray, " n"]]:
    """Moduli by the column that states them [Pa]; of a loss modulus with its tangent the magnitude that they make."""
    numbers = columns.numbers
    stated = {n: numbers[n] for n in ("storage_modulus", "modulus_magnitude", "loss_modulus") if n in numbers}
    if saying_both(numbers) == "loss":
        both = with_both(numbers)
        stated["loss_modulus"] = np.hypot(both["storage_modulus"], both["loss_modulus"])
    return stated


def _check_tangent(columns: Columns) -> None:
    """Refuse a loss tangent that looks like the phase itself in degrees, where moduli are made of it."""
    if saying_both(columns.numbers) in ("", "moduli"):
        return
    tangent = columns.numbers["loss_tangent"]
    typical = float(np.median(tangent))
    if typical > LARGEST_STATED_TANGENT and np.max(tangent) <= RIGHT_ANGLE:
        columns.table.refuse(
            f"the loss tangent is typically {typical:.3g}, which looks like a phase in degrees; give its tangent, or "
            "trust the file's units (--trust-units).",
            column=columns.header("loss_tangent"),
        )


def _check_ratio(columns: Columns) -> None:
    """Refuse a loss modulus that is in another unit than the storage modulus, by their typical ratio."""
    if not {"storage_modulus", "loss_modulus"} <= columns.numbers.keys():
        return
    lossy = (columns.numbers["loss_modulus"] > 0.0) & (columns.numbers["storage_modulus"] > 0.0)
    if not np.any(lossy):
        return
    tangent = float(np.median(columns.numbers["loss_modulus"][lossy] / columns.numbers["storage_modulus"][lossy]))
    if not SMALLEST_LOSS_TANGENT < tangent < LARGEST_LOSS_TANGENT:
        columns.table.refuse(
            f"the loss modulus is typically {tangent:.2g} of the storage modulus, as if in another unit; name the "
            f"units in the headers, or trust the file's (--trust-units).",
            column=columns.header("loss_modulus"),
        )


def check_samples(columns: Columns) -> None:
    """Every row has a label, or none: an empty cell is no sample beside others."""
    labels = columns.labels.get("sample", ())
    if "" in labels and any(labels):
        columns.table.refuse(
            "the cell is empty; name the row's sample, in every row of it.",
            row=labels.index(""),
            column=columns.header("sample"),
        )


def check_time(columns: Columns) -> None:
    """Time runs on within each sample, which has one temperature at a time."""
    if "time" not in columns.numbers:
        return
    time, temperature = columns.numbers["time"], columns.numbers["temperature"]
    labels = columns.labels.get("sample", ("",) * len(time))
    for sample in dict.fromkeys(labels):
        rows = np.flatnonzero([label == sample for label in labels])
        backward = np.flatnonzero(np.diff(time[rows]) < 0.0)
        if backward.size:
            row = int(rows[backward[0] + 1])
            columns.table.refuse(
                f"time {columns.table.rows[row][columns.found['time'].index]} is earlier than in the row before; "
                f"sort the rows by time, give time that runs on where it restarts, or leave the column out.",
                row=row,
                column=columns.header("time"),
            )
        at_once = (np.diff(time[rows]) == 0.0) & (np.abs(np.diff(temperature[rows])) > SWEEP_GAP)
        if np.any(at_once):
            row = int(rows[np.argmax(at_once) + 1])
            columns.table.refuse(
                f"the time is that of the row before, at {temperature[row]:g} degC as at "
                f"{temperature[rows[np.argmax(at_once)]]:g}; give time that runs on, or leave the column out.",
                row=row,
                column=columns.header("time"),
            )
        if len(rows) > 1 and np.ptp(time[rows]) == 0.0:
            columns.table.refuse(
                f"the time is {time[rows[0]]:g} s in every row{f' of {sample}' if sample else ''}; give time that runs "
                "on, or leave the column out.",
                column=columns.header("time"),
            )


def check_units(columns: Columns) -> None:
    """Refuse a modulus or a deviation without a unit beside one in another unit than the one assumed, Pa."""
    moduli = [column for name, column in columns.found.items() if "modulus" in name]
    scaled = [
        column for column in moduli if column.unit is not None and column.quantity.units[column.unit.lower()] != 1.0
    ]
    for column in moduli:
        if column.unit is None and scaled:
            columns.table.refuse(
                f"has no unit, where '{scaled[0].header}' is in {scaled[0].unit}; name its unit in the header.",
                column=column.header,
            )
