"""What an extension is worth on readings of a dynamic mechanical analysis that the fit did not see.

With samples enough, each is left out in turn, and with temperatures enough each of these: the strength comes from the
others, the constants of the sweeps left out, which no other tells, from four of five blocks of their frequencies, and
the fifth is scored. Otherwise blocks of frequencies are left out of all sweeps in turn.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from inverse.datasets.dma import frequency_groups
from inverse.datasets.dma_checks import SWEEP_GAP
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.dma.cause import DmaCause
from inverse.diagnosis.dma.extended_fit import Refit
from inverse.diagnosis.dma.problem import LEAST_SPARE, DmaProblem
from inverse.diagnosis.gain import LEAST_FOLDS, Gain, Scored, summed_up
from inverse.diagnosis.noise import Noise

BLOCKS = 5
LEAST_GROUPS = 4
"""Samples, or temperatures, from which on these are left out."""


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
