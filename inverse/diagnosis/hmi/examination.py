"""Curves of displacement examined."""

import dataclasses
from collections.abc import Sequence

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

    known = {one.name: one.directions for one in found if one.shape is None}
    done: dict[tuple, HmiFit] = {}

    def fit(extensions: Sequence[Extension], noise: Noise, start, profile: bool) -> HmiFit:
        del profile
        key = (*((e.cause.name, float(e.shape)) for e in extensions), id(noise))
        if key not in done:
            # The constants' slopes are the first columns of those of the null fit.
            own = [known[e.cause.name] for e in extensions if not e.has_shape]
            constants = fitted[:, : len(problem.program.start)]
            slopes = np.concatenate([*own, constants], axis=1) if len(own) == len(extensions) else None
            done[key] = fit_hmi(
                problem, extensions, noise, size=size, start=null.unknowns, strengths=start, slopes=slopes
            )
        return done[key]

    def extend(added: Sequence[Alternative], noise: Noise) -> Refitted:
        extensions = [extension_of(causes, one) for one in added]
        refit = fit(extensions, noise, linear_strengths(added, residuals, fitted), False)
        inside = {one.name for one in added}
        # The other causes as they are without this one: to follow it they would take longer than all fits together.
        others = [one for one in found if one.name not in inside]
        return Refitted(refit.residuals, refit.directions, refit.misfit, others)

    decision = decide(residuals, fitted, seen, forms, family, rng, extend=extend, level=level, replicates=replicates)
    return Examined(
        tuple(causes), residuals, fitted, spread, tuple(seen), not_testable, tuple(places), family, decision, fit
    )


def _in_its_noise(problem: HmiDiagnosisProblem, null: HmiFit, family: Sequence[Noise], size: float) -> HmiFit:
    """The model fitted in the likeliest kind of noise, see `examine_dma`."""
    _, member, _ = Screen(null.directions, (), family).noise_evidence(null.residuals[:, None])
    noise = family[member[0]]
    return null if noise.is_white else fit_hmi(problem, (), noise, size=size, start=null.unknowns)


def noise_size(fit: HmiFit) -> float:
    """Standard deviation of a fit's residuals, in units of the weights."""
    freedom = max(len(fit.residuals) - fit.directions.shape[1], 1)
    residuals: Float[np.ndarray, " row"] = fit.residuals
    return float(np.sqrt(np.sum(residuals**2) / freedom))
