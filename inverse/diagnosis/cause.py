"""What a named cause of misfit is: an extension of one place of the model that does nothing at strength 0."""

from collections.abc import Iterable, Sequence
from typing import ClassVar, Generic, TypeVar

import equinox as eqx
from jaxtyping import Array, Float

from arfjax import InputError

Strength = float | Float[Array, ""]


class Cause(eqx.Module):
    """What every named cause of misfit says of itself, whatever was measured.

    Attributes:
        name: As users write it.
        place: Closure of the model that it extends.
        unit: Of the strength.
        sign: 1 if the strength cannot be negative, 0 if it may have either sign.
        plausible: Scale of strengths that one would believe. A cause that shows only far above it is not testable, and
            searches begin by it; no estimate is held back by it.
        least: Strength below which there is no such effect or nothing is known of it, where it may be negative.
        largest: Strength above which it is so.
        shapes: Values of a second parameter to screen, ascending; (0.0,) for a cause without one. A refit moves it
            between the first and the last. In steps so small that what the fit leaves of the effects of neighbours
            has a cosine of 0.7 at least: an effect between two of them is then seen with 92 % of its d' or more.
        shape_means: What the second parameter is; empty for a cause without one.
        sentence: The physics in one sentence.
        helps: The measurement that would show it where these data cannot.
        source: Where it is described, and where `plausible` comes from.
    """

    name: ClassVar[str]
    place: ClassVar[str]
    unit: ClassVar[str]
    sign: ClassVar[int]
    plausible: ClassVar[float]
    sentence: ClassVar[str]
    helps: ClassVar[str]
    source: ClassVar[str]
    least: ClassVar[float] = float("-inf")
    largest: ClassVar[float] = float("inf")
    shapes: ClassVar[tuple[float, ...]] = (0.0,)
    shape_means: ClassVar[str] = ""

    @property
    def possible(self) -> tuple[float, float]:
        """Least and largest strength that there can be."""
        return (0.0 if self.sign > 0 else self.least), self.largest

    def farthest(self, sign: int) -> float:
        """How far from 0 a strength can be: above it (1), below it (-1), or to the side where it is farther (0)."""
        below, above = -self.possible[0], self.largest
        return above if sign > 0 else below if sign < 0 else max(below, above)


AnyCause = TypeVar("AnyCause", bound=Cause)


class Extension(eqx.Module, Generic[AnyCause]):
    """A cause with its shape chosen, ready to be put into the model.

    Attributes:
        cause: What is added.
        shape: Value of its second parameter; 0 without one.
    """

    cause: AnyCause
    shape: Strength

    @property
    def has_shape(self) -> bool:
        """Whether the cause has a second parameter."""
        return len(self.cause.shapes) > 1


def require_causes(library: Sequence[Cause]) -> None:
    """Refuse to look for nothing.

    Raises:
        InputError: if there is no cause.
    """
    if not library:
        raise InputError("causes: there are none to look for.")


def every_shape(causes: Iterable[AnyCause]) -> list[Extension[AnyCause]]:
    """Every cause in each of the shapes that are screened."""
    return [Extension(cause, shape) for cause in causes for shape in cause.shapes]
