r"""Laplace approximation: the posterior as the normal density that has its mode and its curvature there.

The fast look, and where the samplers begin. In the unconstrained coordinates u it is exact for a normal posterior; its
intervals are too short where the posterior is skewed or has long tails, so that they are no substitute for draws.
"""

import dataclasses
from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Float, PRNGKeyArray

from arfjax.errors import InputError
from inverse.descent import LEAST_CURVATURE, Descent, Expansion, descend, expand, polish
from inverse.inference.compiled import log_density_of
from inverse.inference.problem import Problem
from inverse.sampling.target import batched_log_density, coordinate_names, prior_points, require_posterior

_AGREE = 0.1
"""Log density within which two starts have come to the same mode [nats]."""
_FLAT = 1e-6
"""Curvature below which a density does not fall: a spread of 1000 in u."""


@dataclasses.dataclass(frozen=True)
class Laplace:
    """A normal density in the unconstrained coordinates.

    Attributes:
        mode: Where the log density is highest.
        covariance: Inverse of minus the Hessian there; a stand-in where `positive_definite` is not.
        log_density: At the mode [nats].
        names: Of the coordinates.
        decrement: What a further Newton step would gain [nats].
        converged: Whether the mode is one.
        positive_definite: Whether the density falls in every direction.
        starts: Log densities that the starts came to [nats], highest first.
        message: In words.
    """

    mode: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]
    log_density: float
    names: tuple[str, ...]
    decrement: float
    converged: bool
    positive_definite: bool
    starts: Float[np.ndarray, " start"]
    message: str

    @property
    def is_sound(self) -> bool:
        """Whether it is a mode with a covariance, to which at least half of the starts came."""
        agreeing = np.sum(self.starts > self.starts[0] - _AGREE)
        return self.converged and self.positive_definite and bool(agreeing >= 0.5 * len(self.starts))

    @property
    def sd(self) -> Float[np.ndarray, " n"]:
        """Standard deviations of the unconstrained numbers."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def factor(self) -> Float[np.ndarray, "n n"]:
        """Lower triangular L with covariance L L^T: u = mode + L z has independent standard normal z."""
        return np.linalg.cholesky(self.covariance)

    @property
    def log_evidence(self) -> float:
        """Logarithm of the evidence if the posterior were normal in u [nats]; NaN where it has no covariance."""
        if not (self.converged and self.positive_definite):
            return float("nan")
        half_determinant = float(np.sum(np.log(np.diag(self.factor))))
        return self.log_density + 0.5 * len(self.mode) * np.log(2.0 * np.pi) + half_determinant

    def draw(self, key: PRNGKeyArray, count: int) -> Float[np.ndarray, "count n"]:
        """Flat vectors from the normal density."""
        return self.mode + np.array(jax.random.normal(key, (count, len(self.mode)))) @ self.factor.T


def laplace(
    problem: Problem,
    *,
    seed: int = 0,
    n_starts: int = 8,
    on_step: Callable[[str], None] = lambda what: None,
) -> Laplace:
    """Find the mode of the posterior density of u, and its curvature there.

    BFGS from what stands in the model and from draws of the prior, each in coordinates whitened by the Hessian where
    it starts; the best is finished by damped Newton steps.

    Args:
        problem: With a prior for every parameter.
        seed: Of the starts.
        n_starts: How many, that in the model included.
        on_step: Told in words how far it is.

    Raises:
        InputError: if there is no posterior, or no start with a finite density.
    """
    require_posterior(problem)
    density, descended = log_density_of(problem), []

    def cost(u: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        value, slope = density(u)
        return -value, -slope

    for number, start in enumerate(_starts(problem, seed, n_starts)):
        on_step(f"mode: start {number + 1} of {n_starts}")
        descended.append(descend(cost, start))
    if not any(np.isfinite(each.value) for each in descended):
        raise InputError(
            "the search for the mode left the range of finite log densities from every start; narrow priors."
        )
    descended.sort(key=lambda each: each.value)
    on_step("mode: Newton steps")
    found = polish(cost, descended[0])
    on_step("mode: curvature")
    return _summary(problem, expand(cost, found.point), found, -np.array([each.value for each in descended]))


def _starts(problem: Problem, seed: int, count: int) -> Float[np.ndarray, "start n"]:
    key = jax.random.key(seed)
    points = np.concatenate([np.asarray(problem.start)[None], prior_points(problem, key, 4 * count)])
    heights = batched_log_density(problem)(points)
    finite = points[np.isfinite(heights)]
    if len(finite) == 0:
        raise InputError(
            "the log density is not finite at the start nor at any draw of the prior: check what the model predicts at "
            "`problem.start`, and that data and noise are finite."
        )
    return finite[:count]


def _summary(problem: Problem, about: Expansion, found: Descent, heights: Float[np.ndarray, " start"]) -> Laplace:
    names, value = coordinate_names(problem.parameters), -about.value
    finite = bool(np.all(np.isfinite(about.curvature)))
    eigenvalues, vectors = np.linalg.eigh(about.curvature if finite else np.eye(len(names)))
    # Judged on a scale of 1 in u; differences leave some of the largest curvature in every other.
    flat = eigenvalues <= _FLAT * max(1e-4 * float(eigenvalues[-1]), 1.0)
    safe = np.where(flat, LEAST_CURVATURE, eigenvalues)
    agreeing = int(np.sum(heights > max(value, heights[0]) - _AGREE))
    message = f"mode reached by {agreeing} of {len(heights)} starts"
    if not finite:
        message = "the curvature at the mode is not a number; the covariance is a stand-in to start samplers from"
    elif np.any(flat):
        said = "; ".join(_direction(vectors[:, index], names) for index in np.flatnonzero(flat))
        message += (
            f"; the posterior density does not fall along {said}, so that it has no covariance: the one given is a "
            "stand-in to start samplers from. Give that direction a narrower prior or hold it fixed"
        )
    if not found.converged:
        message += f"; not a mode yet: another step would gain {found.gain:.2g} nats. Try more starts"
    covariance = (vectors / safe) @ vectors.T
    return Laplace(
        found.point,
        0.5 * (covariance + covariance.T),
        value,
        names,
        found.gain,
        found.converged,
        finite and not bool(np.any(flat)),
        heights,
        message,
    )


def _direction(vector: Float[np.ndarray, " n"], names: tuple[str, ...]) -> str:
    """A direction in u by the names of its largest components."""
    order = np.argsort(-np.abs(vector))
    kept = [index for index in order if abs(vector[index]) > 0.1][:4]
    sign = np.sign(vector[kept[0]])
    terms = [f"{sign * vector[index]:+.2f} {names[index]}" for index in kept]
    return " ".join(terms).removeprefix("+")
