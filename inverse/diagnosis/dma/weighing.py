r"""Noise of magnitude and phase, which an instrument seldom has of one size, and the weights that follow.

What constants, causes and coarse corrections of no name can take is projected out. Of what is left, $e$ in coordinates
in which both have the size one, $\sum_{i \in c} e_i^2 = \sum_{i \in c} (1 - h_i)$ with $h$ the leverages is where the
restricted likelihood of two sizes is largest: solved by turns with the weights that the sizes give. Squares count up to
`_OUTLYING` standard deviations: a slip of one reading, or a nameless effect in few, is no size of all.

Whether both are of one size is asked first, where they weigh alike: how unlike they are without the frequency, or the
sweep, without which they are least so, beside Gaussian replicates. (Of 200 sets of equal noise with a slip of 20
standard deviations, sums of squares found 196 unlike.) All of it in coordinates in which the noise's likeliest kind is
white: neighbours that share their noise tell less of its size.

Source: Patterson & Thompson (1971), recovery of inter-block information when block sizes are unequal; Huber (1964),
robust estimation of a location parameter (proposal 2, of scale).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

from inverse.datasets.dma import frequency_groups
from inverse.diagnosis.dma.problem import DmaProblem
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.noise_gate import GATE_LEVEL, REPLICATES_OF_SIZES
from inverse.diagnosis.projection import independent, project_out, unit_columns
from inverse.diagnosis.screening import Alternative

_SHARE = 0.25
"""Of the data to spare, that effects may take before the rest counts as noise."""
_VISIBLE = 0.1
"""Singular value, over the largest, of directions of effects that count."""
_GROSS = 10.0
"""Square that effects take along each of their directions, over that of a datum left, above which they are so large
(d' of 16 where they take 30 directions) that what bends of them is left, too: that is no noise."""
_LEAST_FREEDOM = 6.0
"""Of each coordinate; with less its size is not told."""
_MOST = 30.0
"""Ratio of sizes that is believed."""
_OUTLYING = 2.0
_COUNTED = float(2.0 * stats.norm.cdf(_OUTLYING) - 1.0 - 2.0 * _OUTLYING * stats.norm.pdf(_OUTLYING)) + float(
    2.0 * _OUTLYING**2 * stats.norm.sf(_OUTLYING)
)
"""Mean square of a normal number of which the square counts up to there."""
_MOST_PARTS = 14
"""Of frequencies, and of sweeps, that are left out in turn."""
_TURNS, _SETTLED = 100, 1e-6
_SMALL = 1e-9


@dataclasses.dataclass(frozen=True)
class Weighing:
    """What readings of magnitude and phase were divided by, beside their weights.

    Attributes:
        differs: Whether both weigh by their own sizes.
        factors: Sizes of their noise over the geometric mean of both; 1 where both weigh alike.
        p_alike: That white noise of one size looks as unlike; NaN where that was not asked.
    """

    differs: bool
    factors: Float[np.ndarray, " coordinate"]
    p_alike: float


def weighed_by_noise(problem: DmaProblem, effects: Sequence[Alternative], noise: Noise) -> tuple[DmaProblem, Weighing]:
    """The problem with magnitude and phase weighed by the sizes of their noise, where these differ.

    Args:
        problem: Data and fit.
        effects: About the fit; what they can take is not counted as noise.
        noise: Its likeliest kind: how it steps and who shares it, of magnitude and phase alike.

    Returns:
        The problem as it was where sizes do not differ, or cannot be told: readings of the magnitude alone, few of
        them, or gross effects.
    """
    alike = Weighing(differs=False, factors=np.ones(problem.weights.shape[1]), p_alike=np.nan)
    if not problem.has_phase:
        return problem, alike
    residuals, fitted = noise.whiten(problem.residuals()[:, None])[:, 0], noise.whiten(problem.fitted_directions())
    directions, taken = _spanned(residuals, fitted, [noise.whiten(_finite(one.directions)) for one in effects])
    which = np.tile(np.arange(2), problem.rows)
    # From a generator of their own: what follows draws the same whether sizes differ or not.
    white = np.random.default_rng(0).standard_normal((len(residuals), REPLICATES_OF_SIZES))
    across = _across(directions)
    if np.min(_freedom(np.diagonal(across), which)) < _LEAST_FREEDOM or taken > _GROSS:
        return problem, alike
    unlike = _unlike(np.concatenate([residuals[:, None], white], axis=1), across, which, _parts(problem))
    p_alike = float(np.mean(unlike >= unlike[0]))
    alike = dataclasses.replace(alike, p_alike=p_alike)
    factors = _settled(residuals, directions, which) if p_alike < GATE_LEVEL else None
    if factors is None:
        return problem, alike
    weighed = dataclasses.replace(problem, weights=problem.weights / factors)
    return weighed, Weighing(differs=True, factors=factors, p_alike=p_alike)


def _finite(columns: Float[np.ndarray, "n q"]) -> Float[np.ndarray, "n r"]:
    return columns[:, np.all(np.isfinite(columns), axis=0)]


def _spanned(residuals, fitted, effects) -> tuple[Float[np.ndarray, "n p"], float]:
    """Directions of constants, and those along which effects are most; and the square that these take, see `_GROSS`."""
    basis = independent(fitted)
    columns = np.concatenate([np.zeros((len(residuals), 0)), *effects], axis=1)
    visible = project_out(unit_columns(columns), basis)
    axes, singular, _ = np.linalg.svd(visible, full_matrices=False)
    spare = len(residuals) - basis.shape[1]
    least = max(_VISIBLE * float(np.max(singular, initial=0.0)), _SMALL)
    count = min(int(np.sum(singular > least)), int(_SHARE * spare))
    left = project_out(residuals[:, None], basis)
    rest = project_out(left, axes[:, :count])
    before, after = float(np.sum(left**2)), max(float(np.sum(rest**2)), 1e-300)
    taken = (before - after) / max(count, 1) / (after / max(spare - count, 1))
    return np.concatenate([fitted, axes[:, :count]], axis=1), taken


def _parts(problem: DmaProblem) -> list[Int[np.ndarray, " part"]]:
    """Residuals of each frequency and of each sweep, or of as many blocks of neighbours: see `_unlike`."""
    groups = frequency_groups(np.asarray(problem.conditions.angular_frequency)), np.asarray(problem.conditions.sweep)
    parts = []
    for group in groups:
        count = 1 + int(group.max())
        block = np.repeat(group * min(_MOST_PARTS, count) // count, 2)
        parts += [np.flatnonzero(block == one) for one in np.unique(block)] if count > 1 else []
    return parts


def _unlike(data, across, which, parts) -> Float[np.ndarray, " batch"]:
    """Logarithm of the ratio of sizes, without the part without which it is least; 0 if that turns it."""
    whole, ratios = across @ data, []
    for part in parts:
        # As if each of its numbers had a constant of its own.
        given = across[:, part] @ np.linalg.pinv(across[np.ix_(part, part)], rcond=_SMALL, hermitian=True)
        kept = np.setdiff1d(np.arange(len(which)), part)
        left = (whole - given @ whole[part])[kept]
        free = (np.diagonal(across) - np.sum(given * across[:, part], axis=1))[kept]
        ratios.append(np.log(np.divide(*_sizes(left, free, which[kept], 1e-3))))
    each = np.stack(ratios)
    each -= np.median(each[:, 1:], axis=1, keepdims=True)
    return np.maximum(np.maximum(each.min(axis=0), -each.max(axis=0)), 0.0)


def _settled(residuals, directions, which) -> Float[np.ndarray, " 2"] | None:
    """Sizes over their geometric mean that give the weights that they are found with; None if there are none."""
    log_ratio, most = 0.0, np.log(_MOST)
    for _ in range(_TURNS):
        factors = np.exp(np.array([0.5, -0.5]) * log_ratio)
        across = _across(directions / factors[which, None])
        free = np.diagonal(across)
        if np.min(_freedom(free, which)) < _LEAST_FREEDOM:
            return None
        magnitude, phase = _sizes(across @ (residuals / factors[which])[:, None], free, which, _SETTLED)
        step = float(np.clip(log_ratio + np.log(magnitude[0] / phase[0]), -most, most)) - log_ratio
        log_ratio += step
        if abs(step) < _SETTLED:
            return np.exp(np.array([0.5, -0.5]) * log_ratio)
    return None


def _across(directions: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n n"]:
    """Projection off directions."""
    basis = independent(directions)
    return np.eye(len(basis)) - basis @ basis.T


def _freedom(free, which) -> list[float]:
    """Degrees of freedom of each coordinate."""
    return [float(np.sum(free[which == one])) for one in (0, 1)]


def _sizes(left, free, which, tolerance: float) -> list[Float[np.ndarray, " batch"]]:
    """Of the noise of magnitude and phase."""
    return [_robust_size(left[which == one], free[which == one], tolerance) for one in (0, 1)]


def _robust_size(
    left: Float[np.ndarray, "n batch"], free: Float[np.ndarray, " n"], tolerance: float
) -> Float[np.ndarray, " batch"]:
    """Of normal numbers of which `free` of the variance is left, by squares up to `_OUTLYING` sizes."""
    variance = np.maximum(free, _SMALL)[:, None]
    square = left**2 / variance
    size = np.maximum(np.sqrt(np.sum(left**2, axis=0) / np.sum(variance)), 1e-150)
    for _ in range(_TURNS):
        counted = np.minimum(square, (_OUTLYING * size) ** 2) * variance
        before, size = size, np.sqrt(np.sum(counted, axis=0) / (_COUNTED * np.sum(variance)))
        if np.all(np.abs(size - before) <= tolerance * before):
            break
    return np.maximum(size, 1e-150)
