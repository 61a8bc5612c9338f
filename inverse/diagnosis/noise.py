r"""Noise that is not what one thought: a family of covariances, and the change of coordinates in which each is white.

A member has standard deviations that step at one place of a coordinate (noise that is larger above some frequency) and
correlation $\rho^{|i-j|}$ of neighbours along an ordering (along frequency, or along time). The size of the noise is
common to all and never assumed: statistics divide it out. White noise of one size is the first member; the others pay
`log_prior`, because a family that is free to explain everything as noise costs power (measured on a sweep of 14
frequencies at five temperatures: threshold 2.96 instead of 2.82 of a largest t-statistic, at 2.73 for known noise).
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

CORRELATIONS = (0.0, 0.2, 0.4, 0.6, 0.8)
STEP_PLACES = (0.2, 0.5, 0.7, 0.85)
"""Quantiles of the coordinate at which the standard deviation of correlated noise may step."""
FINE_STEP_PLACES = tuple(place / 14.0 for place in range(1, 14))
"""The same for noise without correlation. A step that is met but for one of three loud frequencies doubles the false
alarms (10 instead of 5 in 100 data sets of noise three times larger above 40 Hz)."""
STEP_RATIOS = (1.7, 3.0)
LOG_PRIOR_OF_STEP = -2.5
LOG_PRIOR_OF_CORRELATION = -1.5
"""Penalties in nats, close to what a likelihood gains from one and two parameters that are not there (Akaike)."""


@dataclasses.dataclass(frozen=True)
class Ordering:
    """Which datum is the neighbour of which.

    Attributes:
        name: Along what, for reports.
        previous: Index of the datum before, or -1 at the start of a series.
    """

    name: str
    previous: Int[np.ndarray, " n"]

    @property
    def neighbours(self) -> frozenset[tuple[int, int]]:
        """Pairs of neighbours, whichever comes first."""
        later = np.flatnonzero(self.previous >= 0)
        return frozenset(
            (min(pair), max(pair)) for pair in zip(later.tolist(), self.previous[later].tolist(), strict=True)
        )


@dataclasses.dataclass(frozen=True)
class Noise:
    """One member of the family.

    Attributes:
        correlation: Between neighbours.
        ordering: Along which.
        log_deviation: Logarithm of the standard deviation of each datum, but for a common factor.
        log_prior: Of this member.
        step: Ratio of the deviations on both sides of the step; 1 without.
        place: Value of the coordinate at the step; NaN without.
        unit: Of the coordinate.
        beliefs: How many data at the end are what is believed of fitted constants: their size says nothing of noise.
    """

    correlation: float
    ordering: Ordering
    log_deviation: Float[np.ndarray, " n"]
    log_prior: float
    step: float
    place: float
    unit: str = ""
    beliefs: int = 0

    def whiten(self, data: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
        """Data in coordinates in which this noise is white and of size one."""
        scaled = data * np.exp(-self.log_deviation)[:, None]
        if self.correlation == 0.0:
            return scaled
        later = self.ordering.previous >= 0
        before = scaled[self.ordering.previous]
        innovation = (scaled - self.correlation * before) / math.sqrt(1.0 - self.correlation**2)
        return np.where(later[:, None], innovation, scaled)

    def whiten_transposed(self, white: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
        """The transpose of `whiten`: the product of its result with `white` is that of its argument with this."""
        scaled = np.array(white)
        if self.correlation != 0.0:
            later = np.flatnonzero(self.ordering.previous >= 0)
            factor = 1.0 / math.sqrt(1.0 - self.correlation**2)
            scaled[later] = factor * white[later]
            # Every datum is before one other at most, so that no place is added to twice.
            scaled[self.ordering.previous[later]] -= self.correlation * factor * white[later]
        return scaled * np.exp(-self.log_deviation)[:, None]

    def colour(self, white: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
        """The inverse of `whiten`: noise of this kind from white noise."""
        scaled = np.array(white)
        if self.correlation != 0.0:
            factor = math.sqrt(1.0 - self.correlation**2)
            for layer in _layers(self.ordering.previous):
                before = scaled[self.ordering.previous[layer]]
                scaled[layer] = self.correlation * before + factor * scaled[layer]
        return scaled * np.exp(self.log_deviation)[:, None]

    @property
    def loudness(self) -> float:
        """Root mean square of the deviations of all readings."""
        readings = self.log_deviation[: len(self.log_deviation) - self.beliefs]
        return float(np.sqrt(np.mean(np.exp(2.0 * readings))))

    def extended(self, count: int) -> "Noise":
        """With so many more data at the end, independent, which are what is believed of constants.

        Their deviation is that of all readings together, in whatever kind of noise. If it were 1, noise that is louder
        above the coldest reading would be noise that is louder than beliefs: the likeliest kind wherever constants are
        nearer to their middle than is believed. (57 white readings, 9 constants with 0.6 of the deviation that is
        believed: a step was the likeliest in 55 of 100 sets and is in 15, as where they have all of it; noise three
        times louder above the middle, constants as believed: the ratio was met in 50 of 100 and is in 93.)
        """
        previous = np.append(self.ordering.previous, np.full(count, -1))
        return dataclasses.replace(
            self,
            ordering=dataclasses.replace(self.ordering, previous=previous),
            log_deviation=np.append(self.log_deviation, np.full(count, math.log(self.loudness))),
            beliefs=self.beliefs + count,
        )

    def of_first(self, count: int) -> "Noise":
        """Of so many data at the beginning, which none of the others comes before."""
        ordering = dataclasses.replace(self.ordering, previous=self.ordering.previous[:count])
        beliefs = max(self.beliefs - (len(self.log_deviation) - count), 0)
        return dataclasses.replace(self, ordering=ordering, log_deviation=self.log_deviation[:count], beliefs=beliefs)

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the covariance."""
        later = int(np.sum(self.ordering.previous >= 0))
        return float(2.0 * np.sum(self.log_deviation)) + later * math.log(1.0 - self.correlation**2)

    @property
    def is_white(self) -> bool:
        """Whether this is uncorrelated noise of one size."""
        return self.correlation == 0.0 and self.step == 1.0

    def describe(self) -> str:
        """In words."""
        if self.is_white:
            return "white, of one size"
        words = []
        if self.step != 1.0:
            larger, where = (self.step, "above") if self.step > 1.0 else (1.0 / self.step, "below")
            words.append(f"{larger:.2g} times larger {where} {self.place:.3g} {self.unit}".rstrip())
        if self.correlation:
            words.append(f"correlated by {self.correlation:.2g} between neighbours along {self.ordering.name}")
        return ", ".join(words)


def noise_family(
    orderings: Sequence[Ordering], coordinate: Float[np.ndarray, " n"], *, unit: str = ""
) -> tuple[Noise, ...]:
    """Members to choose from, white noise of one size first.

    Args:
        orderings: Along which neighbours may be correlated.
        coordinate: Along which the standard deviation may step, such as frequency.
        unit: Of that.
    """
    flat = np.zeros(len(coordinate))
    members = []
    for correlation in CORRELATIONS:
        places = FINE_STEP_PLACES if correlation == 0.0 else STEP_PLACES
        levels = [(flat, 1.0, math.nan), *_steps(coordinate, places)]
        for ordering in orderings[: 1 if correlation == 0.0 else None]:
            for log_deviation, step, place in levels:
                prior = LOG_PRIOR_OF_STEP * (step != 1.0) + LOG_PRIOR_OF_CORRELATION * (correlation != 0.0)
                members.append(Noise(correlation, ordering, log_deviation, prior, step, place, unit))
    return tuple(members)


def series(name: str, keys: Sequence, positions: Float[np.ndarray, " n"]) -> Ordering:
    """Ordering of data that share a key, by position.

    Args:
        name: Along what.
        keys: What the data of one series have in common, such as sweep and coordinate.
        positions: Of each datum within its series.
    """
    previous = np.full(len(positions), -1)
    groups: dict = {}
    for index in np.argsort(positions, kind="stable"):
        key = keys[index]
        previous[index] = groups.get(key, -1)
        groups[key] = int(index)
    return Ordering(name, previous)


def _steps(
    coordinate: Float[np.ndarray, " n"], quantiles: Sequence[float]
) -> list[tuple[Float[np.ndarray, " n"], float, float]]:
    distinct = np.unique(coordinate)
    places = sorted({int(round(quantile * len(distinct))) for quantile in quantiles} - {0, len(distinct)})
    found = []
    for place in places:
        middle = math.sqrt(distinct[place - 1] * distinct[place]) if distinct[place - 1] > 0.0 else distinct[place]
        above = coordinate >= distinct[place]
        for ratio in STEP_RATIOS:
            found.append((np.where(above, math.log(ratio), 0.0), ratio, float(middle)))
            found.append((np.where(above, 0.0, math.log(ratio)), 1.0 / ratio, float(middle)))
    return found


def _layers(previous: Int[np.ndarray, " n"]) -> list[Int[np.ndarray, " m"]]:
    """Second, third, ... data of all series: each depends on the layer before only."""
    depth = np.zeros(len(previous), dtype=int)
    pending = np.flatnonzero(previous >= 0)
    while pending.size:
        updated = depth[previous[pending]] + 1
        changed = updated != depth[pending]
        depth[pending] = updated
        pending = pending[changed] if np.any(changed) else pending[:0]
    return [np.flatnonzero(depth == level) for level in range(1, int(depth.max(initial=0)) + 1)]
