"""Is the noise what one thought? Asked before any physics is blamed, and answered with what it is instead."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

from inverse.diagnosis.screening import Screen

GATE_LEVEL = 0.01
"""Probability of calling white noise something else, for each of the questions."""
REPLICATES_OF_SIZES = 999
"""Of white noise, that say how unlike the sizes of coordinates look."""
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
class Coordinates:
    """What each residual is of, where a reading has several numbers.

    Attributes:
        names: In words.
        which: Place of each residual's in `names`.
        weighed: Whether each weighs by the size of its own noise.
        factors: Those sizes, that residuals were divided by beside their weights; of geometric mean 1.
        p_alike: That noise of one size looks as unlike, where each weighs by its own.
    """

    names: tuple[str, ...]
    which: Int[np.ndarray, " n"]
    weighed: bool
    factors: Float[np.ndarray, " coordinate"]
    p_alike: float


@dataclasses.dataclass(frozen=True)
class NoiseGate:
    """What is known about the noise.

    Attributes:
        kind: The likeliest member of the family, in words.
        p_white: That white noise of one size looks as unlike it.
        size: Standard deviation of the residuals, in units of the stated ones, or relative where none are stated [1];
            of readings alone, where what is believed of constants is among the data. The geometric mean of
            coordinates that weigh by their own sizes.
        p_size: That noise of the stated size leaves residuals as large, or as small; NaN where none is stated.
        sizes: The size of each coordinate by its name; empty where readings have one.
        p_sizes: That noise of one size looks as unlike; NaN where readings have one coordinate.
        weighed: Whether each coordinate weighs by its own size.
        excess_kurtosis: Of the whitened residuals, each coordinate by its own size if these differ; 0 for Gaussian
            noise.
        p_tails: That Gaussian noise has as heavy tails.
        repeats: Scatter of repeated measurements at the same frequency and sweep, in the unit of `size`; NaN without.
        repeats_freedom: Degrees of freedom of that scatter.
        p_repeats: That noise which scatters repeats so leaves residuals as large: the classical test of lack of fit;
            NaN without repeats, for those that are the same reading written again, and where nothing is left beside.
    """

    kind: str
    p_white: float
    size: float
    p_size: float
    sizes: dict[str, float]
    p_sizes: float
    weighed: bool
    excess_kurtosis: float
    p_tails: float
    repeats: float
    repeats_freedom: int
    p_repeats: float

    @property
    def as_thought(self) -> bool:
        """Whether white Gaussian noise would do, of the stated size if one is stated, as large as repeats scatter."""
        asked = [self.p_white, self.p_size, self.p_sizes, self.p_tails, self.p_repeats]
        return bool(np.nanmin(asked) >= GATE_LEVEL)

    def describe(self) -> str:
        """In words."""
        words = []
        if self.p_white < GATE_LEVEL:
            words.append(self.kind)
        if self.p_size < GATE_LEVEL:
            words.append(f"{self.size:.2f} times the stated standard deviations")
        if self.p_sizes < GATE_LEVEL:
            each = " and ".join(f"{size:.2g} in {name}" for name, size in self.sizes.items())
            words.append(f"of size {each}, {'each weighing by its own' if self.weighed else 'where they weigh alike'}")
        if self.p_tails < GATE_LEVEL:
            words.append(f"of tails heavier than Gaussian (excess kurtosis {self.excess_kurtosis:.1f})")
        if self.p_repeats < GATE_LEVEL:
            words.append(f"{self.size / self.repeats:.2f} times as large as repeated readings scatter")
        if not words:
            return "nothing says that the noise is not white and of one size"
        return f"the noise is {', '.join(words)}"


def noise_gate(
    screen: Screen,
    residuals: Float[np.ndarray, " n"],
    rng: np.random.Generator,
    *,
    stated: bool,
    repeats: Repeats | None = None,
    coordinates: Coordinates | None = None,
    replicates: int = 400,
) -> NoiseGate:
    """Examine the residuals of a model that is taken to be right.

    Args:
        screen: Of that model.
        residuals: Measured less predicted, weighted.
        rng: For replicates of white Gaussian noise.
        stated: Whether the residuals are in units of deviations that the data give.
        repeats: Scatter of repeated readings, if there are any.
        coordinates: Of the residuals, where readings have several.
        replicates: How many.
    """
    readings = len(residuals) - screen.family[0].beliefs
    size, freedom, width = screen.of_readings(residuals)
    white = rng.standard_normal((len(residuals), replicates))
    white[readings:] *= width
    gain, member, left = screen.noise_evidence(np.concatenate([residuals[:, None], white], axis=1))
    left = left[:readings]
    sizes, p_sizes = {}, np.nan
    if coordinates is not None and len(coordinates.names) > 1:
        of_each = _sizes(left, coordinates)
        p_sizes = _upper(np.log(of_each.max(axis=0) / of_each.min(axis=0)))
        whole = np.sqrt(np.mean(left[:, 0] ** 2))
        each = size * of_each[:, 0] / whole * coordinates.factors
        sizes = dict(zip(coordinates.names, each.tolist(), strict=True))
        if p_sizes < GATE_LEVEL:
            left = left / of_each[coordinates.which]
        if coordinates.weighed:
            p_sizes = coordinates.p_alike
    kurtosis = stats.kurtosis(left, axis=0)
    again = Repeats(np.nan, 0) if repeats is None else repeats
    return NoiseGate(
        kind=screen.family[member[0]].describe(),
        p_white=_upper(gain),
        size=size,
        p_size=_as_far(size**2 * freedom, freedom) if stated else np.nan,
        sizes=sizes,
        p_sizes=p_sizes,
        weighed=coordinates is not None and coordinates.weighed,
        excess_kurtosis=float(kurtosis[0]),
        p_tails=_upper(kurtosis),
        repeats=again.scatter,
        repeats_freedom=again.freedom,
        p_repeats=_lack_of_fit(size, freedom, again),
    )


def _sizes(left: Float[np.ndarray, "n batch"], coordinates: Coordinates) -> Float[np.ndarray, "coordinate batch"]:
    """Root mean square of each coordinate's residuals."""
    parts = [left[coordinates.which == one] for one in range(len(coordinates.names))]
    return np.maximum(np.stack([np.sqrt(np.mean(part**2, axis=0)) for part in parts]), 1e-300)


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
