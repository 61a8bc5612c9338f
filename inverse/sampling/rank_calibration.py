r"""Simulation-based calibration: do posteriors mean what they say?

Constants are drawn from the prior, data from the model with these constants, and the posterior of the constants given
the data. Over many such replicates the rank of the true constant among the posterior's draws is uniform, and intervals
cover as often as they claim, if and only if priors, transforms, likelihood, gradients and sampler agree with one
another. An error in any of them shows; so does a sampler that has not mixed.

Source: S. Talts et al., Validating Bayesian inference algorithms with simulation-based calibration, arXiv:1804.06788
    (2018); the log likelihood as a further quantity from M. Modrák et al., Bayesian Analysis 20 (2025) 461.
"""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray
from scipy import stats

from arfjax.errors import InputError
from inverse.inference.compiled import as_arrays
from inverse.inference.problem import Problem
from inverse.sampling.importance import sample_importance
from inverse.sampling.laplace import laplace
from inverse.sampling.nuts import sample_nuts
from inverse.sampling.target import batched_log_density, batched_values, fingerprint

Posterior = Callable[[Problem, int], Float[np.ndarray, "draw n"]]
"""Given a problem and a seed: unconstrained draws of its posterior, so far apart as to be all but independent."""

N_DRAWS = 99
"""Draws of each posterior: ranks from 0 to 99, which ten classes divide evenly."""

LOG_LIKELIHOOD = "log likelihood"
_LEVELS = (0.5, 0.9)
_MOST_TRIES = 1000


@dataclasses.dataclass(frozen=True)
class RankCalibration:
    """Ranks of true constants among draws of their posteriors.

    Attributes:
        names: Of the constants, and of the log likelihood.
        ranks: Of each, from 0 to `N_DRAWS`.
        refused: Draws of the prior that gave no density and were drawn again.
        seed: Of the first replicate; each has its own.
    """

    names: tuple[str, ...]
    ranks: Int[np.ndarray, "replicate name"]
    refused: int
    seed: int

    @property
    def n_replicates(self) -> int:
        """How many data sets there were."""
        return len(self.ranks)

    def counts(self, n_classes: int = 10) -> Int[np.ndarray, "name class"]:
        """How many ranks lie in each of so many classes of equal width."""
        width = (N_DRAWS + 1) // n_classes
        return np.stack([np.bincount(column // width, minlength=n_classes) for column in self.ranks.T])

    def p_values(self, n_classes: int = 10) -> Float[np.ndarray, " name"]:
        """Of Pearson's chi-square test that ranks are uniform, for each constant."""
        return np.array([float(stats.chisquare(counts).pvalue) for counts in self.counts(n_classes)])

    def covered(self, level: float) -> Float[np.ndarray, " name"]:
        """Share of replicates whose central interval of a level holds the true constant."""
        tail = round((N_DRAWS + 1) * 0.5 * (1.0 - level))
        return np.mean((self.ranks >= tail) & (self.ranks < N_DRAWS + 1 - tail), axis=0)

    def coverage_p_values(self, level: float) -> Float[np.ndarray, " name"]:
        """Of the binomial test that the interval covers as often as it claims."""
        hits = np.round(self.covered(level) * self.n_replicates).astype(int)
        return np.array([float(stats.binomtest(int(hit), self.n_replicates, level).pvalue) for hit in hits])

    def as_dict(self) -> dict:
        """Numbers for a file."""
        return {
            "replicates": self.n_replicates,
            "draws of each posterior": N_DRAWS,
            "seed": self.seed,
            "drawn again": self.refused,
            "chi-square p": dict(zip(self.names, self.p_values().tolist(), strict=True)),
            **{
                f"covered by {100 * level:.0f} %": dict(zip(self.names, self.covered(level).tolist(), strict=True))
                for level in _LEVELS
            },
        }


def calibrate_ranks(
    problem: Problem,
    posterior: Posterior,
    *,
    n_replicates: int,
    seed: int,
    file: Path | None = None,
    made_by: str = "",
    on_step: Callable[[int, int], None] = lambda done, of: None,
) -> RankCalibration:
    """Ranks of constants drawn from the prior among draws of their posteriors.

    Args:
        problem: With a prior for every parameter; its data are replaced.
        posterior: Draws of a posterior, at least `N_DRAWS` of them.
        n_replicates: Data sets.
        seed: Replicate k takes `seed + k`.
        file: Lines of JSON, one a replicate; a run that was stopped goes on.
        made_by: What makes the posteriors: sampler, settings, code. Ranks that something else made are not added to.
        on_step: Told how many replicates are done, of how many.

    Raises:
        InputError: if hardly any draw of the prior gives a density, or the file is of another problem, seed or maker.
    """
    problem = as_arrays(problem)
    names = (*problem.parameters.names, LOG_LIKELIHOOD)
    rows = _resume(file, problem, seed, made_by)
    for number in range(len(rows), n_replicates):
        on_step(number, n_replicates)
        truth, replicate, refused = _simulate(problem, seed + number)
        draws = posterior(replicate, seed + number)
        if len(draws) < N_DRAWS:
            raise InputError(f"a posterior must have {N_DRAWS} draws or more, got {len(draws)}.")
        kept = draws[np.linspace(0, len(draws) - 1, N_DRAWS).astype(int)]
        points = np.concatenate([truth[None], kept])
        values = np.concatenate(
            [batched_values(replicate, points), _log_likelihood(replicate, points)[:, None]], axis=1
        )
        rows.append({"ranks": np.sum(values[1:] < values[0], axis=0).tolist(), "refused": refused})
        if file is not None:
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(rows[-1]) + "\n")
    on_step(n_replicates, n_replicates)
    kept_rows = rows[:n_replicates]
    ranks = np.array([row["ranks"] for row in kept_rows], dtype=int).reshape(len(kept_rows), len(names))
    return RankCalibration(names, ranks, sum(row["refused"] for row in kept_rows), seed)


def by_nuts(*, warmup: int = 300, draws: int = 400, chains: int = 2, n_starts: int = 2) -> Posterior:
    """Draws of posteriors by NUTS from a Laplace approximation, fewer of them than `infer` makes.

    Args:
        warmup: Steps that are not kept.
        draws: Of each chain.
        chains: Side by side.
        n_starts: Of the search for the mode.
    """

    def posterior(problem: Problem, seed: int) -> Float[np.ndarray, "draw n"]:
        found = laplace(problem, seed=seed, n_starts=n_starts)
        drawn = sample_nuts(problem, found, seed=seed, chains=chains, warmup=warmup, draws=draws, target_acceptance=0.9)
        return drawn.flat

    return posterior


def by_importance(*, evaluations: int = 3000, n_starts: int = 1, chunk: int = 50) -> Posterior:
    """Draws of posteriors by importance sampling from a Laplace approximation, for models that take long.

    Args:
        evaluations: Of the log density.
        n_starts: Of the search for the mode.
        chunk: Points whose density is computed at once.
    """

    def posterior(problem: Problem, seed: int) -> Float[np.ndarray, "draw n"]:
        found = laplace(problem, seed=seed, n_starts=n_starts)
        drawn = sample_importance(
            problem, found, seed=seed, chains=1, draws=N_DRAWS, evaluations=evaluations, chunk=chunk
        )
        return drawn.flat

    return posterior


def _simulate(problem: Problem, seed: int) -> tuple[Float[np.ndarray, " n"], Problem, int]:
    """Constants from the prior, the same problem with data of theirs, and how many draws had no density before."""
    key, numbers = jax.random.key(seed), as_arrays(problem)
    for attempt in range(_MOST_TRIES):
        prior_key, data_key = jax.random.split(jax.random.fold_in(key, attempt))
        truth = problem.parameters.draw(prior_key)
        replicate = _with_data(numbers, data_key, truth)
        if np.isfinite(batched_log_density(replicate)(np.asarray(truth)[None])[0]):
            return np.asarray(truth), replicate, attempt
    raise InputError(f"none of {_MOST_TRIES} draws of the prior gives a finite density: narrow the priors.")


@eqx.filter_jit
def _with_data(problem: Problem, key: PRNGKeyArray, truth: Float[Array, " n"]) -> Problem:
    """Compiled once for all draws: what noise does along a series would be compiled for each."""
    return problem.draw_data(key, truth)


def _log_likelihood(problem: Problem, points: Float[np.ndarray, "point n"]) -> Float[np.ndarray, " point"]:
    prior = np.asarray(jax.vmap(problem.parameters.log_prior)(jnp.asarray(points)))
    return batched_log_density(problem)(points) - prior


def _resume(file: Path | None, problem: Problem, seed: int, made_by: str) -> list[dict]:
    head = {"problem": {**fingerprint(problem), "data": "replaced"}, "seed": seed, "made_by": made_by}
    if file is None:
        return []
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(head) + "\n", encoding="utf-8")
        return []
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    # A line that was cut off when the run was killed is done again.
    whole = [line for line in lines if line.endswith("\n")]
    if not whole or not _same(json.loads(whole[0]), head):
        raise InputError(
            f"{file}: holds ranks of another problem, seed or maker of posteriors; delete it to begin anew, or name "
            "another file."
        )
    if len(whole) < len(lines):
        file.write_text("".join(whole), encoding="utf-8")
    return [json.loads(line) for line in whole[1:]]


def _same(found: dict, head: dict) -> bool:
    numbers = [float(each["problem"].pop("log_density_at_start")) for each in (found, head)]
    return found == head and bool(np.isclose(*numbers, rtol=1e-6))
