"""Evidence where it is known, and said to be doubtful where it is."""

import dataclasses

import numpy as np
import pytest

from arfjax import InputError
from inverse.sampling import Draws, bridge_evidence, laplace
from inverse.sampling.target import batched_log_density
from tests.inverse.sampling.conjugate import conjugate_problem, exact_posterior


def exact_draws(problem, *, chains=4, count=1000, seed=0, correlation=0.0):
    """Draws of the known posterior, each correlated with the one before."""
    mean, covariance, _ = exact_posterior(problem)
    random = np.random.default_rng(seed)
    white = random.normal(size=(chains, count, len(mean)))
    for index in range(1, count):
        white[:, index] = correlation * white[:, index - 1] + np.sqrt(1.0 - correlation**2) * white[:, index]
    u = mean + white @ np.linalg.cholesky(covariance).T
    density = batched_log_density(problem)(u.reshape(-1, len(mean))).reshape(chains, count)
    return Draws(u, density, {}, "exact", seed, {}, True, "", 0, 1.0)


@pytest.mark.parametrize("n", [1, 4])
def test_evidence_of_a_linear_model_is_exact_within_its_error(n):
    problem = conjugate_problem(n)
    exact = exact_posterior(problem)[2]
    found = bridge_evidence(problem, exact_draws(problem))
    assert found.converged and found.warnings == () and found.overlap > 0.9
    assert 0.0 < found.standard_error < 0.01
    assert abs(found.log_evidence - exact) < 4.0 * found.standard_error
    np.testing.assert_allclose(laplace(problem).log_evidence, exact, rtol=1e-9)


def test_stated_errors_are_those_of_repetitions():
    """A posterior that a normal density fits badly, by draws that are correlated."""
    problem = conjugate_problem(2)
    exact = exact_posterior(problem)[2]
    found = []
    for seed in range(40):
        draws = exact_draws(problem, chains=2, count=200, seed=seed, correlation=0.6)
        # Drawn too wide in the fitted half, so that the proposal is too wide.
        wide = draws.unconstrained.copy()
        wide[:, :100] += 2.5 * (wide[:, :100] - wide[:, :100].mean(axis=(0, 1)))
        found.append(bridge_evidence(problem, dataclasses.replace(draws, unconstrained=wide), seed=seed))
    distances = np.array([(one.log_evidence - exact) / one.standard_error for one in found])
    assert abs(np.mean(distances)) < 4.0 / np.sqrt(40.0)
    assert 0.6 < np.std(distances) < 1.5


def test_a_bad_fit_and_few_draws_are_said():
    problem = conjugate_problem(3)
    draws = exact_draws(problem, count=40)
    astray = draws.unconstrained.copy()
    astray[:, :20] += 3.0
    found = bridge_evidence(problem, dataclasses.replace(draws, unconstrained=astray))
    assert any("fits the posterior badly" in each for each in found.warnings)
    with pytest.raises(InputError, match="1 chains of 12 draws are too few"):
        bridge_evidence(problem, exact_draws(problem, chains=1, count=12))
