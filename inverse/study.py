"""An inference from beginning to end: fit, audit, profiles, posterior, in the order in which they may be believed."""

import dataclasses
import enum
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from arfjax.errors import InputError
from inverse.inference.audit import Audit, audit
from inverse.inference.compiled import as_arrays
from inverse.inference.fit import Fit, fit
from inverse.inference.problem import Problem
from inverse.inference.profile import Profile, profiles
from inverse.sampling import (
    Diagnostics,
    Draws,
    Evidence,
    Laplace,
    bridge_evidence,
    default_walkers,
    diagnose_draws,
    importance_evidence,
    laplace,
    sample_ensemble,
    sample_importance,
    sample_nuts,
    walkers_from_laplace,
)
from inverse.sampling.target import batched_log_density, require_resumable


class Sampler(enum.StrEnum):
    """How a posterior is explored."""

    NUTS = "nuts"
    EMCEE = "emcee"
    IMPORTANCE = "importance"
    LAPLACE = "laplace"
    NONE = "none"


@dataclasses.dataclass(frozen=True)
class Study:
    """What an inference found.

    Attributes:
        problem: What was inferred.
        fit: Most probable constants.
        audit: Of the fit.
        profiles: Of every parameter; none where they were not asked for, or parameters vary from group to group.
        laplace: Normal approximation of the posterior, or None.
        draws: Of the posterior, or None.
        diagnostics: Of the draws, or None.
        evidence: Of the model, or None.
    """

    problem: Problem
    fit: Fit
    audit: Audit
    profiles: tuple[Profile, ...]
    laplace: Laplace | None = None
    draws: Draws | None = None
    diagnostics: Diagnostics | None = None
    evidence: Evidence | None = None

    @property
    def estimates(self) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """Values and standard errors of the fit."""
        return self.fit.values, self.fit.uncertainty.standard_errors

    @property
    def warnings(self) -> tuple[str, ...]:
        """Everything that a reader of the numbers has to know."""
        found = [finding.sentence for finding in self.audit.findings]
        found += [sentence for one in self.profiles for sentence in one.warnings]
        found += (
            [] if self.laplace is None or self.laplace.is_sound else [f"Normal approximation: {self.laplace.message}."]
        )
        found += [] if self.evidence is None else [f"Evidence: {warning}" for warning in self.evidence.warnings]
        return (*found, *(() if self.diagnostics is None else self.diagnostics.complaints))


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much to put in.

    Attributes:
        starts: Of the fit.
        most_starts: That may be asked for, or None where there is no limit; a fit at it is not advised to have more.
        draws: Of NUTS, of each of `chains` chains; of the normal approximation, all of them.
        chains: Of NUTS.
        warmup: Steps of NUTS that are not kept.
        target_acceptance: Of NUTS; higher ones take shorter steps, against divergences.
        most_steps: Of the ensemble, if its rule for stopping is not met before.
        evaluations: Of the density by importance sampling.
        most_evaluations: Of it, while its draws are worth fewer than 400 independent ones.
        with_profiles: Whether to take profiles of the fit.
        level: Of intervals of profiles.
        chunk: Points whose density is computed at once; None for as many as there are.
    """

    starts: int = 16
    most_starts: int | None = None
    draws: int = 1000
    chains: int = 4
    warmup: int = 500
    target_acceptance: float = 0.8
    most_steps: int = 20_000
    evaluations: int = 4000
    most_evaluations: int = 20_000
    with_profiles: bool = True
    level: float = 0.95
    chunk: int | None = None


def infer(
    problem: Problem,
    *,
    sampler: Sampler = Sampler.NUTS,
    seed: int = 0,
    effort: Effort = Effort(),
    evidence: bool = False,
    file: Path | None = None,
    on_step: Callable[[str], None] = lambda what: None,
) -> Study:
    """Fit, look at the fit, and sample.

    Args:
        problem: With a prior for every parameter if it is to be sampled.
        sampler: NUTS (gradients), emcee's ensemble, importance sampling (few evaluations), the normal
            approximation alone, or none.
        seed: Of starts and samplers.
        effort: How much to put in.
        evidence: Whether to estimate the evidence by bridge sampling.
        file: Of a sampler's run, which goes on if there is one.
        on_step: Told in words how far it is.

    Raises:
        InputError: if a posterior is asked for and a parameter has no prior, or the file is of another run.
    """
    if sampler is not Sampler.NONE and not problem.parameters.has_priors:
        bare = [entry.name for entry in problem.parameters.entries if entry.parameter.prior is None]
        raise InputError(f"`{bare[0]}` has no prior, so that there is no posterior: give one, or sample nothing.")
    problem = as_arrays(problem)
    if file is not None and file.exists():
        asked: dict[str, str | int | float] = {"sampler": sampler.value, "seed": seed}
        asked |= {"target_acceptance": effort.target_acceptance} if sampler is Sampler.NUTS else {}
        require_resumable(file, problem, asked)
    study = _fitted(problem, seed, effort, on_step)
    if sampler is Sampler.NONE:
        return study
    normal = laplace(problem, seed=seed, n_starts=min(effort.starts, 8), on_step=on_step)
    study = dataclasses.replace(study, laplace=normal)
    drawn = _sample(problem, normal, sampler, seed, effort, file, on_step)
    on_step("diagnostics")
    table = diagnose_draws(problem, drawn)
    weighed = None
    if evidence:
        on_step("evidence")
        weighed = _weighed(problem, drawn, sampler, seed, effort)
    return dataclasses.replace(study, draws=drawn, diagnostics=table, evidence=weighed)


def _fitted(problem: Problem, seed: int, effort: Effort, on_step: Callable[[str], None]) -> Study:
    on_step("fit")
    found = fit(problem, n_starts=effort.starts, seed=seed)
    on_step("audit of the fit")
    more = effort.most_starts is None or effort.starts < effort.most_starts
    looked_at = audit(found, may_have_more_starts=more)
    sides: tuple[Profile, ...] = ()
    if effort.with_profiles and problem.parameters.is_plain:
        sides = profiles(found, level=effort.level, on_step=on_step)
    return Study(problem, found, looked_at, sides)


def _sample(
    problem: Problem,
    normal: Laplace,
    sampler: Sampler,
    seed: int,
    effort: Effort,
    file: Path | None,
    on_step: Callable[[str], None],
) -> Draws:
    if sampler is Sampler.NUTS:
        return sample_nuts(
            problem, normal, seed=seed, chains=effort.chains, warmup=effort.warmup, draws=effort.draws,
            target_acceptance=effort.target_acceptance, file=file, on_step=on_step,
        )  # fmt: skip
    if sampler is Sampler.EMCEE:
        start = walkers_from_laplace(problem, normal, seed=seed, count=default_walkers(problem), chunk=effort.chunk)
        return sample_ensemble(
            problem, start, seed=seed, most_steps=effort.most_steps, file=file, chunk=effort.chunk, on_step=on_step
        )
    if sampler is Sampler.IMPORTANCE:
        return sample_importance(
            problem, normal, seed=seed, chains=effort.chains, draws=effort.draws, evaluations=effort.evaluations,
            most_evaluations=effort.most_evaluations, chunk=effort.chunk, on_step=on_step,
        )  # fmt: skip
    return _normal_draws(problem, normal, seed, effort)


def _weighed(problem: Problem, drawn: Draws, sampler: Sampler, seed: int, effort: Effort) -> Evidence:
    if sampler is Sampler.LAPLACE:
        raise InputError("the evidence needs draws of the posterior, not of a normal density in its place.")
    if sampler is Sampler.IMPORTANCE:
        return importance_evidence(drawn)
    return bridge_evidence(problem, drawn, seed=seed, chunk=effort.chunk)


def _normal_draws(problem: Problem, normal: Laplace, seed: int, effort: Effort) -> Draws:
    """Independent draws of the normal approximation, in as many chains as NUTS would have."""
    points = normal.draw(jax.random.key(seed), effort.chains * effort.draws)
    shaped = points.reshape(effort.chains, effort.draws, -1)
    return Draws(
        unconstrained=shaped,
        log_density=batched_log_density(problem, chunk=effort.chunk)(points).reshape(effort.chains, effort.draws),
        statistics={},
        sampler="laplace",
        seed=seed,
        settings={},
        finished=False,
        message="a normal approximation about the mode: intervals are too narrow where the posterior is skew; "
        "sample with NUTS or the ensemble for numbers that are to be trusted",
        evaluations=0,
        seconds=0.0,
    )
