"""What the package says to its user when input is wrong or is used outside the range that its source covers."""

from typing import Any

import jax
import numpy as np
from jax.core import Tracer


class InputError(ValueError):
    """Input that cannot be used, said in one line: what, where, what was expected and what to do.

    Commands turn it into that line on the error stream and exit status 2; no file is left behind. Whatever a file or
    its name bring into the message, it stays one line without control characters.
    """

    def __init__(self, message: str) -> None:
        """Take the message, with line breaks as blanks and other control characters spelled out."""
        line = " ".join(part.strip() for part in message.splitlines())
        super().__init__("".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in line))


def lies_within(value: Any, least: float, largest: float = np.inf, *, above: bool = False) -> bool:
    """Whether numbers lie between two ends, the lower one left out with `above`; what is traced is not known and does.

    Args:
        value: A number, or an array of them; NaN lies nowhere.
        least: Lower end.
        largest: Upper end.
        above: Whether the lower end itself is out.
    """
    if isinstance(value, Tracer):
        return True
    numbers = np.asarray(value)
    return bool(np.all((numbers > least if above else numbers >= least) & (numbers <= largest)))


def as_known(values: Any) -> Any:
    """An array that is not traced as one of numpy, anything else as it is.

    Under a transformation even an index into an array that is not traced is, and could not be looked at.
    """
    return np.asarray(values) if isinstance(values, jax.Array) and not isinstance(values, Tracer) else values


class ExtrapolationWarning(UserWarning):
    """A law was evaluated outside the range of the measurements behind it; the value is given all the same."""
