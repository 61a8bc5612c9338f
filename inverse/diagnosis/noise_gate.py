"""Is the noise what one thought? Asked before any physics is blamed, and answered with what it is instead."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy import stats

from inverse.diagnosis.screening import Screen

GATE_LEVEL = 0.01
"""Probability of calling white noise something else, for each of the questions."""
_SAME = 1e-9
"""Scatter of repeats, over the residuals' size, at which they are the same reading written again: that is no repeat."""


@dataclasses.dataclass(frozen=True)
class Repeats:
    """Readings that were taken again.

    Attributes:
        scatter: Pooled, weighted as the residuals are; NaN without any.
        freedom: Degrees of freedom.
    """

    scatter: float
    freedom: int


@dataclasses.dataclass(frozen=True)
class NoiseGate:
    """What is known about the noise.

    Attributes:
        kind: The likeliest member of the family, in words.
        p_white: That white noise of one size looks as unlike it.
        size: Standard deviation of the residuals, in units of the stated ones, or relative where none are stated [1];
            of readings alone, where what is believed of constants is among the data.
        p_size: That noise of the stated size leaves residuals as large, or as small; NaN where none is stated.
        excess_kurtosis: Of the whitened residuals; 0 for Gaussian noise.
        p_tails: That Gaussian noise has as heavy tails.
        repeats: Scatter of repeated measurements at the same frequency and sweep, in the unit of `size`; NaN without.
        repeats_freedom: Degrees of freedom of that scatter.
        p_repeats: That noise which scatters repeats so leaves residuals as large: the classical test of lack of fit;
            NaN without repeats.
    """

    kind: str
    p_white: float
    size: float
    p_size: float
    excess_kurtosis: float
    p_tails: float
    repeats: float
    repeats_freedom: int
    p_repeats: float

    @property
    def as_thought(self) -> bool:
        """Whether white Gaussian noise would do, of the stated size if one is stated, as large as repeats scatter."""
        return bool(np.nanmin([self.p_white, self.p_size, self.p_tails, self.p_repeats]) >= GATE_LEVEL)

    def describe(self) -> str:
        """In words."""
        words = [f"the noise is {self.kind}"]
        if self.p_white >= GATE_LEVEL:
            words = ["nothing says that the noise is not white and of one size"]
        if self.p_size < GATE_LEVEL:
            words.append(f"{self.size:.2f} times the stated standard deviations")
        if self.p_tails < GATE_LEVEL:
            words.append(f"with tails heavier than Gaussian (excess kurtosis {self.excess_kurtosis:.1f})")
        if self.p_repeats < GATE_LEVEL:
            words.append(f"{self.size / self.repeats:.2f} times as large as repeated readings scatter")
        return ", ".join(words)


def noise_gate(
    screen: Screen,
    residuals: Float[np.ndarray, " n"],
    rng: np.random.Generator,
    *,
    stated: bool,
    repeats: Repeats | None = None,
    replicates: int = 400,
) -> NoiseGate:
    """Examine the residuals of a model that is taken to be right.

    Args:
        screen: Of that model.
        residuals: Measured less predicted, weighted.
        rng: For replicates of white Gaussian noise.
        stated: Whether the residuals are in units of deviations that the data give.
        repeats: Scatter of repeated readings, if there are any.
        replicates: How many.
    """
    readings = len(residuals) - screen.family[0].beliefs
    size, freedom, width = screen.of_readings(residuals)
    white = rng.standard_normal((len(residuals), replicates))
    white[readings:] *= width
    gain, member, left = screen.noise_evidence(np.concatenate([residuals[:, None], white], axis=1))
    kurtosis = stats.kurtosis(left[:readings], axis=0)
    again = Repeats(np.nan, 0) if repeats is None else repeats
    return NoiseGate(
        kind=screen.family[member[0]].describe(),
        p_white=_upper(gain),
        size=size,
        p_size=_as_far(size**2 * freedom, freedom) if stated else np.nan,
        excess_kurtosis=float(kurtosis[0]),
        p_tails=_upper(kurtosis),
        repeats=again.scatter,
        repeats_freedom=again.freedom,
        p_repeats=_lack_of_fit(size, freedom, again),
    )


def _as_far(square: float, freedom: float) -> float:
    """p-value of chi-square to both sides."""
    return 2.0 * min(float(stats.chi2.sf(square, freedom)), float(stats.chi2.cdf(square, freedom)))


def _lack_of_fit(size: float, freedom: float, repeats: Repeats) -> float:
    """p-value of F: what residuals have beyond the scatter of repeats, over that."""
    rest = freedom - repeats.freedom
    if repeats.freedom == 0 or rest <= 0 or repeats.scatter <= _SAME * size:
        return np.nan
    beyond = (size**2 * freedom - repeats.scatter**2 * repeats.freedom) / rest
    return float(stats.f.sf(beyond / repeats.scatter**2, rest, repeats.freedom))


def _upper(values: Float[np.ndarray, " batch"]) -> float:
    """Share of the replicates that are as large as the first value."""
    return float((1.0 + np.sum(values[1:] >= values[0])) / len(values))
