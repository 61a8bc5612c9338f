"""Diagnostics on chains whose truth is known."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from inverse.sampling import compare, diagnose_draws, integrated_time, laplace, overlap_coefficient, sample_importance
from tests.inverse.sampling.conjugate import conjugate_problem, exact_posterior
from tests.inverse.sampling.test_evidence import exact_draws


def autoregressive(correlation, *, steps=20_000, walkers=8, n=2, seed=0):
    random = np.random.default_rng(seed)
    fresh = random.normal(size=(steps, walkers, n))
    chain = np.empty_like(fresh)
    chain[0] = fresh[0]
    for step in range(1, steps):
        chain[step] = correlation * chain[step - 1] + np.sqrt(1.0 - correlation**2) * fresh[step]
    return chain


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_autocorrelation_time_of_autoregressive_chains(correlation):
    exact = (1.0 + correlation) / (1.0 - correlation)
    np.testing.assert_allclose(integrated_time(autoregressive(correlation)), exact, rtol=0.05)


def test_a_walker_that_never_moved_has_no_autocorrelation_time():
    chain = autoregressive(0.5, steps=500)
    chain[:, :, 1] = 3.0
    times = integrated_time(chain)
    assert np.isfinite(times[0]) and times[1] == np.inf


@pytest.fixture(scope="module")
def problem():
    return conjugate_problem()


def test_the_table_of_good_draws(problem):
    mean, covariance, _ = exact_posterior(problem)
    found = diagnose_draws(problem, exact_draws(problem, correlation=0.5))
    assert found.sound and len(found.table) == 3 and len(found.columns) == len(found.table[0])
    for row, centre, sd in zip(found.rows, mean, np.sqrt(np.diag(covariance)), strict=True):
        assert abs(row.mean - centre) < 4.0 * row.mean_error and abs(row.sd - sd) < 4.0 * row.sd_error
        np.testing.assert_allclose([row.lower, row.upper], centre + sd * stats.norm.ppf([0.05, 0.95]), atol=0.15 * sd)
        assert row.unit == "m" and 1000 < row.bulk_size < 1700
        assert 2.0 < row.autocorrelation_time < 4.0
        np.testing.assert_allclose(row.mean_error, sd * np.sqrt(3.0 / 4000.0), rtol=0.25)
    assert {"5 %", "95 %", "R-hat"} <= set(found.columns)


def test_each_threshold_has_its_sentence(problem):
    good = exact_draws(problem)
    apart = good.unconstrained.copy()
    apart[0, :, 1] += 1.0
    said = diagnose_draws(problem, dataclasses.replace(good, unconstrained=apart)).complaints
    assert "Chains do not agree on coefficient_1: R-hat of coefficient_1 is" in said[0]
    assert "effective sample size of coefficient_1" in said[1]
    few = dataclasses.replace(good, unconstrained=good.unconstrained[:, :50], log_density=good.log_density[:, :50])
    assert "below 400" in " ".join(diagnose_draws(problem, few).complaints)
    diverging = np.zeros((4, 1000), dtype=bool)
    diverging[2, 7] = True
    one = dataclasses.replace(good, statistics={"diverging": diverging}, finished=False)
    assert diagnose_draws(problem, one).complaints[0].startswith("1 of 4000 trajectories diverged")
    assert "(`--target-acceptance`)" in diagnose_draws(problem, one).complaints[0]
    stuck = dataclasses.replace(good, unconstrained=np.broadcast_to(good.unconstrained[:, :1], (4, 1000, 3)).copy())
    assert not diagnose_draws(problem, stuck).sound


def test_a_single_draw_gives_a_table_without_errors(problem):
    good = exact_draws(problem)
    single = dataclasses.replace(good, unconstrained=good.unconstrained[:1, :1], log_density=good.log_density[:1, :1])
    found = diagnose_draws(problem, single)
    assert not found.sound and np.isnan(found.rows[0].r_hat) and np.isfinite(found.rows[0].mean)


def test_samplers_that_agree_and_one_that_does_not(problem):
    runs = {str(seed): exact_draws(problem, seed=seed, correlation=0.3) for seed in range(3)}
    found = compare(problem, runs)
    assert found.agree and np.all(found.distances[0] == 0.0)
    wider = runs["1"].unconstrained.mean(axis=(0, 1)) + 1.2 * (
        runs["1"].unconstrained - runs["1"].unconstrained.mean(axis=(0, 1))
    )
    other = compare(problem, {"0": runs["0"], "wide": dataclasses.replace(runs["1"], unconstrained=wider)})
    assert not other.agree and other.as_dict()["samplers"]["wide"]["values"]["coefficient_0"]["sd"]["distance"] > 5.0


def test_weighted_draws_are_compared_by_what_they_are_worth(problem):
    """Errors of resampled draws go with one over the root of their worth, and they agree with independent ones."""
    exact = exact_draws(problem, seed=0)
    weighted = sample_importance(problem, laplace(problem, n_starts=2), seed=3, draws=1000, evaluations=900)
    found = compare(problem, {"exact": exact, "weighted": weighted})
    worth = float(weighted.settings["effective_size"])
    sd = np.sqrt(np.diag(exact_posterior(problem)[1]))
    assert found.agree and found.sizes[1] == worth < 700.0
    # Of normal values; how dense draws lie about a quantile is known from about twenty of them.
    of_quantile = np.sqrt(0.05 * 0.95) / stats.norm.pdf(stats.norm.ppf(0.05))
    np.testing.assert_allclose(found.errors[1, :, 0], sd / np.sqrt(worth), rtol=0.15)
    np.testing.assert_allclose(found.errors[1, :, 1], sd / np.sqrt(2.0 * worth), rtol=0.25)
    np.testing.assert_allclose(np.log(found.errors[1, :, 2:].T * np.sqrt(worth) / (sd * of_quantile)), 0.0, atol=0.9)


@pytest.mark.parametrize("shift", [0.0, 1.0, 3.0])
def test_overlap_of_two_normal_densities(shift):
    random = np.random.default_rng(0)
    prior, posterior = random.normal(size=8000), shift + random.normal(size=8000)
    exact = 2.0 * stats.norm.cdf(-0.5 * shift)
    assert overlap_coefficient(prior, posterior) == pytest.approx(exact, abs=0.04)
    assert overlap_coefficient(np.exp(prior), np.exp(posterior)) == pytest.approx(exact, abs=0.04)
