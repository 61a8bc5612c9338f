"""Parameters of a fit: what they are called, their unit, and the transform that keeps them inside their bounds.

Optimisers and samplers work on unconstrained numbers u; a transform turns u into the value that the model takes. The
transforms are pytrees whose bounds and scales are leaves, so that fits with different bounds can be batched.
"""

import abc
import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.media import Scalar

Number = float | Float[Array, "..."]

_SATURATED = 14.0
"""Unconstrained distance at which an interval is used up to within a millionth of its width."""


class Transform(eqx.Module):
    """A smooth, increasing map from unconstrained numbers to the values that a parameter may take."""

    @abc.abstractmethod
    def forward(self, unconstrained: Number) -> Number:
        """The value."""

    @abc.abstractmethod
    def inverse(self, value: Number) -> Number:
        """The unconstrained number."""

    @abc.abstractmethod
    def log_derivative(self, unconstrained: Number) -> Number:
        """Logarithm of the derivative of `forward`: what a prior density on the value needs."""

    @abc.abstractmethod
    def end(self, unconstrained: float) -> str | None:
        """The end of the range at which the value lies ("lower" or "upper"), or None inside."""


class Identity(Transform):
    """No bounds."""

    def forward(self, unconstrained: Number) -> Number:
        """The number itself."""
        return unconstrained

    def inverse(self, value: Number) -> Number:
        """The value itself."""
        return value

    def log_derivative(self, unconstrained: Number) -> Number:
        """Zero."""
        return jnp.zeros_like(jnp.asarray(unconstrained, dtype=float))

    def end(self, unconstrained: float) -> str | None:
        """No range, no end."""
        return None


class Positive(Transform):
    """Positive values: `scale` times the exponential. The lower end is 1e-6 of the scale."""

    scale: Scalar = 1.0

    def forward(self, unconstrained: Number) -> Number:
        """Scale times exponential."""
        return self.scale * jnp.exp(unconstrained)

    def inverse(self, value: Number) -> Number:
        """Logarithm of the value over the scale."""
        return jnp.log(value / self.scale)

    def log_derivative(self, unconstrained: Number) -> Number:
        """Logarithm of the value."""
        return jnp.log(self.scale) + unconstrained

    def end(self, unconstrained: float) -> str | None:
        """Lower below a millionth of the scale, upper above a million times it."""
        return _end(unconstrained, math.log(1e6))


class Interval(Transform):
    """Values between `lower` and `upper`."""

    lower: Scalar
    upper: Scalar

    def forward(self, unconstrained: Number) -> Number:
        """Lower bound plus width times the logistic function."""
        return self.lower + (self.upper - self.lower) * jax.nn.sigmoid(unconstrained)

    def inverse(self, value: Number) -> Number:
        """Logit of the value's place in the interval."""
        return jnp.log(value - self.lower) - jnp.log(self.upper - value)

    def log_derivative(self, unconstrained: Number) -> Number:
        """Logarithm of width times slope of the logistic function."""
        return jnp.log(self.upper - self.lower) - jax.nn.softplus(unconstrained) - jax.nn.softplus(-unconstrained)

    def end(self, unconstrained: float) -> str | None:
        """Within a millionth of the width from a bound."""
        return _end(unconstrained, _SATURATED)


class LogInterval(Transform):
    """Positive values between `lower` and `upper` that may differ by many powers of ten."""

    lower: Scalar
    upper: Scalar

    @property
    def _logarithm(self) -> Interval:
        return Interval(jnp.log(self.lower), jnp.log(self.upper))

    def forward(self, unconstrained: Number) -> Number:
        """Exponential of an interval of logarithms."""
        return jnp.exp(self._logarithm.forward(unconstrained))

    def inverse(self, value: Number) -> Number:
        """Place of the value's logarithm."""
        return self._logarithm.inverse(jnp.log(value))

    def log_derivative(self, unconstrained: Number) -> Number:
        """Chain rule of exponential and interval."""
        return self._logarithm.forward(unconstrained) + self._logarithm.log_derivative(unconstrained)

    def end(self, unconstrained: float) -> str | None:
        """Within two percent of the logarithmic width from a bound: there the bound, not the data, sets the value."""
        return _end(unconstrained, 4.0)


class Parameter(eqx.Module):
    """A number that a fit estimates.

    Attributes:
        name: Full name, as the model's field is called.
        unit: Unit of its value.
        transform: Keeps it inside its bounds.
        label: What figures and tables call it.
    """

    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    transform: Transform
    label: str = eqx.field(static=True, default="")


def constrain(parameters: tuple[Parameter, ...], unconstrained: Float[Array, " n"]) -> Float[Array, " n"]:
    """Values of the parameters from the vector of unconstrained numbers."""
    return jnp.stack([jnp.asarray(p.transform.forward(u)) for p, u in zip(parameters, unconstrained, strict=True)])


def unconstrain(parameters: tuple[Parameter, ...], values: Float[Array, " n"]) -> Float[Array, " n"]:
    """Vector of unconstrained numbers from the values of the parameters."""
    return jnp.stack([jnp.asarray(p.transform.inverse(v)) for p, v in zip(parameters, values, strict=True)])


def _end(unconstrained: float, limit: float) -> str | None:
    if unconstrained < -limit:
        return "lower"
    return "upper" if unconstrained > limit else None
