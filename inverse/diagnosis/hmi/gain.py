"""What an extension is worth on sonications that the fit did not see.

Each sonication is left out in turn: constants and strengths come from the others, its own factor from its own readings.
With one sonication, blocks of neighbouring temperatures are left out instead. A gain proves no cause.
"""

import numpy as np
from jaxtyping import Bool

from inverse.diagnosis.gain import LEAST_FOLDS, Gain, Scored, summed_up
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.refit import fit_hmi
from inverse.diagnosis.noise import Noise

_BLOCKS = 5
_LEAST_READINGS = 2
"""Of a sonication for its factor to leave something to score; one that has no more is never left out."""


def held_out_gain_hmi(noise: Noise, *, size: float, null: HmiFit, extended: HmiFit) -> Gain | None:
    """Score the model with and without extensions on data that were left out.

    Args:
        noise: Weighs the residuals.
        size: Of the noise, for the priors.
        null: The fit without extensions to all data: the first guess, the data, and the simulation as corrected there.
        extended: The fit with them, likewise.

    Returns:
        The gain, or None where fewer than two parts could be left out.
    """
    folds, split = _folds(null.problem)
    if len(folds) < LEAST_FOLDS:
        return None
    before, after, lost = [], [], 0
    for left_out in folds:
        for found, whole in ((before, null), (after, extended)):
            fit = fit_hmi(
                whole.problem, whole.extensions, noise,
                size=size, start=whole.unknowns, strengths=whole.strengths, used=~left_out,
            )  # fmt: skip
            lost += not fit.converged
            found.append(_score(fit, noise, left_out))
    return summed_up(split, before, after, range(len(folds)), int(lost))


def _folds(problem: HmiDiagnosisProblem) -> tuple[list[Bool[np.ndarray, " row"]], str]:
    rows = problem.rows
    if len(rows.labels) > 1:
        parts = [rows.sonication == one for one in range(len(rows.labels))]
        told = [part for part in parts if np.sum(part) > _LEAST_READINGS]
        few = len(parts) - len(told)
        kept = f" ({few} more with {_LEAST_READINGS} readings or fewer never)" if few else ""
        return told, f"each of {len(told)} sonications left out in turn{kept}, its own factor from its own readings"
    rank = np.argsort(np.argsort(rows.temperature, kind="stable"), kind="stable")
    block = rank * _BLOCKS // len(rank)
    parts = [block == one for one in np.unique(block)]
    return parts, f"{len(parts)} blocks of neighbouring temperatures, each left out in turn, the factor from the others"


def _score(fit: HmiFit, noise: Noise, left_out: Bool[np.ndarray, " row"]) -> Scored:
    """Relative residuals of what was left out, and the log density of their scatter.

    A sonication that was left out as a whole has a factor of its own, which its readings have to tell; a part of one
    has that of the readings in use.
    """
    problem = fit.problem
    raw, scale = problem.residuals(fit.unknowns), np.exp(noise.log_deviation[: len(problem.rows)])
    used = ~left_out
    spread = np.sqrt(np.sum((fit.of_readings / scale)[used] ** 2) / fit.freedom)
    deviation = spread * scale[left_out]
    sonication = problem.rows.sonication
    whole = not np.any(np.isin(sonication[left_out], sonication[used]))
    telling, weights = left_out if whole else used, problem.weights / scale
    # The factor by least squares; the density of what is free beside it.
    factor = np.sum((weights * raw / scale)[telling]) / np.sum(weights[telling] ** 2)
    rest = raw[left_out] - factor * problem.weights[left_out]
    readings = int(np.sum(left_out))
    count = readings - whole
    density = -0.5 * np.sum((rest / deviation) ** 2) - np.sum(np.log(deviation)) * count / readings
    return rest / problem.weights[left_out], float(density - 0.5 * count * np.log(2.0 * np.pi))
