"""Problems whose predictions are long computations: what is driven from one gradient agrees with what is compiled."""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import FractionalZener, complex_modulus
from inverse.datasets.dma import dma_data, group_sweeps
from inverse.inference import profile as refits
from inverse.inference.audit import Kind, audit
from inverse.inference.compiled import cost_of, cost_of_values, log_density_of, log_likelihood_of
from inverse.inference.curvature import cost_curvature, data_curvature
from inverse.inference.dma import dma_problem
from inverse.inference.fit import Method, fit
from inverse.inference.problem import Problem
from inverse.inference.profile import profile

FREQUENCY = np.geomspace(0.5, 80.0, 12)
CONSTANTS = FractionalZener(900.0, 6000.0, 0.02, 0.4)


def sweep_problem(*, is_long: bool, estimate_noise: bool = True) -> Problem:
    """Constants of a simulated sweep, with unknown noise or noise of two percent."""
    modulus = np.asarray(complex_modulus(CONSTANTS, jnp.asarray(2.0 * np.pi * FREQUENCY)))
    scatter = 0.02 * np.random.default_rng(3).standard_normal((2, 12))
    modulus = modulus * np.exp(scatter[0] + 1j * scatter[1])
    data = dma_data(FREQUENCY, np.full(12, 37.0), np.stack([modulus.real, modulus.imag], axis=1))
    problem = dma_problem(group_sweeps(data), estimate_noise=estimate_noise)
    (measurement,) = problem.measurements
    return eqx.tree_at(lambda p: p.measurements, problem, (dataclasses.replace(measurement, is_long=is_long),))


LONG, SHORT = (sweep_problem(is_long=each) for each in (True, False))


@pytest.fixture(scope="module")
def found():
    return fit(LONG, n_starts=4)


@pytest.fixture(scope="module")
def usual():
    return fit(SHORT, n_starts=4)


@pytest.mark.parametrize("composed, direct", [(cost_of, "cost"), (log_density_of, "log_density")])
def test_objectives_are_put_together_rightly(composed, direct):
    u = np.asarray(SHORT.start) + 0.1
    value, slope = composed(SHORT)(u)
    expected, gradient = jax.value_and_grad(getattr(SHORT, direct))(jnp.asarray(u))
    np.testing.assert_allclose(value, expected, rtol=1e-12)
    np.testing.assert_allclose(slope, gradient, rtol=1e-10)


@pytest.mark.parametrize("composed, direct", [(cost_of_values, "cost_of"), (log_likelihood_of, "log_likelihood_of")])
def test_objectives_in_the_values(composed, direct):
    values = np.asarray(SHORT.values(SHORT.start + 0.1))
    value, slope = composed(SHORT)(values)
    expected, gradient = jax.value_and_grad(getattr(SHORT, direct))(jnp.asarray(values))
    np.testing.assert_allclose(value, expected, rtol=1e-12)
    np.testing.assert_allclose(slope, gradient, rtol=1e-10)


def test_no_density_is_minus_infinity():
    value, _ = log_density_of(SHORT)(np.full(5, 1e4))
    assert value == -np.inf


def test_curvatures_by_differences_are_those_by_derivatives(usual):
    scale = np.outer(usual.values, usual.values)
    for curvature in (cost_curvature, data_curvature):
        exact, differences = (curvature(each, usual.values) * scale for each in (SHORT, LONG))
        np.testing.assert_allclose(differences, exact, rtol=1e-6, atol=1e-7 * np.max(np.abs(exact)))


def test_the_fit_is_the_same(found, usual):
    assert found.method is Method.NEWTON and usual.method is Method.BFGS
    assert found.converged and found.starts.n_agreeing >= 2
    np.testing.assert_allclose(found.values, usual.values, rtol=1e-5)
    np.testing.assert_allclose(found.cost, usual.cost, rtol=1e-10)
    np.testing.assert_allclose(found.uncertainty.standard_errors, usual.uncertainty.standard_errors, rtol=1e-4)


def test_a_limit_of_steps_is_kept_and_told():
    few = fit(LONG, n_starts=2, max_steps=2)
    assert np.max(few.starts.steps) <= 2 and not few.converged
    assert "stopped at the largest number of steps" in few.status
    assert audit(few).of(Kind.CONVERGENCE)


def test_the_audit_says_the_same(found, usual):
    ours, theirs = audit(found).identification, audit(usual).identification
    assert ours.rank == theirs.rank
    np.testing.assert_allclose(ours.condition_number, theirs.condition_number, rtol=1e-3)


def test_a_profile_ends_at_the_same_places(found, usual):
    ours, theirs = (profile(each, "fractional_order") for each in (found, usual))
    assert ours.stops == theirs.stops
    np.testing.assert_allclose(ours.interval, theirs.interval, rtol=1e-3)


def of_one_step(method):
    """A search that is stopped after its first step."""
    return functools.partial(method, max_steps=1)


@pytest.mark.parametrize("driven", ["descend", pytest.param("multi_start", marks=pytest.mark.slow)])
def test_a_profile_whose_fits_stopped_early_says_so(driven, monkeypatch):
    """Refits after one step cost too much: the interval shrinks, and a reader is told."""
    problem = sweep_problem(is_long=driven == "descend", estimate_noise=False)
    whole = fit(problem, n_starts=4)
    sound = profile(whole, "fractional_order")
    assert sound.converged and not sound.warnings
    jax.clear_caches()
    monkeypatch.setattr(refits, driven, of_one_step(getattr(refits, driven)))
    short = profile(whole, "fractional_order")
    jax.clear_caches()
    assert not short.converged and min(short.unfinished) > 0
    assert np.ptp(short.interval) < 0.95 * np.ptp(sound.interval)
    assert "fits of the other constants on the lower side did not converge" in short.warnings[0]
    assert all("did not converge" in said for said in short.ends)
