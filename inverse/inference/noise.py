r"""Noise: how measured numbers scatter about predicted ones.

A datum $y_i$ with prediction $\mu_i$ has the deviation

$$ s_i = \sqrt{(q k_i)^2 + a^2 + (b \mu_i)^2} \; (x_i/x_0)^p \; h^{[x_i > x_h]} $$

with a known part $k_i$ times a factor q, an additive part a, a multiplicative part b, a power p of its coordinate x
(frequency, mostly), and a step h. Neighbours in a series are correlated by $\rho$ to the power of their distance
(AR(1)); what is left is normal, or Student's t, of which s is then the scale.

Normalised data share an error. $y_i = d_i / d_0$ with a reading $d_0$ that scatters by the fraction $s_0$ has, beside
its own error, $-y_i$ times that of the reference: to first order the covariance $s_0^2 \mu \mu^T$ within each group
that was divided by the same reading. It is kept, as one more direction, by the matrix-determinant lemma.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.scipy import stats
from jaxtyping import Array, Float, Int, PRNGKeyArray

from arfjax.errors import InputError
from arfjax.media import Scalar

Numbers = Float[Array, " n"] | Float[np.ndarray, " n"]


class Series(eqx.Module):
    """Which datum is the neighbour of which, where each lies, and which were divided by the same reading.

    Attributes:
        coordinate: Along which deviations may change, positive, such as frequency [Hz].
        previous: Index of the neighbour before each datum, -1 at the start of a series.
        gap: Distance to that neighbour, in usual distances; 1 where there is none.
        group: Number of the group that shares a reference reading.
        n_groups: How many there are.
    """

    coordinate: Numbers
    previous: Int[np.ndarray, " n"]
    gap: Numbers
    group: Int[np.ndarray, " n"]
    n_groups: int = eqx.field(static=True)


def unordered(count: int) -> Series:
    """Data without neighbours, coordinate or reference."""
    return Series(np.ones(count), np.full(count, -1), np.ones(count), np.zeros(count, dtype=int), 1)


class NoiseModel(eqx.Module):
    """How a measurement scatters. Every attribute that is a number may be a parameter of the inference.

    Attributes:
        known: Standard deviations that come with the data, in their unit, or None.
        scale: Factor on the known ones [1].
        additive: The same for all data, in their unit.
        relative: Fraction of the prediction [1].
        exponent: Power of the coordinate over its geometric mean with which deviations grow [1].
        step_ratio: Factor on deviations above `step_place` [1].
        correlation: Of neighbours one usual distance apart, above -1 and below 1 [1].
        degrees_of_freedom: Of Student's t; None for normal noise.
        reference_relative: Deviation of the reference reading as a fraction of it [1]; None where data were not
            divided by one. `tie_reference` sets it to `relative` instead.
        step_place: Coordinate above which the step acts.
        tie_reference: Whether the reference reading scatters as every other does, by `relative`.
    """

    known: Numbers | None = None
    scale: Scalar = 1.0
    additive: Scalar = 0.0
    relative: Scalar = 0.0
    exponent: Scalar = 0.0
    step_ratio: Scalar = 1.0
    correlation: Scalar = 0.0
    degrees_of_freedom: Scalar | None = None
    reference_relative: Scalar | None = None
    step_place: float = eqx.field(static=True, default=float("inf"))
    tie_reference: bool = eqx.field(static=True, default=False)

    def __check_init__(self) -> None:
        """Refuse noise that is none, and what no likelihood is written for."""
        for name in ("scale", "additive", "relative", "step_ratio"):
            value = getattr(self, name)
            if not isinstance(value, Tracer | jax.Array) and not (isinstance(value, float | int) and value >= 0.0):
                raise InputError(f"`{name}` of the noise must be a number of at least 0, got {value}.")
        if self.known is None and self._is_zero(self.additive) and self._is_zero(self.relative):
            raise InputError("noise needs `known` standard deviations, an `additive` or a `relative` part; got none.")
        if self.normalised and self.degrees_of_freedom is not None:
            raise InputError(
                "normalised data with Student-t noise have no closed likelihood: leave out `degrees_of_freedom`, or "
                "give the data in metres."
            )

    @staticmethod
    def _is_zero(value: Scalar) -> bool:
        return isinstance(value, float | int) and value == 0.0

    @property
    def normalised(self) -> bool:
        """Whether data were divided by a reading of their own group."""
        return self.tie_reference or self.reference_relative is not None

    @property
    def is_normal(self) -> bool:
        """Whether what is left after correlation is normal."""
        return self.degrees_of_freedom is None

    def deviations(self, prediction: Float[Array, " n"], series: Series) -> Float[Array, " n"]:
        """Standard deviation of each datum (scale, for Student's t), but for that of the reference."""
        variance = self.additive**2 + (self.relative * prediction) ** 2
        if self.known is not None:
            variance = variance + (self.scale * jnp.asarray(self.known)) ** 2
        coordinate = jnp.asarray(series.coordinate)
        middle = jnp.exp(jnp.mean(jnp.log(coordinate)))
        shape = (coordinate / middle) ** self.exponent * jnp.where(coordinate > self.step_place, self.step_ratio, 1.0)
        return jnp.sqrt(variance) * shape

    def log_likelihood(
        self, measured: Float[Array, " n"], prediction: Float[Array, " n"], series: Series
    ) -> Float[Array, ""]:
        """Logarithm of the density of the measured numbers [of one over their units]."""
        terms = jnp.sum(self.terms(measured, prediction, series))
        if not self.normalised:
            return terms
        white, shared = self._white(measured, prediction, series)
        overlap, length = _by_group(white * shared, series), _by_group(shared**2, series)
        return terms + 0.5 * jnp.sum(overlap**2 / (1.0 + length) - jnp.log1p(length))

    def terms(self, measured: Float[Array, " n"], prediction: Float[Array, " n"], series: Series) -> Float[Array, " n"]:
        """Each datum's part, given those before it in its series; without the shared error of the reference."""
        deviation = self.deviations(prediction, series)
        follows = jnp.asarray(series.previous) >= 0
        correlation = self._correlation(series)
        white = self._innovations((measured - prediction) / deviation, series)
        log_scale = jnp.log(deviation) + jnp.where(follows, 0.5 * jnp.log1p(-(correlation**2)), 0.0)
        if self.degrees_of_freedom is None:
            return stats.norm.logpdf(white) - log_scale
        return stats.t.logpdf(white, self.degrees_of_freedom) - log_scale

    def residuals(
        self, measured: Float[Array, " n"], prediction: Float[Array, " n"], series: Series
    ) -> Float[Array, " n"]:
        """Independent residuals in standard deviations, prediction minus measurement, of normal noise.

        Half their sum of squares is minus the log likelihood but for terms that depend on deviations alone.
        """
        white, shared = self._white(measured, prediction, series)
        if not self.normalised:
            return -white
        overlap, length = _by_group(white * shared, series), _by_group(shared**2, series)
        safe = jnp.where(length > 0.0, length, 1.0)
        factor = jnp.where(length > 0.0, (1.0 - 1.0 / jnp.sqrt(1.0 + length)) / safe, 0.0) * overlap
        return -(white - shared * factor[jnp.asarray(series.group)])

    def draw(self, key: PRNGKeyArray, prediction: Float[Array, " n"], series: Series) -> Float[Array, " n"]:
        """Data as they would be measured."""
        own, reference = jax.random.split(key)
        shape = prediction.shape
        if self.degrees_of_freedom is None:
            fresh = jax.random.normal(own, shape)
        else:
            fresh = jax.random.t(own, self.degrees_of_freedom, shape)
        scatter = self._correlated(fresh, series) * self.deviations(prediction, series)
        if not self.normalised:
            return prediction + scatter
        shared = self._reference_deviation() * jax.random.normal(reference, (series.n_groups,))
        return prediction + scatter - prediction * shared[jnp.asarray(series.group)]

    def _white(self, measured, prediction, series) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        deviation = self.deviations(prediction, series)
        white = self._innovations((measured - prediction) / deviation, series)
        if not self.normalised:
            return white, jnp.zeros_like(white)
        return white, self._innovations(self._reference_deviation() * prediction / deviation, series)

    def _reference_deviation(self) -> Scalar:
        if self.tie_reference or self.reference_relative is None:
            return self.relative
        return self.reference_relative

    def _correlation(self, series: Series) -> Float[Array, " n"]:
        """With the neighbour before; a negative one cannot be spread over unequal distances, and is not."""
        correlation, gap = jnp.asarray(self.correlation), jnp.asarray(series.gap)
        size = jnp.maximum(jnp.abs(correlation), 1e-300)
        powered = jnp.where(correlation > 0.0, size**gap, correlation)
        return jnp.where(correlation == 0.0, correlation * gap, powered)

    def _innovations(self, scaled: Float[Array, " n"], series: Series) -> Float[Array, " n"]:
        follows = jnp.asarray(series.previous) >= 0
        correlation = self._correlation(series)
        before = scaled[jnp.asarray(series.previous)]
        return jnp.where(follows, (scaled - correlation * before) / jnp.sqrt(1.0 - correlation**2), scaled)

    def _correlated(self, fresh: Float[Array, " n"], series: Series) -> Float[Array, " n"]:
        correlation, before = self._correlation(series), jnp.asarray(series.previous)
        new = jnp.sqrt(1.0 - correlation**2) * fresh

        # As many rounds as the longest series is long would do; the order of the data need not be known.
        def settle(_, values: Float[Array, " n"]) -> Float[Array, " n"]:
            return jnp.where(before >= 0, correlation * values[before] + new, fresh)

        return jax.lax.fori_loop(0, len(fresh), settle, fresh)


def _by_group(values: Float[Array, " n"], series: Series) -> Float[Array, " group"]:
    return jax.ops.segment_sum(values, jnp.asarray(series.group), num_segments=series.n_groups)
