r"""Evidence: the probability of the data under a model, by bridge sampling from draws of its posterior.

$$ Z = \frac{E_g[h \, q]}{E_p[h \, g]}, \quad h = \frac{1}{s_1 q / Z + s_2 g} $$

with the posterior density $q$ but for its constant, whose draws are $p = q / Z$, and a normal density g that is fitted
to one half of the draws while the other half enters the ratio (Meng & Wong 1996). It needs no runs of its own, and its
error is known (Fruehwirth-Schnatter 2004), provided that the draws have found all of the posterior.
"""

import dataclasses

import jax
import numpy as np
from jaxtyping import Float
from scipy import special

from arfjax.errors import InputError
from inverse.inference.problem import Problem
from inverse.sampling.draws import Draws
from inverse.sampling.inference_data import mean_size
from inverse.sampling.target import batched_log_density, require_posterior

_MOST_ITERATIONS = 1000
_TOLERANCE = 1e-10
_LARGEST_ERROR = 0.2
_SMALLEST_SHARE = 0.02


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Logarithm of the evidence.

    Attributes:
        log_evidence: Natural logarithm [nats].
        standard_error: Of it, from the scatter of both sets of draws [nats].
        overlap: Share of the proposals that fall where the posterior is: small where the normal density fits it badly.
        converged: Whether the iteration did.
        warnings: A sentence for everything that makes the number doubtful.
    """

    log_evidence: float
    standard_error: float
    overlap: float
    converged: bool
    warnings: tuple[str, ...]


def bridge_evidence(
    problem: Problem, draws: Draws, *, seed: int = 0, most_proposals: int = 20_000, chunk: int | None = None
) -> Evidence:
    """Evidence of a problem whose priors and noise are normalised densities, as all of ours are.

    Args:
        problem: Whose posterior was sampled.
        draws: From any sampler, burn-in left out.
        seed: Of the proposals.
        most_proposals: Of the normal density; as many as draws of the half if those are fewer.
        chunk: Points whose density is computed at once; None for all.

    Raises:
        InputError: if there are too few draws for a covariance.
    """
    require_posterior(problem)
    chains, count, size = draws.unconstrained.shape
    half = count // 2
    if chains * half < 4 * size + 2 or half < 4:
        raise InputError(
            f"{chains} chains of {count} draws are too few to fit a density of {size} dimensions to half of them: "
            "run longer."
        )
    first, second = draws.unconstrained[:, :half], draws.unconstrained[:, half:]
    fitted = first.reshape(-1, size)
    centre, factor = np.mean(fitted, axis=0), np.linalg.cholesky(np.atleast_2d(np.cov(fitted.T)))
    n_proposals = min(most_proposals, second.shape[0] * second.shape[1])
    standard = np.array(jax.random.normal(jax.random.key(seed), (n_proposals, size)))
    proposals = centre + standard @ factor.T
    # Logarithms of q over g: at draws of the posterior and at proposals.
    at_draws = draws.log_density[:, half:].ravel() - _log_normal(second.reshape(-1, size), centre, factor)
    at_proposals = batched_log_density(problem, chunk=chunk)(proposals) - _log_normal(proposals, centre, factor)
    return _bridge(at_draws.reshape(chains, -1), at_proposals)


def _log_normal(
    points: Float[np.ndarray, "point n"], centre: Float[np.ndarray, " n"], factor: Float[np.ndarray, "n n"]
) -> Float[np.ndarray, " point"]:
    white = np.linalg.solve(factor, (points - centre).T)
    constant = 0.5 * len(centre) * np.log(2.0 * np.pi) + np.sum(np.log(np.diag(factor)))
    return -0.5 * np.sum(white**2, axis=0) - constant


def _bridge(at_draws: Float[np.ndarray, "chain draw"], at_proposals: Float[np.ndarray, " proposal"]) -> Evidence:
    """Iterate the ratio; draws that resemble one another count as the fewer independent ones that they are."""
    effective = np.nanmin([mean_size(at_draws), at_draws.size]) if np.ptp(at_draws) > 0.0 else float(at_draws.size)
    share = effective / (effective + len(at_proposals))
    log_share, log_rest = np.log(share), np.log1p(-share)
    flat, log_z, converged = at_draws.ravel(), float(np.median(at_draws)), False
    for _ in range(_MOST_ITERATIONS):
        # h q over proposals and h g over draws, each divided by g, in logarithms.
        over = special.logsumexp(at_proposals - _mixed(at_proposals, log_z, log_share, log_rest))
        under = special.logsumexp(-_mixed(flat, log_z, log_share, log_rest))
        new = float(over - np.log(len(at_proposals)) - under + np.log(len(flat)))
        converged = abs(new - log_z) < _TOLERANCE * max(abs(new), 1.0)
        log_z = new
        if converged or not np.isfinite(new):
            break
    numerator = np.exp(at_proposals - log_z - _mixed(at_proposals, log_z, log_share, log_rest))
    denominator = np.exp(-_mixed(at_draws, log_z, log_share, log_rest))
    size = mean_size(denominator)
    size = float(denominator.size) if not np.isfinite(size) else size
    error = float(np.sqrt(_relative_variance(numerator) / len(numerator) + _relative_variance(denominator) / size))
    # Effective number of proposals as an importance sample, over their number.
    highest = float(np.max(at_proposals))
    weights = np.exp(at_proposals - (highest if np.isfinite(highest) else 0.0))
    overlap = float(np.sum(weights) ** 2 / max(np.sum(weights**2), np.finfo(float).tiny))
    overlap /= len(at_proposals)
    return Evidence(log_z, error, overlap, bool(converged), tuple(_warnings(error, overlap, bool(converged))))


def _mixed(ratio: np.ndarray, log_z: float, log_share: float, log_rest: float) -> np.ndarray:
    """Logarithm of share q / (Z g) + rest."""
    return np.logaddexp(log_share + ratio - log_z, log_rest)


def _relative_variance(values: np.ndarray) -> float:
    mean = float(np.mean(values))
    return float(np.var(values)) / mean**2 if mean > 0.0 and np.isfinite(mean) else float("inf")


def _warnings(error: float, overlap: float, converged: bool) -> list[str]:
    found = []
    if not converged:
        found.append("The iteration did not converge: the evidence is not known.")
    if not error < _LARGEST_ERROR:
        found.append(f"The standard error is {error:.2g} nats, above {_LARGEST_ERROR}: take more draws.")
    if not overlap > _SMALLEST_SHARE:
        found.append(
            f"A normal density fits the posterior badly: proposals are worth {100.0 * overlap:.2g} % of their number, "
            "so that the standard error itself is doubtful. Compare with other seeds."
        )
    return found
