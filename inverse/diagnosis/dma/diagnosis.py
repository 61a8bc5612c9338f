"""The diagnosis of a dynamic mechanical analysis, from the data to a verdict."""

from collections.abc import Callable, Sequence

import numpy as np

from inverse.datasets.dma import DmaData, frequency_groups
from inverse.diagnosis.cause import require_causes
from inverse.diagnosis.diagnosis import Diagnosis, conclude, failed
from inverse.diagnosis.dma.account import DmaAccount
from inverse.diagnosis.dma.cause import DmaCause
from inverse.diagnosis.dma.causes import DMA_CAUSES
from inverse.diagnosis.dma.examination import examine_dma
from inverse.diagnosis.dma.gain import held_out_gain
from inverse.diagnosis.dma.problem import DmaProblem, dma_problem
from inverse.diagnosis.dma.weighing import Weighing
from inverse.diagnosis.examination import FullFit
from inverse.diagnosis.gain import Gain
from inverse.diagnosis.level import require_level
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.noise_gate import Coordinates, Repeats
from inverse.diagnosis.outlying import outlying, said_of
from inverse.diagnosis.where import Axis
from inverse.dma_fit import FRACTIONAL, ZenerModel


def diagnose_dma(
    data: DmaData,
    *,
    model: ZenerModel = FRACTIONAL,
    causes: Sequence[DmaCause] = DMA_CAUSES,
    level: float = 0.05,
    seed: int = 0,
    replicates: int | None = None,
    gain: bool = True,
    asked: Sequence[str] = (),
    on_step: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Say what is wrong with the model of a dynamic mechanical analysis, and what mending it is worth.

    Args:
        data: From `read_dma`, in the order of the file.
        model: The null model, fitted to every sweep by itself.
        causes: The library to look in.
        level: Probability of finding something wrong where nothing is.
        seed: Of starts and replicates.
        replicates: Data sets of noise alone that error rates are calibrated on: if not said 400, more at lower levels.
        gain: Whether to measure the held-out gain.
        asked: Names of causes that the data have to see: if they do not, that is said before the longest part.
        on_step: Told what is being done.

    Raises:
        InputError: if there are too few data, no causes, one that was asked for cannot be seen, or `level` or
            `replicates` is out of range.
        ValueError: if JAX runs in single precision.
    """
    replicates = require_level(level, replicates)
    require_causes(causes)
    on_step("fitting")
    problem = dma_problem(data, model, seed=seed)
    audit = _audit(problem)
    if not all(fit.converged for fit in problem.fits):
        return failed(
            DmaAccount(problem, problem.constants), problem, problem.residuals(), audit, level=level, seed=seed
        )
    on_step("testing all causes")
    rng = np.random.default_rng(seed)
    examined = examine_dma(problem, causes, rng, level=level, replicates=replicates, asked=asked)

    problem = examined.problem

    def worth(extended: FullFit, noise: Noise) -> Gain | None:
        return held_out_gain(problem, extended.extensions, noise, extended.strengths, library=causes)

    return conclude(
        examined,
        DmaAccount(problem, examined.constants),
        problem,
        rng,
        audit=(*audit, *examined.remarks),
        axes=_axes(problem),
        repeats=repeats_of(problem),
        coordinates=_coordinates(problem, examined.weighing),
        gain=worth if gain else None,
        level=level,
        seed=seed,
        replicates=replicates,
        on_step=on_step,
    )


def _audit(problem: DmaProblem) -> tuple[str, ...]:
    """What each fit says about itself."""
    remarks = []
    for fit in problem.fits:
        if not fit.converged:
            remarks.append(f"{fit.sweep.label}: {fit.status}.")
        elif fit.n_agreeing < 2:
            remarks.append(f"{fit.sweep.label}: only one of {fit.n_starts} starts reached the best fit.")
        remarks += [f"{fit.sweep.label}: {warning}" for warning in fit.warnings if fit.converged]
    return (*remarks, *_slips(problem))


def _slips(problem: DmaProblem) -> tuple[str, ...]:
    """Readings that hold the misfit."""
    of_rows = np.repeat(np.arange(problem.rows), problem.weights.shape[1])
    found, share = outlying(problem.residuals(), problem.fitted_directions(), of_rows)
    frequency, sweep = problem.frequencies()[:: problem.weights.shape[1]], np.asarray(problem.conditions.sweep)
    places = []
    for one in found:
        off = one.amount / problem.weights[one.reading]
        phase = f" and a phase {1e3 * off[1]:+.3g} mrad" if problem.has_phase else ""
        label = f"{frequency[one.reading]:.3g} Hz at {problem.sweeps[sweep[one.reading]].label}"
        places.append(f"{label}, of a magnitude {100.0 * np.expm1(off[0]):+.3g} %{phase} off what the others say")
    return said_of(places, share)


def _axes(problem: DmaProblem) -> tuple[Axis, ...]:
    """Frequency, temperature and time; magnitude and phase are series of their own."""
    coordinates = problem.weights.shape[1]
    frequency = np.asarray(problem.conditions.angular_frequency)
    sweep = np.asarray(problem.conditions.sweep)
    samples = [problem.sweeps[index].sample for index in sweep]
    same = frequency_groups(frequency)
    _, sample = np.unique(samples, return_inverse=True)
    same = same + (1 + same.max()) * sample

    def axis(along: str, keys, position) -> Axis:
        both = np.repeat(keys, coordinates) * coordinates + np.tile(np.arange(coordinates), problem.rows)
        return Axis(along, both, np.repeat(np.asarray(position, dtype=float), coordinates))

    return (
        axis("frequency", sweep, frequency),
        axis("temperature", same, problem.conditions.temperature),
        axis("time", sweep, problem.conditions.time),
    )


def _coordinates(problem: DmaProblem, weighing: Weighing) -> Coordinates:
    """The logarithm of the magnitude and the phase, which are of one size where the noise of the modulus is round."""
    names = ("the magnitude", "the phase [rad]")[: problem.weights.shape[1]]
    return Coordinates(
        names, np.tile(np.arange(len(names)), problem.rows), weighing.differs, weighing.factors, weighing.p_alike
    )


def repeats_of(problem: DmaProblem) -> Repeats:
    """Pooled scatter of rows that share sweep and frequency."""
    same = frequency_groups(np.asarray(problem.conditions.angular_frequency))
    sweep = np.asarray(problem.conditions.sweep)
    total, freedom = 0.0, 0
    measured, weights = problem.measured, problem.weights
    for key in set(zip(sweep.tolist(), same.tolist(), strict=True)):
        rows = (sweep == key[0]) & (same == key[1])
        if np.sum(rows) > 1:
            middle = np.average(measured[rows], axis=0, weights=weights[rows] ** 2)
            total += float(np.sum((weights[rows] * (measured[rows] - middle)) ** 2))
            freedom += (int(np.sum(rows)) - 1) * measured.shape[1]
    return Repeats(float(np.sqrt(total / freedom)), freedom) if freedom else Repeats(np.nan, 0)
