r"""Importance sampling: independent draws near the posterior, each with the weight that makes it one of the posterior.

The proposal is Student's t with the mode and the spread of the Laplace approximation, moved once to the mean and
spread that its own weighted draws have. Where those draws are worth too few, it is moved again, and all draws since
are weighted by the mixture of the proposals that they came from. A posterior in ten dimensions that is near normal
takes a few thousand evaluations, in batches and without gradients: minutes where a trajectory for every draw would take
hours. Whether the proposal reaches the posterior's tails is told by the fitted Pareto shape of the largest weights:
above 0.7 the draws are not to be trusted.

Source: A. Vehtari, D. Simpson, A. Gelman, Y. Yao & J. Gabry, Pareto smoothed importance sampling, J. Mach. Learn. Res.
    25 (2024) 1; adaptation as in O. Cappé et al., Stat. Comput. 18 (2008) 447, and J.-M. Cornuet et al., Scand. J.
    Stat. 39 (2012) 798.
"""

import dataclasses
import time
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy import special

from arfjax.errors import InputError
from inverse.inference.problem import Problem
from inverse.sampling.draws import Draws
from inverse.sampling.evidence import Evidence
from inverse.sampling.inference_data import smoothed_weights
from inverse.sampling.laplace import Laplace
from inverse.sampling.target import batched_log_density, require_posterior

LARGEST_SHAPE = 0.7
"""Pareto shape of the weights above which their mean may not exist for all that can be told."""
_FREEDOM = 6.0
"""Of Student's t: tails heavier than normal ones, the middle still near them."""
_MOST_REFUSED = 0.1
"""Share of proposals without a density above which the posterior is likely to be cut off itself."""
_FEWEST = 25
_WIDER = 1.15
"""Spread of a proposal in that of the normal approximation, or of the draws before, against tails not known of."""


def sample_importance(
    problem: Problem,
    found: Laplace,
    *,
    seed: int,
    draws: int = 1000,
    chains: int = 4,
    evaluations: int = 4000,
    most_evaluations: int | None = None,
    enough: float = 400.0,
    chunk: int | None = None,
    on_step: Callable[[str], None] = lambda what: None,
) -> Draws:
    """Draws of the posterior, resampled from weighted ones.

    Args:
        problem: With a prior for every parameter.
        found: From `laplace`.
        seed: Of every random number.
        draws: Of each chain; all are exchangeable, chains are only how they are counted.
        chains: How many.
        evaluations: Of the log density, a quarter of them for the first proposal.
        most_evaluations: Never more than so many, and up to it further rounds while the draws are worth too few; none
            if not given.
        enough: Independent draws that they should be worth.
        chunk: Points whose density is computed at once; None for as many as there are.
        on_step: Told in words how far it is.

    Returns:
        Draws of which some are the same point; `settings` has `effective_size`, the number of independent draws that
        they are worth, `pareto_shape`, `refused`, the share of the proposals that had no density, and the evidence,
        see `importance_evidence`. `finished` is whether shape and share are small enough.

    Raises:
        InputError: if there is no posterior, or hardly any proposal has a density.
    """
    require_posterior(problem)
    begun, rng = time.monotonic(), np.random.default_rng(seed)
    density = batched_log_density(problem, chunk=chunk)
    evaluations = evaluations if most_evaluations is None else min(evaluations, most_evaluations)
    first = max(evaluations // 4, min(10 * len(found.mode), evaluations // 2))
    on_step(f"importance: {first} draws of the normal approximation")
    spread = found.covariance
    pool = _Pool((_Round.of(density, found.mode, spread, first, rng),))
    mean, spread = pool.moved(spread)
    count, spent, most = max(evaluations - first, 1), first, most_evaluations or evaluations
    pool = _Pool(())
    while not pool.rounds or (pool.size < enough and spent + count <= most):
        on_step(f"importance: {count} draws{f', after {spent}' if pool.rounds else ''}")
        pool = _Pool((*pool.rounds, _Round.of(density, mean, spread, count, rng)))
        spent += count
        mean, spread = pool.moved(spread)
    points, heights, logs = pool.points, pool.heights, pool.log_weights
    share, shape, size, refused = pool.share, pool.shape, pool.size, pool.refused
    proposed = len(logs) / (1.0 - refused)  # those without a density weigh nothing, and count
    taken = rng.permutation(_systematic(share, chains * draws, rng))
    return Draws(
        unconstrained=points[taken].reshape(chains, draws, -1),
        log_density=heights[taken].reshape(chains, draws),
        statistics={},
        sampler="importance sampling",
        seed=seed,
        settings={
            "evaluations": evaluations,
            "effective_size": size,
            "pareto_shape": shape,
            "refused": refused,
            "log_evidence": float(np.logaddexp.reduce(logs) - np.log(proposed)),
            "log_evidence_error": float(np.sqrt(max(1.0 / size - 1.0 / proposed, 0.0))),
        },
        finished=shape <= LARGEST_SHAPE and refused <= _MOST_REFUSED,
        message=_message(len(points), size, shape, refused),
        evaluations=spent,
        seconds=time.monotonic() - begun,
    )


@dataclasses.dataclass(frozen=True)
class _Round:
    """Draws of one proposal.

    Attributes:
        centre: Of the proposal.
        factor: Lower triangular, of Student's t.
        count: Draws, with those that have no density.
        points: Those with one.
        heights: Their log densities [nats].
    """

    centre: Float[np.ndarray, " n"]
    factor: Float[np.ndarray, "n n"]
    count: int
    points: Float[np.ndarray, "point n"]
    heights: Float[np.ndarray, " point"]

    @classmethod
    def of(
        cls,
        density: Callable[[Float[np.ndarray, "point n"]], Float[np.ndarray, " point"]],
        centre: Float[np.ndarray, " n"],
        spread: Float[np.ndarray, "n n"],
        count: int,
        rng: np.random.Generator,
    ) -> "_Round":
        """Draw, and keep what has a density."""
        factor = np.linalg.cholesky(_WIDER**2 * spread * (_FREEDOM - 2.0) / _FREEDOM)
        standard = rng.standard_normal((count, len(centre))) / np.sqrt(rng.chisquare(_FREEDOM, (count, 1)) / _FREEDOM)
        points = centre + standard @ factor.T
        heights = density(points)
        usable = np.isfinite(heights)
        if np.sum(usable) < _FEWEST:
            raise InputError(
                f"{np.sum(usable)} of {count} proposals about the mode have a finite log density: the model covers "
                "hardly anything of the posterior, or its normal approximation is none. Narrow the priors, or take "
                "other draws to prepare a fast model with."
            )
        return cls(centre, factor, count, points[usable], heights[usable])

    def log_density(self, points: Float[np.ndarray, "point n"]) -> Float[np.ndarray, " point"]:
        """Of the proposal."""
        n = len(self.centre)
        standard = np.linalg.solve(self.factor, (points - self.centre).T)
        constant = special.gammaln(0.5 * (_FREEDOM + n)) - special.gammaln(0.5 * _FREEDOM)
        constant -= 0.5 * n * np.log(_FREEDOM * np.pi) + np.sum(np.log(np.diag(self.factor)))
        return constant - 0.5 * (_FREEDOM + n) * np.log1p(np.sum(standard**2, axis=0) / _FREEDOM)


class _Pool:
    """Draws of several rounds, weighted by the mixture of their proposals."""

    def __init__(self, rounds: tuple[_Round, ...]) -> None:
        self.rounds = rounds
        if not rounds:
            return
        self.points = np.concatenate([each.points for each in rounds])
        self.heights = np.concatenate([each.heights for each in rounds])
        total = sum(each.count for each in rounds)
        mixture = np.stack([each.log_density(self.points) + np.log(each.count / total) for each in rounds])
        self.log_weights = self.heights - np.logaddexp.reduce(mixture, axis=0)
        smooth, self.shape = smoothed_weights(self.log_weights)
        self.share = np.exp(smooth)
        self.size = float(1.0 / np.sum(self.share**2))
        self.refused = 1.0 - len(self.points) / total

    def moved(self, spread: Float[np.ndarray, "n n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
        """Mean of the draws, and their spread pulled half-way to the last: few draws may tell of some directions."""
        mean = self.share @ self.points
        away = self.points - mean
        return mean, 0.5 * (away.T * self.share) @ away + 0.5 * spread


def _systematic(share: Float[np.ndarray, " point"], count: int, rng: np.random.Generator) -> np.ndarray:
    """Indices in proportion to shares, each as often as its share says but for less than one."""
    ends = np.cumsum(share)
    return np.searchsorted(ends / ends[-1], (np.arange(count) + rng.uniform()) / count)


def importance_evidence(draws: Draws) -> Evidence:
    """Evidence from the mean of the weights of `sample_importance`; its error holds if draws are sound."""
    value, error = (float(draws.settings[name]) for name in ("log_evidence", "log_evidence_error"))
    warnings = () if draws.finished else (f"The weights do not support it: {draws.message}.",)
    size, used = float(draws.settings["effective_size"]), max(draws.evaluations, 1)
    return Evidence(value, error, size / used, True, warnings)


def _message(count: int, size: float, shape: float, refused: float) -> str:
    told = f"{count} weighted draws, worth {size:.0f} independent ones; Pareto shape of the weights {shape:.2f}"
    if refused:
        told += f"; {100.0 * refused:.2g} % of the proposals had no density"
    if refused > _MOST_REFUSED:
        return f"{told}: the posterior may be cut off where the model has none; widen what it covers"
    if shape <= LARGEST_SHAPE:
        return told
    return (
        f"{told}, above {LARGEST_SHAPE}: the proposal misses part of the posterior, so that these draws are not to be "
        "trusted: sample with NUTS or the ensemble"
    )
