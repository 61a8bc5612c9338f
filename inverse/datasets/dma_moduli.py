"""Which moduli a table of dynamic mechanical analysis gives, and which of its columns they are made of."""

import numpy as np
from jaxtyping import Float

from inverse.datasets.table import Columns

Numbers = dict[str, Float[np.ndarray, " n"]]
"""Values of a table by the quantity's name."""

_SAYING_BOTH = {
    "moduli": {"storage_modulus", "loss_modulus"},
    "storage": {"storage_modulus", "loss_tangent"},
    "magnitude": {"modulus_magnitude", "loss_tangent"},
    "loss": {"loss_modulus", "loss_tangent"},
}
"""Pairs that give both moduli, the one that is taken first."""


def moduli(
    columns: Columns,
) -> tuple[Float[np.ndarray, " n"] | None, Float[np.ndarray, " n"] | None, Float[np.ndarray, " n"]]:
    """Storage and loss modulus (None without both) and magnitude [Pa].

    Raises:
        InputError: if the columns do not give a modulus, or deviations of one of two moduli alone.
    """
    table = columns.table
    if saying_both(columns.numbers) == "loss" and np.any(none := columns.numbers["loss_tangent"] == 0.0):
        row, header = int(np.argmax(none)), columns.header("loss_tangent")
        table.refuse("a loss tangent of 0 gives no storage modulus; add that column.", row=row, column=header)
    numbers = with_both(columns.numbers)
    pair = [name for name in ("storage_modulus", "loss_modulus") if name in numbers]
    if len(pair) == 1 and "modulus_magnitude" not in numbers:
        other = "loss_modulus" if pair == ["storage_modulus"] else "storage_modulus"
        table.refuse(
            f"no column for {other.replace('_', ' ')} beside '{columns.header(pair[0])}'; "
            f"expected '{other}_pa', or 'tan_delta', or 'modulus_magnitude_pa' alone."
        )
    if not pair and "modulus_magnitude" not in numbers:
        found = ", ".join(repr(header) for header in table.header)
        table.refuse(
            f"no column for the modulus; expected 'storage_modulus_pa' and 'loss_modulus_pa', or "
            f"'modulus_magnitude_pa', found {found}."
        )
    for name in ("storage_modulus_sd", "loss_modulus_sd"):
        if name in numbers and not {"storage_modulus_sd", "loss_modulus_sd"} <= numbers.keys():
            table.refuse(
                "standard deviations of storage and loss modulus go together; add the other one or remove this one.",
                column=columns.header(name),
            )
    if len(pair) == 2:
        storage, loss = numbers["storage_modulus"], numbers["loss_modulus"]
        return storage, loss, np.hypot(storage, loss)
    return None, None, numbers["modulus_magnitude"]


def unused_columns(columns: Columns, *, magnitude_only: bool) -> tuple[str, ...]:
    """Headers of quantities that others say already, or that nothing is done with beside them."""
    used = _used(columns.numbers, magnitude_only)
    return tuple(columns.header(name) for name in columns.numbers if name not in used)


def _used(numbers: Numbers, magnitude_only: bool) -> set[str]:
    """Quantities that data are made of."""
    always = {"temperature", "time", "frequency" if "frequency" in numbers else "angular_frequency"}
    pair = saying_both(numbers)
    if not pair:
        return always | {"modulus_magnitude", "modulus_magnitude_sd"}
    # A magnitude has the deviations that the file states for it, or else those of both moduli.
    of_magnitude = magnitude_only and "modulus_magnitude_sd" in numbers
    deviations = {"modulus_magnitude_sd"} if of_magnitude else {"storage_modulus_sd", "loss_modulus_sd"}
    return always | _SAYING_BOTH[pair] | deviations


def saying_both(numbers: Numbers) -> str:
    """The pair that gives both moduli, by what gives its size: moduli, storage, magnitude, loss; empty without."""
    return next((name for name, pair in _SAYING_BOTH.items() if pair <= numbers.keys()), "")


def with_both(numbers: Numbers) -> Numbers:
    """Quantities with both moduli among them, where a loss tangent gives the one that is missing."""
    pair = saying_both(numbers)
    if pair in ("", "moduli"):
        return numbers
    tangent = numbers["loss_tangent"]
    if pair == "storage":
        storage = numbers["storage_modulus"]
    elif pair == "magnitude":
        storage = numbers["modulus_magnitude"] / np.sqrt(1.0 + tangent**2)
    else:
        storage = numbers["loss_modulus"] / tangent
    return {**numbers, "storage_modulus": storage, "loss_modulus": storage * tangent}
