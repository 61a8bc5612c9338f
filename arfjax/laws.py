"""Closures: a property of tissue as a function of temperature, and of thermal dose where it coagulates.

Every assumption of the simulation about tissue is a law in a named place of the model (`model.liver.attenuation`,
`model.lesion.viscoelasticity`, ...). A law's parameters are leaves, so that a fit is a choice of leaves and a
sensitivity is a gradient; its unit, its source and the range of the measurements behind it are static.

Outside that range a law still gives its value and tells the caller: evaluated eagerly it warns with
`ExtrapolationWarning`; where the temperature is traced, whoever starts the run asks `outside_range` and says so.
"""

import abc
import dataclasses
import math
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.coagulation import LETHAL_DOSE_MINUTES as LETHAL_DOSE_MINUTES
from arfjax.coagulation import SMALLEST_DAMAGE as SMALLEST_DAMAGE
from arfjax.coagulation import coagulated_fraction as coagulated_fraction
from arfjax.coagulation import log_excess as log_excess
from arfjax.coagulation import require_transition
from arfjax.errors import ExtrapolationWarning, InputError, lies_within
from arfjax.media import FractionalZener, Scalar, Zener

EVERYWHERE = (-math.inf, math.inf)
"""Valid range of a law that makes no claim about temperature, such as a constant."""

Temperature = float | Float[Array, "..."] | Float[np.ndarray, "..."]


class TemperatureLaw(eqx.Module):
    """A property of tissue as a function of temperature [degC].

    Attributes:
        unit: Unit of the value that the law gives.
        source: Where its numbers come from.
        valid_range: Lowest and highest temperature [degC] of the measurements behind it.
    """

    unit: str = eqx.field(static=True, kw_only=True)
    source: str = eqx.field(static=True, kw_only=True)
    valid_range: tuple[float, float] = eqx.field(static=True, kw_only=True, default=EVERYWHERE)

    @abc.abstractmethod
    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """The property at a temperature [degC], anywhere."""

    def after(self, temperature: Temperature, dose: Temperature) -> Scalar | Float[Array, "..."]:
        """The property of tissue that has come to a thermal dose [min]; most laws do not ask for it."""
        return self.evaluate(temperature)

    def held(self, temperature: Temperature, dose: Temperature) -> Scalar | Float[Array, "..."]:
        """As `after`, with the temperature held at the ends of `valid_range` beyond them.

        For feedback: a polynomial that is followed beyond its data by heat that it makes itself runs away.
        """
        return self.after(jnp.clip(jnp.asarray(temperature, dtype=float), *self.valid_range), dose)

    def __call__(self, temperature: Temperature, dose: Temperature = 0.0) -> Scalar | Float[Array, "..."]:
        """The property at a temperature [degC] and after a thermal dose [equivalent min at 43 degC].

        Warns where a concrete temperature is outside `valid_range`.
        """
        if not isinstance(temperature, Tracer):
            message = self.outside_range(temperature)
            if message is not None:
                warnings.warn(message, ExtrapolationWarning, stacklevel=2)
        return self.after(temperature, dose)

    def outside_range(self, temperature: Temperature) -> str | None:
        """What to tell the caller when a temperature [degC] is outside `valid_range`; None when all are inside."""
        low, high = self.valid_range
        values = np.asarray(temperature)
        outside = values[(values < low) | (values > high)]
        if outside.size == 0:
            return None
        used = f"{outside.min():g}" if outside.min() == outside.max() else f"{outside.min():g} to {outside.max():g}"
        return f"extrapolated to {used} degC; its source ({self.source}) covers {low:g} to {high:g} degC."


class Constant(TemperatureLaw):
    """The same value at every temperature."""

    value: Scalar

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """The value, in the shape of `temperature`."""
        return self.value + jnp.zeros_like(jnp.asarray(temperature, dtype=float))


class NormalisedPolynomial(TemperatureLaw):
    r"""A reference value times a polynomial that was fitted to data normalised to 100 percent.

    $$ a(T) = a_{ref} \sum_i p_i T^i / 100 $$
    """

    reference_value: Scalar
    coefficients: Float[Array, " n"] | Float[np.ndarray, " n"]

    def percent(self, temperature: Temperature) -> Float[Array, "..."]:
        """The polynomial itself [percent of the reference value]."""
        value = jnp.zeros_like(jnp.asarray(temperature, dtype=float))
        for coefficient in jnp.asarray(self.coefficients)[::-1]:
            value = value * temperature + coefficient
        return value

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """Reference value times polynomial."""
        return self.reference_value * self.percent(temperature) / 100.0


class PolynomialThrough(TemperatureLaw):
    """The polynomial through values at as many temperatures: coefficients in numbers that mean something.

    A fit moves values at temperatures, each with a unit and an error; the coefficients of a polynomial in degC are
    correlated to all digits.

    Attributes:
        temperatures: At which the values hold [degC].
        values: One a temperature.
    """

    temperatures: tuple[float, ...] = eqx.field(static=True)
    values: Float[Array, " n"] | Float[np.ndarray, " n"]

    def __check_init__(self) -> None:
        """Refuse temperatures of which two are the same, and values that are not one each."""
        _check_table(np.sort(self.temperatures), self.values)

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """Lagrange's form, which has no coefficients to lose digits in."""
        at, given = jnp.asarray(temperature, dtype=float), jnp.asarray(self.values)
        total = jnp.zeros_like(at)
        for k, here in enumerate(self.temperatures):
            others = [each for m, each in enumerate(self.temperatures) if m != k]
            weight = math.prod(here - other for other in others)
            total = total + given[k] / weight * math.prod((at - other for other in others), start=1.0)
        return total


class Linear(TemperatureLaw):
    """A value at a reference temperature and a slope [unit per K]."""

    value: Scalar
    slope: Scalar
    reference_temperature: float = eqx.field(static=True)

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """Value plus slope times distance from the reference temperature."""
        return self.value + self.slope * (jnp.asarray(temperature, dtype=float) - self.reference_temperature)


class Exponential(TemperatureLaw):
    """A value at a reference temperature that grows by `exp(rate)` a kelvin: a straight line in its logarithm."""

    value: Scalar
    rate: Scalar
    reference_temperature: float = eqx.field(static=True)

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """Value times the exponential of rate times distance from the reference temperature."""
        return self.value * jnp.exp(self.rate * (jnp.asarray(temperature, dtype=float) - self.reference_temperature))


class Tabulated(TemperatureLaw):
    """Straight lines between tabulated values at ascending temperatures, the end values held outside the table."""

    temperatures: Float[Array, " n"] | Float[np.ndarray, " n"]
    values: Float[Array, " n"] | Float[np.ndarray, " n"]

    def __check_init__(self) -> None:
        """Refuse temperatures that do not ascend, and values that are not one each."""
        _check_table(self.temperatures, self.values)

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """Linear interpolation in the table."""
        return jnp.interp(jnp.asarray(temperature, dtype=float), self.temperatures, self.values)


def _check_table(temperatures: Temperature, values: Temperature) -> None:
    given, needed = np.shape(values)[-1:], np.shape(temperatures)
    if given != needed:
        raise InputError(f"a table needs one value a temperature, got {given} values for {needed} temperatures.")
    if isinstance(temperatures, Tracer):
        return
    if not (np.all(np.isfinite(temperatures)) and lies_within(np.diff(temperatures), 0.0, above=True)):
        raise InputError(
            f"a table needs finite, ascending `temperatures` [degC], none twice, got {np.asarray(temperatures)}; sort "
            "them with their values."
        )


class Composed(TemperatureLaw):
    """A law made of other laws: their ranges hold beside its own, so that one that is wrapped runs away no more."""

    def held(self, temperature: Temperature, dose: Temperature) -> Scalar | Float[Array, "..."]:
        """As `after`, with the temperature held at the ends of its own range and every law within at those of its."""
        # Through `after` of whatever class this is, so that one that overrides it has all that it does here, too.
        inside = {name: _Held(law, unit=law.unit, source=law.source) for name, law in self._within().items()}
        held = dataclasses.replace(self, **inside)
        return held.after(jnp.clip(jnp.asarray(temperature, dtype=float), *self.valid_range), dose)

    def outside_range(self, temperature: Temperature) -> str | None:
        """Also when a temperature [degC] is outside the range of a law within."""
        messages = (law.outside_range(temperature) for law in self._within().values())
        return super().outside_range(temperature) or next(filter(None, messages), None)

    def _within(self) -> dict[str, TemperatureLaw]:
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: law for name, law in fields.items() if isinstance(law, TemperatureLaw)}


class _Held(TemperatureLaw):
    """Another law, held at the ends of its range."""

    law: TemperatureLaw

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """The law before any dose."""
        return self.law.held(temperature, 0.0)

    def after(self, temperature: Temperature, dose: Temperature) -> Scalar | Float[Array, "..."]:
        """The law after a dose."""
        return self.law.held(temperature, dose)


class Scaled(Composed):
    """Another law times a factor."""

    law: TemperatureLaw
    factor: Scalar

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """Factor times law."""
        return self.factor * self.law.evaluate(temperature)

    def after(self, temperature: Temperature, dose: Temperature) -> Scalar | Float[Array, "..."]:
        """Factor times law, after a dose."""
        return self.factor * self.law.after(temperature, dose)


class Shifted(Composed):
    """Another law plus a constant."""

    law: TemperatureLaw
    shift: Scalar

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """Law plus shift."""
        return self.law.evaluate(temperature) + self.shift

    def after(self, temperature: Temperature, dose: Temperature) -> Scalar | Float[Array, "..."]:
        """Law plus shift, after a dose."""
        return self.law.after(temperature, dose) + self.shift


class ScaledRise(Composed):
    """Another law, of which the rise that heat makes is multiplied.

    Above a reference temperature that is the rise above fresh tissue of that temperature; below it, the rise that dose
    makes. What lies below fresh tissue's value stays as it is, so that the slope jumps where the law crosses it.
    """

    law: TemperatureLaw
    factor: Scalar
    reference_temperature: float = eqx.field(static=True)

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """The law with its rise multiplied."""
        return self._raised(self.law.evaluate(temperature), temperature)

    def after(self, temperature: Temperature, dose: Temperature) -> Scalar | Float[Array, "..."]:
        """The law after a dose, with its rise multiplied."""
        return self._raised(self.law.after(temperature, dose), temperature)

    def _raised(self, value: Scalar | Float[Array, "..."], temperature: Temperature) -> Float[Array, "..."]:
        fresh = self.law.evaluate(jnp.minimum(jnp.asarray(temperature, dtype=float), self.reference_temperature))
        return value + (self.factor - 1.0) * jnp.maximum(jnp.asarray(value - fresh), 0.0)


class Coagulating(Composed):
    """One law for fresh tissue, another for coagulated tissue, and between them the share that has coagulated.

    Attributes:
        fresh: Before any dose.
        coagulated: After a dose far above the threshold.
        threshold: Dose at which half has changed over [equivalent min at 43 degC].
        width: Of the transition in the logarithm of dose, see `coagulated_fraction`.
    """

    fresh: TemperatureLaw
    coagulated: TemperatureLaw
    threshold: Scalar
    width: Scalar

    def __check_init__(self) -> None:
        """Refuse a transition that is none."""
        require_transition(threshold=self.threshold, width=self.width)

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """The property of fresh tissue."""
        return self.fresh.evaluate(temperature)

    def after(self, temperature: Temperature, dose: Temperature) -> Scalar | Float[Array, "..."]:
        """The property of tissue of which a share has coagulated."""
        share = coagulated_fraction(dose, self.threshold, width=self.width)
        fresh, coagulated = self.fresh.after(temperature, dose), self.coagulated.after(temperature, dose)
        return fresh + share * (coagulated - fresh)


class ZenerLaw(eqx.Module):
    """Constants of a conventional Zener solid as functions of temperature.

    The unrelaxed modulus is the relaxed one plus the stiffness of the relaxing branch, so that no temperature can
    make a solid that stiffens as it relaxes.
    """

    relaxed_modulus: TemperatureLaw
    branch_modulus: TemperatureLaw
    relaxation_time: TemperatureLaw

    def __call__(self, temperature: Temperature) -> Zener:
        """The solid at one temperature [degC]."""
        relaxed = self.relaxed_modulus(temperature)
        return Zener(relaxed, relaxed + self.branch_modulus(temperature), self.relaxation_time(temperature))


class FractionalZenerLaw(eqx.Module):
    """Constants of a fractional Zener solid as functions of temperature."""

    relaxed_modulus: TemperatureLaw
    branch_modulus: TemperatureLaw
    relaxation_time: TemperatureLaw
    fractional_order: TemperatureLaw

    def __call__(self, temperature: Temperature) -> FractionalZener:
        """The solid at one temperature [degC]."""
        relaxed = self.relaxed_modulus(temperature)
        return FractionalZener(
            relaxed,
            relaxed + self.branch_modulus(temperature),
            self.relaxation_time(temperature),
            self.fractional_order(temperature),
        )


ViscoelasticLaw = ZenerLaw | FractionalZenerLaw


def common_range(model: object) -> tuple[float, float]:
    """Lowest and highest temperature [degC] that every law inside a pytree covers, those within laws among them."""
    found = jax.tree.leaves(model, is_leaf=lambda node: isinstance(node, TemperatureLaw))
    laws = [law for law in found if isinstance(law, TemperatureLaw)]
    ranges = [law.valid_range for law in laws]
    ranges += [common_range(law._within()) for law in laws if isinstance(law, Composed)]
    return max((low for low, _ in ranges), default=-math.inf), min((high for _, high in ranges), default=math.inf)


def extrapolations(model: object, temperature: Temperature, *, name: str = "model") -> list[str]:
    """What every law inside a pytree has to say about temperatures [degC] outside its range, with its place there.

    Args:
        model: Any pytree that holds laws.
        temperature: All temperatures at which they will be used.
        name: What to call the pytree.
    """
    places, _ = jax.tree_util.tree_flatten_with_path(model, is_leaf=lambda node: isinstance(node, TemperatureLaw))
    messages = []
    for path, law in places:
        if isinstance(law, TemperatureLaw) and (message := law.outside_range(temperature)) is not None:
            messages.append(f"{name}{jax.tree_util.keystr(path)}: {message}")
    return messages
