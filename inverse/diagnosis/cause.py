"""What a named cause of misfit is: an extension of one place of the model that does nothing at strength 0."""

from collections.abc import Iterable, Sequence
from typing import ClassVar, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Int

from arfjax import FractionalZener, InputError, complex_modulus

Strength = float | Float[Array, ""]


class DmaConditions(eqx.Module):
    """What each row of a dynamic mechanical analysis was measured under.

    Attributes:
        angular_frequency: [rad/s].
        temperature: [degC].
        time: Since the first row of the sample [s], or in rows where the file gives no time.
        time_in_sweep: Share of the visit's duration that had passed, 0 to 1.
        exposure: Share of the water that saturated vapour took away until then, 0 to 1 over the sample's measurement.
        level: Geometric mean of the measured modulus of the sweep [Pa].
        softest: Lowest measured modulus of all rows [Pa].
        stiffest: Highest measured modulus of all rows [Pa].
        sweep: Index of the row's sweep: the rows of one sample at one temperature, which share their constants.
        visit: Index of the row's visit: a sweep whose temperature was measured again later has two.
        sweep_before: Index of the sweep of the same sample that was visited before; its own for the first visit.
    """

    angular_frequency: Float[Array, " row"]
    temperature: Float[Array, " row"]
    time: Float[Array, " row"]
    time_in_sweep: Float[Array, " row"]
    exposure: Float[Array, " row"]
    level: Float[Array, " row"]
    softest: Float[Array, ""]
    stiffest: Float[Array, ""]
    sweep: Int[Array, " row"]
    visit: Int[Array, " row"]
    sweep_before: Int[Array, " row"]

    @property
    def highest(self) -> Float[Array, ""]:
        """Highest angular frequency [rad/s]."""
        return jnp.max(self.angular_frequency)

    @property
    def lowest(self) -> Float[Array, ""]:
        """Lowest angular frequency [rad/s]."""
        return jnp.min(self.angular_frequency)


class DmaState(eqx.Module):
    """What a cause may look at beside the modulus that it changes.

    Attributes:
        conditions: Of each row.
        before: Modulus of the material at the temperature of the sweep before, at the row's frequency [Pa].
    """

    conditions: DmaConditions
    before: Complex[Array, " row"]


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


class DmaCause(Cause):
    """A named cause of misfit of a dynamic mechanical analysis.

    A cause overrides `material` (it changes the constants of the solid) or `measured` (it changes the modulus that the
    instrument reports), and is nothing at strength 0. To add one, copy a file of `inverse/diagnosis/causes` and put it
    into the library there.
    """

    def material(self, constants: Float[Array, "sweep 4"], strength: Strength) -> Float[Array, "sweep 4"]:
        """Constants of the solid of each sweep with the cause in it.

        Args:
            constants: Without it, or as other causes left them: relaxed and unrelaxed modulus [Pa], relaxation time
                [s], fractional order.
            strength: Of the cause, in its unit; at 0 nothing changes.
        """
        del strength
        return constants

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Modulus that the instrument reports [Pa].

        Args:
            modulus: Of the material, or as other causes left it [Pa].
            state: What each row was measured under.
            strength: Of the cause, in its unit; at 0 nothing changes.
            shape: Its second parameter; 0 for a cause without one.
        """
        del state, strength, shape
        return modulus


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


def predicted_modulus(
    constants: Float[Array, "sweep 4"],
    conditions: DmaConditions,
    extensions: tuple[Extension[DmaCause], ...] = (),
    strengths: Float[Array, " extension"] | None = None,
) -> Complex[Array, " row"]:
    """Modulus of every row [Pa] from the constants of every sweep and the strengths of the extensions."""
    strengths = jnp.zeros(len(extensions)) if strengths is None else strengths
    for extension, strength in zip(extensions, strengths, strict=True):
        constants = extension.cause.material(constants, strength)

    def row_modulus(row: Float[Array, " 4"], angular_frequency: Float[Array, ""]) -> Complex[Array, ""]:
        return complex_modulus(FractionalZener(*row), angular_frequency)

    of_rows = jax.vmap(row_modulus)
    modulus = of_rows(constants[conditions.sweep], conditions.angular_frequency)
    before = of_rows(constants[conditions.sweep_before], conditions.angular_frequency)
    state = DmaState(conditions, before)
    for extension, strength in zip(extensions, strengths, strict=True):
        modulus = extension.cause.measured(modulus, state, strength, extension.shape)
    return modulus
