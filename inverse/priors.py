"""Priors: what is believed of a value before the data, with its source.

Each has a natural transform, so that a parameter with a prior needs no bounds of its own.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jax.scipy import stats
from jaxtyping import Array, Float, PRNGKeyArray

from arfjax.errors import InputError
from arfjax.media import Scalar
from inverse.transforms import Identity, Interval, LogInterval, Positive, Simplex, Transform

ASSUMED = "assumed (ours)"
"""Source of a prior that no measurement stands behind."""

Value = float | Float[Array, "..."]


class Prior(eqx.Module):
    """A probability density of a value, in the value's unit.

    Attributes:
        source: Where it comes from; `ASSUMED` where from nowhere.
    """

    source: str = eqx.field(static=True, kw_only=True, default=ASSUMED)

    @abc.abstractmethod
    def log_density(self, value: Value) -> Float[Array, ""]:
        """Logarithm of the density of the value [1 over its unit]."""

    @abc.abstractmethod
    def quantile(self, probability: Value) -> Value:
        """Value below which a share of the probability lies."""

    @abc.abstractmethod
    def penalty(self, value: Value) -> Value:
        """What a fit squares and halves: distance from the centre in standard deviations; 0 where the density is flat.

        In the coordinate in which the density is normal or flat: for a log-normal prior the logarithm.
        """

    @property
    @abc.abstractmethod
    def transform(self) -> Transform:
        """Map from the real line to the values of positive density."""

    @abc.abstractmethod
    def describe(self, unit: str) -> str:
        """The density in a few words."""

    def draw(self, key: PRNGKeyArray) -> Value:
        """One value."""
        return self.quantile(jax.random.uniform(key, minval=jnp.finfo(float).tiny))


class Normal(Prior):
    """Normal density."""

    mean: Scalar
    sd: Scalar

    def __check_init__(self) -> None:
        """Refuse a spread that is none."""
        _positive("sd", self.sd)

    def log_density(self, value: Value) -> Float[Array, ""]:
        """Normal."""
        return stats.norm.logpdf(value, self.mean, self.sd)

    def quantile(self, probability: Value) -> Value:
        """Normal quantile."""
        return stats.norm.ppf(probability, self.mean, self.sd)

    def penalty(self, value: Value) -> Value:
        """Standard deviations from the mean."""
        return (jnp.asarray(value) - self.mean) / self.sd

    @property
    def transform(self) -> Transform:
        """None needed."""
        return Identity()

    def describe(self, unit: str) -> str:
        """Mean and standard deviation."""
        return f"normal, {self.mean:.4g} ± {self.sd:.3g} {unit}".strip()


class LogNormal(Prior):
    """Positive values whose logarithm is normal about that of the median."""

    median: Scalar
    log_sd: Scalar

    def __check_init__(self) -> None:
        """Refuse what has no logarithm."""
        _positive("median", self.median)
        _positive("log_sd", self.log_sd)

    def log_density(self, value: Value) -> Float[Array, ""]:
        """Normal density of the logarithm over the value."""
        log_value = jnp.log(jnp.asarray(value))
        return stats.norm.logpdf(log_value, jnp.log(self.median), self.log_sd) - log_value

    def quantile(self, probability: Value) -> Value:
        """Exponential of the logarithm's quantile."""
        return jnp.exp(stats.norm.ppf(probability, jnp.log(self.median), self.log_sd))

    def penalty(self, value: Value) -> Value:
        """Standard deviations of the logarithm from that of the median."""
        return jnp.log(jnp.asarray(value) / self.median) / self.log_sd

    @property
    def transform(self) -> Transform:
        """Exponential, in units of the median."""
        return Positive(self.median)

    def describe(self, unit: str) -> str:
        """Median and spread of the logarithm."""
        median = f"{self.median:.4g} {unit}".strip()
        return f"log-normal, median {median}, standard deviation of its logarithm {self.log_sd:.3g}"


class Uniform(Prior):
    """The same density everywhere between two ends."""

    lower: Scalar
    upper: Scalar

    def __check_init__(self) -> None:
        """Refuse an empty interval."""
        _ordered(self.lower, self.upper)

    def log_density(self, value: Value) -> Float[Array, ""]:
        """One over the width, inside."""
        return stats.uniform.logpdf(value, self.lower, self.upper - self.lower)

    def quantile(self, probability: Value) -> Value:
        """That share of the way."""
        return self.lower + (self.upper - self.lower) * jnp.asarray(probability)

    def penalty(self, value: Value) -> Value:
        """None."""
        return jnp.zeros_like(jnp.asarray(value))

    @property
    def transform(self) -> Transform:
        """Logistic."""
        return Interval(self.lower, self.upper)

    def describe(self, unit: str) -> str:
        """The ends."""
        return f"uniform from {self.lower:.4g} to {self.upper:.4g} {unit}".strip()


class LogUniform(Prior):
    """Positive values of which every factor of ten between two ends is as likely as the next."""

    lower: Scalar
    upper: Scalar

    def __check_init__(self) -> None:
        """Refuse an empty interval and ends without logarithm."""
        _positive("lower", self.lower)
        _ordered(self.lower, self.upper)

    def log_density(self, value: Value) -> Float[Array, ""]:
        """One over the value and the logarithm of the ends' ratio, inside."""
        inside = (value >= self.lower) & (value <= self.upper)
        safe = jnp.where(inside, value, self.lower)
        return jnp.where(inside, -jnp.log(safe) - jnp.log(jnp.log(self.upper / self.lower)), -jnp.inf)

    def quantile(self, probability: Value) -> Value:
        """That share of the way, in the logarithm."""
        return self.lower * (self.upper / self.lower) ** jnp.asarray(probability)

    def penalty(self, value: Value) -> Value:
        """None."""
        return jnp.zeros_like(jnp.asarray(value))

    @property
    def transform(self) -> Transform:
        """Logistic of the logarithm."""
        return LogInterval(self.lower, self.upper)

    def describe(self, unit: str) -> str:
        """The ends."""
        return f"log-uniform from {self.lower:.4g} to {self.upper:.4g} {unit}".strip()


class HalfNormal(Prior):
    """Positive values, the half of a normal density about zero: for spreads."""

    sd: Scalar

    def __check_init__(self) -> None:
        """Refuse a spread that is none."""
        _positive("sd", self.sd)

    def log_density(self, value: Value) -> Float[Array, ""]:
        """Twice the normal density, of positive values."""
        return jnp.where(value >= 0.0, stats.norm.logpdf(value, 0.0, self.sd) + jnp.log(2.0), -jnp.inf)

    def quantile(self, probability: Value) -> Value:
        """Normal quantile of the upper half."""
        return stats.norm.ppf(0.5 + 0.5 * jnp.asarray(probability), 0.0, self.sd)

    def penalty(self, value: Value) -> Value:
        """In units of the scale."""
        return jnp.asarray(value) / self.sd

    @property
    def transform(self) -> Transform:
        """Exponential."""
        return Positive(self.sd)

    def describe(self, unit: str) -> str:
        """The scale."""
        return f"half-normal, scale {self.sd:.3g} {unit}".strip()


class Dirichlet(Prior):
    """Shares that add up to 1, such as weights of relaxations."""

    concentration: Float[Array, " n"]

    def log_density(self, value: Value) -> Float[Array, ""]:
        """Of all shares but the last."""
        return stats.dirichlet.logpdf(jnp.asarray(value), self.concentration)

    def quantile(self, probability: Value) -> Value:
        """Not defined.

        Raises:
            InputError: always.
        """
        raise InputError("shares of a whole have no quantile one by one: hold them fixed in this study.")

    def draw(self, key: PRNGKeyArray) -> Value:
        """One set of shares."""
        return jax.random.dirichlet(key, self.concentration)

    def penalty(self, value: Value) -> Value:
        """Not defined.

        Raises:
            InputError: always.
        """
        raise InputError("a Dirichlet prior is not a sum of squares: sample the posterior, or fit without this prior.")

    @property
    def transform(self) -> Transform:
        """Breaking a stick."""
        return Simplex(len(self.concentration))

    def describe(self, unit: str) -> str:
        """The concentrations."""
        return f"Dirichlet, {', '.join(f'{each:.3g}' for each in self.concentration)}"


def _positive(name: str, value: Scalar) -> None:
    if not isinstance(value, Tracer) and not value > 0.0:
        raise InputError(f"`{name}` of a prior must be positive, got {value}.")


def _ordered(lower: Scalar, upper: Scalar) -> None:
    if not isinstance(lower, Tracer) and not isinstance(upper, Tracer) and not lower < upper:
        raise InputError(f"a prior's `lower` must be below its `upper`, got {lower} and {upper}.")
