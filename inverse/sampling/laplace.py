r"""Laplace approximation: the posterior as the normal density that has its mode and its curvature there.

The fast look, and where the samplers begin. In the unconstrained coordinates u it is exact for a normal posterior; its
intervals are too short where the posterior is skewed or has long tails, so that they are no substitute for draws.
"""

import dataclasses
import warnings
from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Float, PRNGKeyArray
from scipy import optimize

from arfjax.errors import InputError
from inverse.inference.problem import Problem
from inverse.sampling.target import batched_log_density, coordinate_names, gradient_of, prior_points, require_posterior

_AGREE = 0.1
"""Log density within which two starts have come to the same mode [nats]."""
_DECREMENT = 1e-6
"""Newton decrement below which a mode is one: what a step more would gain [nats]."""
_FLAT = 1e-6
"""Curvature below which a density does not fall: a spread of 1000 in u."""
_LEAST_CURVATURE = 0.1
"""Curvature at least given to directions along which the density does not fall: a spread of about 3 in u."""
_BFGS_STEPS = 300
_FIRST_STEP, _STEP = 1e-4, 1e-2
"""Steps of differences: in u, and in standard deviations."""
_NOWHERE = 1e10
"""Cost where there is none, from which a line search turns back [nats]."""
_NEWTON_STEPS = 50


Gradient = Callable[[Float[np.ndarray, " n"]], tuple[float, Float[np.ndarray, " n"]]]


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
    gradient, descended = gradient_of(problem), []
    for number, start in enumerate(_starts(problem, seed, n_starts)):
        on_step(f"mode: start {number + 1} of {n_starts}")
        descended.append(_descend(gradient, start))
    heights = np.array([gradient(each)[0] for each in descended])
    if not np.any(np.isfinite(heights)):
        raise InputError(
            "the search for the mode left the range of finite log densities from every start; narrow priors."
        )
    order = np.argsort(-heights)
    on_step("mode: Newton steps")
    mode, decrement = _polish(gradient, descended[order[0]])
    on_step("mode: curvature")
    return _summary(problem, gradient, mode, decrement, heights[order])


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


def _descend(gradient: Gradient, start: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """BFGS in coordinates whitened by the curvature at the start."""
    _, hessian = _expand(gradient, start)[1:]
    values, vectors = np.linalg.eigh(hessian if np.all(np.isfinite(hessian)) else np.eye(len(start)))
    factor = vectors / np.sqrt(np.maximum(np.abs(values), _LEAST_CURVATURE))

    def cost(z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        value, slope = gradient(start + factor @ z)
        if not (np.isfinite(value) and np.all(np.isfinite(slope))):
            return _NOWHERE, np.zeros_like(z)
        return -value, -(factor.T @ slope)

    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # of line searches that end early: what was reached is judged later
        found = optimize.minimize(
            cost, np.zeros_like(start), jac=True, method="BFGS", options={"maxiter": _BFGS_STEPS, "gtol": 1e-5}
        )
    return start + factor @ found.x


def _expand(
    gradient: Gradient, u: Float[np.ndarray, " n"]
) -> tuple[float, Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
    """Log density, gradient and minus the Hessian, by differences of gradients along directions of unit curvature.

    Twice, since the first time no such directions are known. Differences of the fourth order are exact to ten digits,
    and need neither compilation nor rules for second derivatives, which some solvers lack.
    """
    value, slope = gradient(u)
    factor, step, hessian = np.eye(len(u)), _FIRST_STEP, np.full((len(u), len(u)), np.nan)
    for _ in range(2):
        near, far = (
            np.stack(
                [(gradient(u + k * step * e)[1] - gradient(u - k * step * e)[1]) / (2.0 * k * step) for e in factor.T]
            )
            for k in (1.0, 2.0)
        )
        # Rows are derivatives along the columns of the factor.
        hessian = -np.linalg.solve(factor.T, (4.0 * near - far) / 3.0)
        hessian = 0.5 * (hessian + hessian.T)
        if not np.all(np.isfinite(hessian)):
            break
        values, vectors = np.linalg.eigh(hessian)
        factor, step = vectors / np.sqrt(np.maximum(np.abs(values), _LEAST_CURVATURE)), _STEP
    return value, slope, hessian


def _polish(gradient: Gradient, u: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], float]:
    """Newton steps with as much damping as it takes to climb; the mode, and what one more step would gain."""
    value, slope, hessian = _expand(gradient, u)
    damping, decrement = 0.0, float("inf")
    for _ in range(_NEWTON_STEPS):
        if not np.all(np.isfinite(hessian)) or not np.all(np.isfinite(slope)):
            return u, float("inf")
        eigenvalues, vectors = np.linalg.eigh(hessian)
        along = vectors.T @ slope
        safe = np.where(eigenvalues > 0.0, eigenvalues, np.maximum(np.abs(eigenvalues), _LEAST_CURVATURE))
        decrement = float(0.5 * np.sum(along**2 / safe))
        if decrement < _DECREMENT**2:
            break
        candidate = u + vectors @ (along / (safe + damping * np.max(safe)))
        expansion = _expand(gradient, candidate)
        if np.isfinite(expansion[0]) and expansion[0] >= value:
            u, (value, slope, hessian), damping = candidate, expansion, 0.1 * damping if damping > 1e-8 else 0.0
        elif decrement < _DECREMENT:
            break  # what is left to gain is below rounding of the log density
        else:
            damping = max(10.0 * damping, 1e-6)
    return u, decrement


def _summary(
    problem: Problem,
    gradient: Gradient,
    mode: Float[np.ndarray, " n"],
    decrement: float,
    heights: Float[np.ndarray, " start"],
) -> Laplace:
    names = coordinate_names(problem.parameters)
    value, _, hessian = _expand(gradient, mode)
    finite = bool(np.all(np.isfinite(hessian)))
    eigenvalues, vectors = np.linalg.eigh(hessian if finite else np.eye(len(mode)))
    # Judged on a scale of 1 in u; differences leave some of the largest curvature in every other.
    flat = eigenvalues <= _FLAT * max(1e-4 * float(eigenvalues[-1]), 1.0)
    converged = decrement < _DECREMENT
    safe = np.where(flat, _LEAST_CURVATURE, eigenvalues)
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
    if not converged:
        message += f"; not a mode yet: another step would gain {decrement:.2g} nats. Try more starts"
    covariance = (vectors / safe) @ vectors.T
    return Laplace(
        mode,
        0.5 * (covariance + covariance.T),
        value,
        names,
        decrement,
        converged,
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
