"""What an extension is worth on data that the fit did not see: scores of what was left out, summed up.

A gain proves no cause: measured on data with a hidden effect, a wrong cause gained in 62 to 81 % of cases.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

LEAST_FOLDS = 2

Scored = tuple[Float[np.ndarray, " _"], float]
"""Relative residuals of what a fold leaves out, and their summed log density."""


@dataclasses.dataclass(frozen=True)
class Gain:
    """Held-out scores before and after.

    Attributes:
        split: How the data were left out, in words.
        rmse_before: Root mean square of the held-out relative differences without the extension [1].
        rmse_before_error: Standard error of that, from the scatter of the blocks.
        rmse_after: The same with it.
        rmse_after_error: Standard error of that.
        log_score_gain: Mean gain in log predictive density per datum [nat].
        standard_error: Of that mean, from the scatter of the blocks.
        unfinished: Refits that did not converge; their scores are in the mean.
    """

    split: str
    rmse_before: float
    rmse_before_error: float
    rmse_after: float
    rmse_after_error: float
    log_score_gain: float
    standard_error: float
    unfinished: int


def summed_up(
    split: str, before: list[Scored], after: list[Scored], member: Sequence[float | int], unfinished: int
) -> Gain:
    """The gain from the scores of all folds.

    Args:
        split: What was left out.
        before: Of every fold without the extension.
        after: With it.
        member: Group of every fold; groups are taken for independent, in errors.
        unfinished: Refits that did not converge.
    """
    gains = np.array([a[1] - b[1] for a, b in zip(after, before, strict=True)])
    counts = np.array([len(a[0]) for a in after])
    together = [np.flatnonzero(np.asarray(member) == one) for one in np.unique(member)]
    per_group = np.array([np.sum(gains[own]) / np.sum(counts[own]) for own in together])
    rmse_before, rmse_before_error = root_mean_square([np.concatenate([before[i][0] for i in own]) for own in together])
    rmse_after, rmse_after_error = root_mean_square([np.concatenate([after[i][0] for i in own]) for own in together])
    return Gain(
        split=split,
        rmse_before=rmse_before,
        rmse_before_error=rmse_before_error,
        rmse_after=rmse_after,
        rmse_after_error=rmse_after_error,
        log_score_gain=float(np.sum(gains) / np.sum(counts)),
        standard_error=float(np.std(per_group, ddof=1) / np.sqrt(len(together))),
        unfinished=unfinished,
    )


def root_mean_square(parts: Sequence[Float[np.ndarray, " _"]]) -> tuple[float, float]:
    """Of several blocks together, and its standard error from their scatter."""
    mean = float(np.mean(np.concatenate(parts) ** 2))
    of_parts, sizes = np.array([np.mean(part**2) for part in parts]), np.array([len(part) for part in parts])
    # Of a ratio: each block counts by the number of its data.
    apart = sizes * (of_parts - mean) / np.mean(sizes)
    scatter = np.sqrt(np.sum(apart**2) / (len(parts) * (len(parts) - 1)))
    return float(np.sqrt(mean)), float(scatter / (2.0 * np.sqrt(mean))) if mean > 0.0 else 0.0
