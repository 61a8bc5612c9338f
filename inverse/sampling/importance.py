r"""Importance sampling: independent draws near the posterior, each with the weight that makes it one of the posterior.

The proposal is Student's t with the mode and the spread of the Laplace approximation, moved once to the mean and
spread that its own weighted draws have. A posterior in ten dimensions that is near normal takes a few thousand
evaluations, in batches and without gradients: minutes where a trajectory for every draw would take hours. Whether the
proposal reaches the posterior's tails is told by the fitted Pareto shape of the largest weights: above 0.7 the draws
are not to be trusted.

Source: A. Vehtari, D. Simpson, A. Gelman, Y. Yao & J. Gabry, Pareto smoothed importance sampling, J. Mach. Learn. Res.
    25 (2024) 1; one step of adaptation as in O. Cappé et al., Stat. Comput. 18 (2008) 447.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import stats

from inverse.inference.problem import Problem
from inverse.sampling.draws import Draws
from inverse.sampling.inference_data import smoothed_weights
from inverse.sampling.laplace import Laplace
from inverse.sampling.target import batched_log_density, require_posterior

LARGEST_SHAPE = 0.7
"""Pareto shape of the weights above which their mean may not exist for all that can be told."""
_FREEDOM = 6.0
"""Of Student's t: tails heavier than normal ones, the middle still near them."""
_WIDER = 1.15
"""Spread of the first proposal in that of the normal approximation, against tails that it does not know of."""


def sample_importance(
    problem: Problem,
    found: Laplace,
    *,
    seed: int,
    draws: int = 1000,
    chains: int = 4,
    evaluations: int = 4000,
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
        chunk: Points whose density is computed at once; None for as many as there are.
        on_step: Told in words how far it is.

    Returns:
        Draws of which some are the same point; `settings` has `effective_size`, the number of independent draws that
        they are worth, and `pareto_shape`. `finished` is whether that shape is small enough.

    Raises:
        InputError: if there is no posterior.
    """
    require_posterior(problem)
    begun, rng = time.monotonic(), np.random.default_rng(seed)
    density = batched_log_density(problem, chunk=chunk)
    first = max(evaluations // 4, 10 * len(found.mode))
    on_step(f"importance: {first} draws of the normal approximation")
    points, logs, _ = _weighted(density, found.mode, _WIDER**2 * found.covariance, first, rng)
    smooth, _ = smoothed_weights(logs)
    share = np.exp(smooth)
    mean = share @ points
    # The first draws may be few in some directions: their spread is pulled half-way to the approximation's.
    spread = 0.5 * ((points - mean).T * share) @ (points - mean) + 0.5 * found.covariance
    on_step(f"importance: {evaluations - first} draws")
    points, logs, heights = _weighted(density, mean, _WIDER**2 * spread, max(evaluations - first, first), rng)
    smooth, shape = smoothed_weights(logs)
    share = np.exp(smooth)
    size = float(1.0 / np.sum(share**2))
    taken = rng.permutation(_systematic(share, chains * draws, rng))
    return Draws(
        unconstrained=points[taken].reshape(chains, draws, -1),
        log_density=heights[taken].reshape(chains, draws),
        statistics={},
        sampler="importance sampling",
        seed=seed,
        settings={"evaluations": evaluations, "effective_size": size, "pareto_shape": shape},
        finished=shape <= LARGEST_SHAPE,
        message=_message(len(points), size, shape),
        evaluations=first + len(points),
        seconds=time.monotonic() - begun,
    )


def _weighted(
    density: Callable[[Float[np.ndarray, "point n"]], Float[np.ndarray, " point"]],
    centre: Float[np.ndarray, " n"],
    spread: Float[np.ndarray, "n n"],
    count: int,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "point n"], Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
    """Points, logarithms of their weights, and log densities; points without a density are left out."""
    student: Any = stats.multivariate_t  # whose annotations know whole numbers only
    proposal = student(centre, spread * (_FREEDOM - 2.0) / _FREEDOM, df=_FREEDOM)
    points = np.atleast_2d(proposal.rvs(count, random_state=rng)).reshape(count, -1)
    heights = density(points)
    usable = np.isfinite(heights)
    return points[usable], (heights - proposal.logpdf(points))[usable], heights[usable]


def _systematic(share: Float[np.ndarray, " point"], count: int, rng: np.random.Generator) -> np.ndarray:
    """Indices in proportion to shares, each as often as its share says but for less than one."""
    ends = np.cumsum(share)
    return np.searchsorted(ends / ends[-1], (np.arange(count) + rng.uniform()) / count)


def _message(count: int, size: float, shape: float) -> str:
    told = f"{count} weighted draws, worth {size:.0f} independent ones; Pareto shape of the weights {shape:.2f}"
    if shape <= LARGEST_SHAPE:
        return told
    return (
        f"{told}, above {LARGEST_SHAPE}: the proposal misses part of the posterior, so that these draws are not to be "
        "trusted: sample with NUTS or the ensemble"
    )
