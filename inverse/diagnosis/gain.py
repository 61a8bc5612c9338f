"""What an extension is worth on data that the fit did not see.

With samples enough, each is left out in turn, and with temperatures enough each of these: the strength comes from the
others, the constants of the sweeps left out, which no other tells, from four of five blocks of their frequencies, and
the fifth is scored. Otherwise blocks of frequencies are left out of all sweeps in turn.

A gain proves no cause: measured on data with a hidden effect, a wrong cause gained in 62 to 81 % of cases.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from inverse.datasets.dma import frequency_groups
from inverse.datasets.dma_checks import SWEEP_GAP
from inverse.diagnosis.cause import DmaCause, Extension
from inverse.diagnosis.dma_problem import LEAST_SPARE, DmaProblem
from inverse.diagnosis.extended_fit import Refit
from inverse.diagnosis.noise import Noise

BLOCKS = 5
LEAST_FOLDS = 2
LEAST_GROUPS = 4
"""Samples, or temperatures, from which on these are left out."""

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


@dataclasses.dataclass(frozen=True)
class _Fold:
    """Rows that are scored, those that their sweeps' constants are fitted to, and those that tell the strength."""

    scored: Bool[np.ndarray, " row"]
    constants: Bool[np.ndarray, " row"]
    strength: Bool[np.ndarray, " row"]
    group: float


def held_out_gain(
    problem: DmaProblem,
    extensions: Sequence[Extension],
    noise: Noise,
    start: Float[np.ndarray, " extension"],
    *,
    library: Sequence[DmaCause] = (),
) -> Gain | None:
    """Score the model with and without extensions on data that were left out.

    Args:
        problem: Data and null fit.
        extensions: What was added.
        noise: Weighs the residuals; the size of the noise is taken from the rows that were fitted.
        start: First guess of the strengths.
        library: Causes that other refits add.

    Returns:
        The gain, or None where fewer than `LEAST_FOLDS` blocks could be left out, or all of one group, which has no
        scatter to tell an error from.
    """
    null, extended = Refit(problem, (), noise, library=library), Refit(problem, extensions, noise, library=library)
    folds, split = _folds(problem, len(extensions))
    # Blocks of what was left out share its strength: they count as one when errors are told from scatter.
    groups = np.unique([fold.group for fold in folds])
    if len(folds) < LEAST_FOLDS or len(groups) < 2:
        return None
    before, after, unfinished = _scored(null, extended, noise, start, folds)
    return summed_up(split, before, after, [fold.group for fold in folds], unfinished)


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


def _folds(problem: DmaProblem, extensions: int) -> tuple[list[_Fold], str]:
    """What is left out, and that in words."""
    blocks = frequency_blocks(np.asarray(problem.conditions.angular_frequency))
    used = [block for block in np.unique(blocks).tolist() if _enough(problem, blocks != block, extensions)]
    skipped = len(np.unique(blocks)) - len(used)
    left_out = f" ({skipped} more would have left too few rows to fit)" if skipped else ""
    kinds = {"samples": sample_groups(problem), "temperatures": temperature_groups(problem)}
    enough = [kind for kind, rows in kinds.items() if len(np.unique(rows)) >= LEAST_GROUPS]
    if not enough:
        folds = [_Fold(blocks == one, blocks != one, blocks != one, float(one)) for one in used]
        return folds, f"{len(used)} blocks of neighbouring frequencies, each left out of all sweeps in turn{left_out}"
    kind = enough[0]
    places, rank = np.unique(kinds[kind], return_inverse=True)
    group = _blocks(rank, len(places))
    folds = [
        _Fold((group == place) & (blocks == one), blocks != one, group != place, float(place))
        for one in used
        for place in np.unique(group).tolist()
    ]
    of_neighbours = " of neighbours" if kind == "temperatures" else ""
    several = "" if len(places) <= BLOCKS else f" in {BLOCKS} blocks{of_neighbours}"
    split = (
        f"{len(places)} {kind}{several}, each left out in turn: strengths from the others, constants of its own "
        f"from all but one of {len(np.unique(blocks))} blocks of neighbouring frequencies, which is predicted{left_out}"
    )
    return [fold for fold in folds if np.any(fold.scored)], split


def sample_groups(problem: DmaProblem) -> Int[np.ndarray, " row"]:
    """Number of each row's sample, in the order of the file."""
    labels = [sweep.sample for sweep in problem.sweeps]
    return np.array([list(dict.fromkeys(labels)).index(one) for one in labels])[np.asarray(problem.conditions.sweep)]


def temperature_groups(problem: DmaProblem) -> Float[np.ndarray, " row"]:
    """Temperature of each row's sweep, rounded so that samples at about the same one share it [degC]."""
    of_sweeps = np.array([sweep.temperature_c for sweep in problem.sweeps])
    ordered = np.sort(of_sweeps)
    begins = ordered[np.concatenate([[True], np.diff(ordered) > SWEEP_GAP])]
    group = begins[np.searchsorted(begins, of_sweeps, side="right") - 1]
    return group[np.asarray(problem.conditions.sweep)]


def _enough(problem: DmaProblem, kept: Bool[np.ndarray, " row"], extensions: int) -> bool:
    """Whether every sweep keeps more frequencies than it has constants, and all together data to spare."""
    sweep, omega = np.asarray(problem.conditions.sweep), np.asarray(problem.conditions.angular_frequency)
    constants = problem.moved.shape[1]
    distinct = [len(np.unique(frequency_groups(omega[kept & (sweep == one)]))) for one in np.unique(sweep)]
    spare = int(np.sum(kept)) * problem.weights.shape[1] - problem.moved.size - 2 * extensions
    return min(distinct) > constants and spare >= LEAST_SPARE


def frequency_blocks(angular_frequency: Float[np.ndarray, " row"]) -> Int[np.ndarray, " row"]:
    """Block of each row: neighbours in frequency, about equally many distinct ones in each."""
    rank = frequency_groups(angular_frequency)
    return _blocks(rank, 1 + int(rank.max()))


def _blocks(rank: Int[np.ndarray, " row"], count: int) -> Int[np.ndarray, " row"]:
    """Neighbours together, about equally many of `count` in each."""
    return rank * min(BLOCKS, count) // count


def _scored(
    null: Refit, extended: Refit, noise: Noise, start: Float[np.ndarray, " extension"], folds: Sequence[_Fold]
) -> tuple[list[Scored], list[Scored], int]:
    """For each fold the score before and after; and how many refits did not converge, of which folds may share some."""
    before, after, lost = [], [], 0
    without, strengths = {}, {}
    for fold in folds:
        # From constants that the fold finds by itself: those of the fit to everything have seen the rows left out.
        if (key := fold.constants.tobytes()) not in without:
            own = null.own_constants(fold.constants)
            plain, well, _ = null.solve(np.zeros(0), fold.constants, constants=own)
            without[key] = own, plain
            lost += not well
        own, plain = without[key]
        if np.array_equal(fold.strength, fold.constants):
            added, well, _ = extended.solve(start, fold.constants, constants=own)
        else:
            if (key := fold.strength.tobytes()) not in strengths:
                strengths[key], well, _ = extended.solve(start, fold.strength)
                lost += not well
            added, well, _ = extended.solve_constants(strengths[key], fold.constants & ~fold.strength, constants=own)
        lost += not well
        before.append(_score(null, noise, plain, fold))
        after.append(_score(extended, noise, added, fold))
    return before, after, int(lost)


def _score(refit: Refit, noise: Noise, unknowns: Float[np.ndarray, " unknown"], fold: _Fold) -> Scored:
    weights = refit.problem.weights
    plain = refit.plain(unknowns)
    # The size of the noise from rows that were fitted both before and after.
    fitted = np.repeat(fold.constants, weights.shape[1])
    scored = np.repeat(fold.scored, weights.shape[1])
    freedom = max(int(fitted.sum()) - refit.moves, 1)
    size = np.sqrt(np.sum((plain * np.exp(-noise.log_deviation))[fitted] ** 2) / freedom)
    deviation = size * np.exp(noise.log_deviation[scored])
    density = -0.5 * (plain[scored] / deviation) ** 2 - np.log(deviation) - 0.5 * np.log(2.0 * np.pi)
    return plain[scored] / weights.ravel()[scored], float(np.sum(density))


def root_mean_square(parts: Sequence[Float[np.ndarray, " _"]]) -> tuple[float, float]:
    """Of several blocks together, and its standard error from their scatter."""
    mean = float(np.mean(np.concatenate(parts) ** 2))
    of_parts, sizes = np.array([np.mean(part**2) for part in parts]), np.array([len(part) for part in parts])
    # Of a ratio: each block counts by the number of its data.
    apart = sizes * (of_parts - mean) / np.mean(sizes)
    scatter = np.sqrt(np.sum(apart**2) / (len(parts) * (len(parts) - 1)))
    return float(np.sqrt(mean)), float(scatter / (2.0 * np.sqrt(mean))) if mean > 0.0 else 0.0
