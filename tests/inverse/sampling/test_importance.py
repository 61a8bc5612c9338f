"""Importance sampling: the moments of known posteriors, what its draws are worth, and proposals that miss."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from arfjax import InputError
from inverse.sampling import diagnose_draws, importance_evidence, laplace, sample_importance
from inverse.sampling.target import batched_log_density
from inverse.study import Effort, Sampler, infer
from tests.inverse.sampling.conjugate import conjugate_problem, exact_posterior

PROBLEM = conjugate_problem()


@pytest.fixture(scope="module")
def found():
    return laplace(PROBLEM, n_starts=2)


def test_moments_of_a_normal_posterior(found):
    """Within four errors of a mean of as many independent draws as they are worth."""
    drawn = sample_importance(PROBLEM, found, seed=1, draws=2000, evaluations=8000)
    mean, covariance, _ = exact_posterior(PROBLEM)
    sd, size = np.sqrt(np.diag(covariance)), float(drawn.settings["effective_size"])
    # Student's t for a normal density: a share of the draws that follows from their ratio, 0.9 in three dimensions.
    assert 0.7 * 6000 < size < 6000 and drawn.finished
    assert np.all(np.abs(drawn.flat.mean(axis=0) - mean) < 4.0 * sd / np.sqrt(size))
    np.testing.assert_allclose(drawn.flat.std(axis=0), sd, rtol=4.0 / np.sqrt(2.0 * size) + 0.01)
    np.testing.assert_allclose(np.cov(drawn.flat.T) / np.outer(sd, sd), covariance / np.outer(sd, sd), atol=0.1)
    np.testing.assert_allclose(drawn.log_density.ravel(), batched_log_density(PROBLEM)(drawn.flat), rtol=1e-12)


def test_weights_mend_a_proposal_that_is_off(found):
    """Shifted by one standard deviation, and half as wide again: the draws are those of the posterior all the same."""
    off = dataclasses.replace(found, mode=found.mode + found.factor[:, 0], covariance=2.25 * found.covariance)
    drawn = sample_importance(PROBLEM, off, seed=2, draws=2000, evaluations=8000)
    mean, covariance, _ = exact_posterior(PROBLEM)
    for index, sd in enumerate(np.sqrt(np.diag(covariance))):
        distance = stats.kstest(drawn.flat[:, index], stats.norm(mean[index], sd).cdf).statistic
        assert distance < 1.63 / np.sqrt(float(drawn.settings["effective_size"]))  # one percent
    assert drawn.finished


def test_a_proposal_that_misses_says_so(found):
    narrow = dataclasses.replace(found, mode=found.mode + 6.0 * found.sd, covariance=1e-3 * found.covariance)
    drawn = sample_importance(PROBLEM, narrow, seed=3, draws=100, evaluations=400)
    assert not drawn.finished and drawn.settings["pareto_shape"] > 0.7
    assert "the proposal misses part of the posterior" in drawn.message
    assert any("did not finish" in each for each in diagnose_draws(PROBLEM, drawn).complaints)


def test_a_posterior_that_is_cut_off_is_told(found):
    """Half of what the data allow has no density: smaller weights for all that, and a fine Pareto shape."""
    (measurement,) = PROBLEM.measurements
    limit = float(PROBLEM.values(jnp.asarray(found.mode))[0])

    def covered(model):
        return jnp.where(model.coefficients[0] < limit, measurement.predict(model), jnp.nan)

    problem = dataclasses.replace(PROBLEM, measurements=(dataclasses.replace(measurement, predict=covered),))
    drawn = sample_importance(problem, found, seed=5, draws=500, evaluations=2000)
    assert not drawn.finished
    assert "may be cut off" in drawn.message


@pytest.mark.parametrize("deviations", [0.0, 1.5])
def test_proposals_without_a_density_count_in_the_evidence_and_its_error(found, deviations):
    """Of a posterior of which a share is cut off, in forty repetitions: unbiased, with the scatter that is stated."""
    (measurement,) = PROBLEM.measurements
    mean, covariance, exact = exact_posterior(PROBLEM)
    limit = float(mean[0] + deviations * np.sqrt(covariance[0, 0]))

    def covered(model):
        return jnp.where(model.coefficients[0] < limit, measurement.predict(model), jnp.nan)

    problem = dataclasses.replace(PROBLEM, measurements=(dataclasses.replace(measurement, predict=covered),))
    expected = exact + stats.norm.logcdf(deviations)
    runs = [sample_importance(problem, found, seed=seed, draws=20, evaluations=400) for seed in range(40)]
    weighed = [importance_evidence(drawn) for drawn in runs]
    distances = np.array([(each.log_evidence - expected) / each.standard_error for each in weighed])
    assert all(float(drawn.settings["refused"]) > 0.02 for drawn in runs)
    assert abs(np.mean(distances)) < 4.0 / np.sqrt(40.0) and 0.7 < np.std(distances) < 1.4
    # Of n weights, zeros among them, that are worth m draws the mean has the relative variance 1 / m - 1 / n.
    for drawn, each in zip(runs, weighed, strict=True):
        expected_error = np.sqrt(1.0 / float(drawn.settings["effective_size"]) - 1.0 / 300.0)
        np.testing.assert_allclose(each.standard_error, expected_error, rtol=1e-9)


def test_draws_are_worth_what_their_weights_say(found):
    """Few weighted draws resampled many times are no better than few, in size and in error."""
    drawn = sample_importance(PROBLEM, found, seed=6, draws=2000, evaluations=160)
    size = float(drawn.settings["effective_size"])
    told = diagnose_draws(PROBLEM, drawn)
    assert size < 120.0
    for row in told.rows:
        assert row.bulk_size == size and row.mean_error == pytest.approx(row.sd / np.sqrt(size))
    assert any("tell too little" in each for each in told.complaints)
    assert not any("Chains do not agree" in each for each in told.complaints)


def test_rounds_are_added_until_draws_are_worth_enough(found):
    """A proposal that is shifted and narrow: more rounds, no more than allowed, and the moments within their errors."""
    off = dataclasses.replace(found, mode=found.mode + 2.0 * found.factor[:, 0], covariance=0.3 * found.covariance)
    rule = {"seed": 8, "draws": 2000, "evaluations": 400}
    one = sample_importance(PROBLEM, off, **rule)
    several = sample_importance(PROBLEM, off, most_evaluations=20_000, enough=2000.0, **rule)
    assert one.evaluations == 400 and float(one.settings["effective_size"]) < 250.0
    size = float(several.settings["effective_size"])
    assert several.finished and size >= 2000.0 and 2000 < several.evaluations < 10_000
    limited = sample_importance(PROBLEM, off, most_evaluations=1000, enough=2000.0, **rule)
    assert limited.evaluations == 1000 and float(limited.settings["effective_size"]) < 2000.0
    few = sample_importance(PROBLEM, found, seed=8, draws=100, most_evaluations=300)
    assert few.evaluations == 300
    mean, covariance, exact = exact_posterior(PROBLEM)
    sd = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(several.flat.mean(axis=0) - mean) < 4.0 * sd / np.sqrt(size))
    np.testing.assert_allclose(several.flat.std(axis=0), sd, rtol=4.0 / np.sqrt(2.0 * size) + 0.01)
    weighed = importance_evidence(several)
    assert abs(weighed.log_evidence - exact) < 4.0 * weighed.standard_error


def test_evidence_is_the_mean_weight(found):
    """Within four standard errors of that of the linear model."""
    drawn = sample_importance(PROBLEM, found, seed=7, draws=100, evaluations=8000)
    weighed, (*_, exact) = importance_evidence(drawn), exact_posterior(PROBLEM)
    assert weighed.standard_error < 0.02 and not weighed.warnings
    assert abs(weighed.log_evidence - exact) < 4.0 * weighed.standard_error


def test_a_proposal_with_no_density_at_all_is_refused(found):
    broken = dataclasses.replace(
        PROBLEM, measurements=(dataclasses.replace(PROBLEM.measurements[0], measured=np.full(12, np.nan)),)
    )
    with pytest.raises(InputError, match="0 of 200 proposals"):
        sample_importance(broken, found, seed=8, evaluations=800)


def test_a_study_by_importance_sampling():
    effort = Effort(starts=2, draws=200, chains=2, evaluations=1000, with_profiles=False)
    study = infer(PROBLEM, sampler=Sampler.IMPORTANCE, effort=effort, seed=4)
    assert study.draws is not None and study.draws.sampler == "importance sampling"
    again = infer(PROBLEM, sampler=Sampler.IMPORTANCE, effort=effort, seed=4)
    np.testing.assert_array_equal(again.draws.flat, study.draws.flat)
