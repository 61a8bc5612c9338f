"""The simulation with causes in it, fitted in full: constants, strengths, shapes and a factor of each sonication."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.fitting import Fitting, HmiFit, moved_by
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.noise import Noise

_MOST_CORRECTIONS = 5
SETTLED = 0.5
"""What the full simulation may have more than the corrected one where a fit came out, in standard deviations of the
noise all together (d'), for the fit to count as one of the full simulation."""
_NO_SUCH_TISSUE = "the full simulation has no such tissue: not corrected to it"


def fit_in_full(
    problem: HmiDiagnosisProblem,
    extensions: Sequence[Extension[HmiCause]],
    noise: Noise,
    *,
    size: float,
    start: Float[np.ndarray, " unknown"],
    strengths: Float[np.ndarray, " extension"] | None = None,
) -> HmiFit:
    """`fit_hmi` by the full simulation: corrected to it where the fit comes out, as often as the fit moves from there.

    Where a lesion begins the fast simulation is a percent off, and what moves its beginning is off by more. A fit that
    leaves what the fast one covers counts if the full one agrees with it at last; of one that does not leave it, `left`
    says how far they are apart.

    Args:
        problem: Data and simulation.
        extensions: As for `fit_hmi`.
        noise: As for `fit_hmi`.
        size: As for `fit_hmi`.
        start: Unknowns to start from.
        strengths: First guess of the strengths, in their units.
    """
    found = fit_hmi(problem, extensions, noise, size=size, start=start, strengths=strengths, anywhere=True)
    for _ in range(_MOST_CORRECTIONS):
        near = problem.corrected_at(found.unknowns, moved_by(problem, found.extensions))
        if near.correction is None or not near.correction.is_finite:
            return dataclasses.replace(found, converged=False, status=_NO_SUCH_TISSUE)
        found = fit_hmi(
            near, found.extensions, noise, size=size, start=found.unknowns, strengths=found.strengths, anywhere=True
        )  # fmt: skip
        found = _compared(found, size)
        if found.left <= SETTLED:
            return found
    if math.isnan(found.left):
        return dataclasses.replace(found, converged=False, status=_NO_SUCH_TISSUE)
    return found if found.excess <= 1.0 else _not_confirmed(found)


def fit_hmi(
    problem: HmiDiagnosisProblem,
    extensions: Sequence[Extension[HmiCause]],
    noise: Noise,
    *,
    size: float,
    start: Float[np.ndarray, " unknown"] | None = None,
    strengths: Float[np.ndarray, " extension"] | None = None,
    used: Bool[np.ndarray, " row"] | None = None,
    held: Sequence[int] = (),
    anywhere: bool = False,
) -> HmiFit:
    """Fit all constants, strengths and shapes together, with the priors of the constants.

    Args:
        problem: Data and simulation.
        extensions: What to add, in the shapes to start from; none fits the model as it is.
        noise: Member of `HmiDiagnosisProblem.noise_family` that weighs the residuals.
        size: Of the noise, in units of the weights: what the priors count against.
        start: Unknowns to start from; the priors' middle without.
        strengths: First guess of the strengths, in their units.
        used: Rows to fit; all without.
        held: Extensions whose strengths stay as they are given.
        anywhere: Whether a fit outside of what the fast simulation covers counts before the full one is asked, by those
            who ask it themselves.
    """
    found = Fitting(problem, extensions, noise, size, used, held).run(start, strengths)
    if found.excess <= 1.0 or not found.converged:
        return found
    if problem.correction is None:
        return _not_confirmed(found)
    if anywhere:
        return found
    found = _compared(found, size)
    return found if found.left <= SETTLED else _not_confirmed(found)


def _compared(fit: HmiFit, size: float) -> HmiFit:
    """With how far the full simulation is from it."""
    return dataclasses.replace(fit, left=float(np.linalg.norm(fit.problem.left(fit.unknowns))) / size)


def _not_confirmed(fit: HmiFit) -> HmiFit:
    status = f"the fit leaves the range of the fast model (excess {fit.excess:.2f} of 1)"
    if not math.isnan(fit.left):
        status += f", and the full simulation is {fit.left:.1f} standard deviations of the noise away"
    return dataclasses.replace(fit, converged=False, status=status)


def again_from(fit: HmiFit, noise: Noise, size: float) -> HmiFit:
    """The same once more from where it came out: in other noise, or with noise of another size."""
    again = fit_hmi(fit.problem, fit.extensions, noise, size=size, start=fit.unknowns, strengths=fit.strengths)
    if math.isnan(again.left):
        again = dataclasses.replace(again, left=fit.left)
    return again if fit.converged else dataclasses.replace(again, converged=False, status=fit.status)
