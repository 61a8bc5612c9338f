"""Curves of displacement examined."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from inverse.diagnosis.cause import Extension
from inverse.diagnosis.decision import REPLICATES, Refitted, decide
from inverse.diagnosis.examination import Examined, extension_of, linear_strengths, visible_alternatives
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.free_forms import hmi_free_forms
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.refit import HmiFit, alternatives_at, fit_hmi
from inverse.diagnosis.noise import Noise, noise_family
from inverse.diagnosis.screening import Alternative, Screen


def examine_hmi(
    problem: HmiDiagnosisProblem,
    causes: Sequence[HmiCause],
    null: HmiFit,
    rng: np.random.Generator,
    *,
    size: float,
    corrected: bool = True,
    level: float = 0.05,
    replicates: int = REPLICATES,
) -> Examined:
    """Test every cause and every free form on fitted curves.

    Args:
        problem: Data and simulation.
        causes: The library to look in; the problem's program holds them all.
        null: The fit without causes, in white noise.
        rng: For replicates.
        size: Of the noise, in units of the weights: what the priors count against.
        corrected: Whether the fast simulation is corrected to the full one where each refit comes out.
        level: Probability of finding something wrong where nothing is.
        replicates: Data sets of noise alone that error rates are calibrated on.
    """
    family = noise_family(problem.orderings(), problem.coordinate())
    null = _in_its_noise(problem, null, family, size)
    residuals, fitted = null.residuals, null.directions
    freedom = max(len(residuals) - fitted.shape[1], 1)
    spread = float(np.sqrt(np.sum(residuals**2) / freedom))
    names = {cause.name for cause in causes}
    found = [one for one in alternatives_at(problem, null.unknowns) if one.name in names]
    seen, not_testable = visible_alternatives(found, fitted, spread, causes)
    forms, places = hmi_free_forms(problem.rows, problem.rows.log_displacement - residuals / problem.weights)
    forms = [dataclasses.replace(one, directions=problem.weights[:, None] * one.directions) for one in forms]

    refits = Refits(problem, null, {one.name: one.directions for one in found if one.shape is None}, size, corrected)

    def extend(added: Sequence[Alternative], noise: Noise) -> Refitted:
        extensions = [extension_of(causes, one) for one in added]
        refit = refits(extensions, noise, linear_strengths(added, residuals, fitted), False)
        inside = {one.name for one in added}
        # The other causes as they are without this one: to follow it they would take longer than all fits together.
        others = [one for one in found if one.name not in inside]
        return Refitted(refit.residuals, refit.directions, refit.misfit, others)

    decision = decide(residuals, fitted, seen, forms, family, rng, extend=extend, level=level, replicates=replicates)
    return Examined(
        tuple(causes), residuals, fitted, spread, tuple(seen), not_testable, tuple(places), family, decision, refits
    )


class Refits:
    """Fits of the simulation with causes in it, each done once.

    Where a lesion begins the fast simulation is a percent off, and a cause that moves its beginning takes the data
    along the wrong curve. So the first fit of some causes is done twice: the second time, and in other noise, by the
    fast simulation as it is right where the first came out.
    """

    def __init__(
        self,
        problem: HmiDiagnosisProblem,
        null: HmiFit,
        known: Mapping[str, Float[np.ndarray, "row 1"]],
        size: float,
        corrected: bool,
    ) -> None:
        """Begin.

        Args:
            problem: Data and simulation.
            null: The fit without causes.
            known: Derivative in the strength of each cause without shapes, at that fit.
            size: Of the noise, in units of the weights.
            corrected: Whether to correct the fast simulation.
        """
        self._problem, self._null, self._known = problem, null, known
        self._size, self._corrected = size, corrected
        self._done: dict[tuple, HmiFit] = {}
        self._near: dict[frozenset[str], HmiDiagnosisProblem] = {}

    def __call__(
        self, extensions: Sequence[Extension], noise: Noise, start: Float[np.ndarray, " extension"], profile: bool
    ) -> HmiFit:
        """Constants and extensions together; intervals come from the curvature in any case."""
        del profile
        key = (*((e.cause.name, float(e.shape)) for e in extensions), id(noise))
        if key not in self._done:
            self._done[key] = self._fit(extensions, noise, start)
        return self._done[key]

    def _fit(self, extensions, noise, start) -> HmiFit:
        names = frozenset(extension.cause.name for extension in extensions)
        near = self._near.get(names, self._problem)
        slopes = self._slopes(extensions)
        found = fit_hmi(
            near, extensions, noise, size=self._size, start=self._null.unknowns, strengths=start, slopes=slopes
        )
        if not self._corrected or names in self._near or not found.converged:
            return found
        near = self._near[names] = self._problem.corrected_at(found.unknowns)
        return fit_hmi(near, found.extensions, noise, size=self._size, start=found.unknowns, strengths=found.strengths)

    def _slopes(self, extensions) -> Float[np.ndarray, "row moved"] | None:
        """At the fit without causes, whose first columns are the constants'."""
        if any(extension.has_shape for extension in extensions):
            return None
        # The program counts strengths in plausible ones.
        own = [self._known[extension.cause.name] * extension.cause.plausible for extension in extensions]
        return np.concatenate([*own, self._null.slopes], axis=1)


def _in_its_noise(problem: HmiDiagnosisProblem, null: HmiFit, family: Sequence[Noise], size: float) -> HmiFit:
    """The model fitted in the likeliest kind of noise, see `examine_dma`."""
    _, member, _ = Screen(null.directions, (), family).noise_evidence(null.residuals[:, None])
    noise = family[member[0]]
    return null if noise.is_white else fit_hmi(problem, (), noise, size=size, start=null.unknowns, slopes=null.slopes)


def noise_size(fit: HmiFit) -> float:
    """Standard deviation of a fit's residuals, in units of the weights."""
    freedom = max(len(fit.residuals) - fit.directions.shape[1], 1)
    residuals: Float[np.ndarray, " row"] = fit.residuals
    return float(np.sqrt(np.sum(residuals**2) / freedom))
