"""Transforms: smooth maps from the unconstrained numbers that optimisers and samplers move to values inside bounds.

They are pytrees whose bounds and scales are leaves, so that fits with different bounds can be batched.
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

    @property
    def n_unconstrained(self) -> int:
        """How many numbers `forward` takes; a scalar's is one."""
        return 1

    @property
    def n_values(self) -> int:
        """How many values `forward` gives; a scalar's is one."""
        return 1

    @property
    @abc.abstractmethod
    def bounds(self) -> tuple[Scalar, Scalar]:
        """Lowest and highest value; infinite where there is none."""

    @abc.abstractmethod
    def end(self, unconstrained: Number) -> str | None:
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

    @property
    def bounds(self) -> tuple[Scalar, Scalar]:
        """None."""
        return -math.inf, math.inf

    def end(self, unconstrained: Number) -> str | None:
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

    @property
    def bounds(self) -> tuple[Scalar, Scalar]:
        """Zero, and none."""
        return 0.0, math.inf

    def end(self, unconstrained: Number) -> str | None:
        """Lower below a millionth of the scale, upper above a million times it."""
        return _end(float(unconstrained), math.log(1e6))


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

    @property
    def bounds(self) -> tuple[Scalar, Scalar]:
        """Both."""
        return self.lower, self.upper

    def end(self, unconstrained: Number) -> str | None:
        """Within a millionth of the width from a bound."""
        return _end(float(unconstrained), _SATURATED)


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

    @property
    def bounds(self) -> tuple[Scalar, Scalar]:
        """Both."""
        return self.lower, self.upper

    def end(self, unconstrained: Number) -> str | None:
        """Within two percent of the logarithmic width from a bound: there the bound, not the data, sets the value."""
        return _end(float(unconstrained), 4.0)


class Simplex(Transform):
    """Shares: `count` positive values that add up to 1, from one number fewer, by breaking a stick.

    The k-th number is the logit of the piece broken off what is left, shifted so that zeros give equal shares.
    """

    count: int = eqx.field(static=True)

    @property
    def n_unconstrained(self) -> int:
        """One fewer than values."""
        return self.count - 1

    @property
    def n_values(self) -> int:
        """All shares."""
        return self.count

    @property
    def _shift(self) -> Float[Array, " rest"]:
        return -jnp.log(jnp.arange(self.count - 1, 0, -1.0))

    def forward(self, unconstrained: Number) -> Number:
        """Shares that add up to 1."""
        broken = jax.nn.sigmoid(jnp.asarray(unconstrained) + self._shift)
        left = jnp.concatenate([jnp.ones(1), jnp.cumprod(1.0 - broken)])
        return left * jnp.concatenate([broken, jnp.ones(1)])

    def inverse(self, value: Number) -> Number:
        """Logits of the pieces."""
        shares = jnp.asarray(value)
        rest = jnp.cumsum(shares[::-1])[::-1][1:]
        return jnp.log(shares[:-1]) - jnp.log(rest) - self._shift

    def log_derivative(self, unconstrained: Number) -> Number:
        """Logarithm of the determinant of the derivative of all shares but the last."""
        logits = jnp.asarray(unconstrained) + self._shift
        left = jnp.concatenate([jnp.zeros(1), jnp.cumsum(-jax.nn.softplus(logits))[:-1]])
        return jnp.sum(left - jax.nn.softplus(logits) - jax.nn.softplus(-logits))

    @property
    def bounds(self) -> tuple[Scalar, Scalar]:
        """Of each share."""
        return 0.0, 1.0

    def end(self, unconstrained: Number) -> str | None:
        """The end at which the first piece lies that has come to one."""
        ends = (_end(float(each), _SATURATED) for each in jnp.ravel(jnp.asarray(unconstrained)))
        return next(filter(None, ends), None)


def _end(unconstrained: float, limit: float) -> str | None:
    if unconstrained < -limit:
        return "lower"
    return "upper" if unconstrained > limit else None
