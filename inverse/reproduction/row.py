"""A number of the paper beside its counterpart from here."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Row:
    """A number of the paper and its counterpart.

    Attributes:
        section: What part of the paper it belongs to.
        quantity: What it is.
        paper: As printed; None where the paper gives no number for what is computed here.
        here: As computed.
        unit: Of both.
        tolerance: Largest difference that the paper's rounding allows, in the unit.
        why: Where the computed number comes from, or what explains the difference.
    """

    section: str
    quantity: str
    paper: float | None
    here: float
    unit: str
    tolerance: float
    why: str

    @property
    def difference(self) -> float | None:
        """Computed minus printed; None where nothing is printed."""
        return None if self.paper is None else self.here - self.paper

    @property
    def verdict(self) -> str:
        """Whether the difference is within what rounding allows."""
        if self.difference is None:
            return "not stated"
        return "agrees" if abs(self.difference) <= self.tolerance else "differs"


def half_of_last_digit(stated: float) -> float:
    """Half a unit of the last digit that is not a trailing zero: what "around 40" and "approximately 19" leave open."""
    digits = f"{stated:g}"
    decimals = len(digits.partition(".")[2])
    zeros = 0 if decimals else len(digits) - len(digits.rstrip("0"))
    return 0.5 * 10.0 ** (zeros - decimals)
