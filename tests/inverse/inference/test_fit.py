"""Fits: closed forms, agreement of the methods, bounds that bind, and outcomes that are told."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import FractionalZener, InputError, complex_modulus
from inverse.datasets.dma import dma_data, group_sweeps
from inverse.inference.dma import dma_problem
from inverse.inference.fit import Method, _ends, fit, judge
from inverse.inference.noise import NoiseModel, unordered
from inverse.inference.parameter_set import ParameterSet, parameter
from inverse.inference.problem import Measurement, Problem
from inverse.least_squares import MultiStart
from inverse.priors import Normal, Uniform
from inverse.transforms import Identity, Interval, LogInterval, Positive

RNG = np.random.default_rng(8)
X = np.linspace(-1.0, 2.0, 12)
DESIGN = np.stack([np.ones(12), X], axis=1)
DATA = DESIGN @ [1.0, -0.7] + 0.3 * RNG.standard_normal(12)


def line(*, priors: bool = False, noise_is_free: bool = False) -> Problem:
    """Data on a straight line, whose fit has a closed form."""
    prior = Normal(0.5, 0.2) if priors else None
    entries = [parameter("offset", "model.offset", "m", prior), parameter("slope", "model.slope", "1")]
    if noise_is_free:
        entries.append(parameter("noise", "noise.line.additive", "m", transform=Positive(0.5)))
    measured = Measurement(
        "line",
        lambda model: model["offset"] + model["slope"] * jnp.asarray(X),
        jnp.asarray(DATA),
        unordered(12),
        NoiseModel(additive=0.3),
        "m",
    )
    return Problem(ParameterSet(tuple(entries)), {"offset": 0.0, "slope": 0.0}, (measured,))


@pytest.mark.parametrize(
    "method", [Method.LEVENBERG_MARQUARDT, Method.DOGLEG, Method.BFGS, Method.L_BFGS_B, Method.NEWTON]
)
def test_straight_line_in_closed_form(method):
    found = fit(line(), method=method, n_starts=3)
    normal = DESIGN.T @ DESIGN
    np.testing.assert_allclose(found.values, np.linalg.solve(normal, DESIGN.T @ DATA), rtol=1e-6)
    np.testing.assert_allclose(found.uncertainty.covariance, 0.09 * np.linalg.inv(normal), rtol=1e-6)
    assert found.converged and found.starts.n_agreeing == 3


def test_a_prior_counts_as_a_datum():
    found = fit(line(priors=True), n_starts=2)
    precision = DESIGN.T @ DESIGN / 0.09 + np.diag([1.0 / 0.04, 0.0])
    expected = np.linalg.solve(precision, DESIGN.T @ DATA / 0.09 + np.array([0.5 / 0.04, 0.0]))
    np.testing.assert_allclose(found.values, expected, rtol=1e-8)
    np.testing.assert_allclose(found.uncertainty.covariance, np.linalg.inv(precision), rtol=1e-8)


def test_unknown_noise_has_its_maximum_likelihood():
    """Root of the mean square of what is left, with the relative standard error 1 / sqrt(2 n) of a deviation."""
    found = fit(line(noise_is_free=True), n_starts=3)
    best = np.linalg.lstsq(DESIGN, DATA, rcond=None)[0]
    deviation = np.sqrt(np.mean((DATA - DESIGN @ best) ** 2))
    np.testing.assert_allclose(found.values, [*best, deviation], rtol=1e-6)
    np.testing.assert_allclose(found.uncertainty.standard_errors[2], deviation / np.sqrt(24.0), rtol=1e-5)
    assert found.method is Method.BFGS


def test_errors_scaled_by_what_is_left():
    found = fit(line(), n_starts=2, scale_errors=True)
    left = DATA - DESIGN @ found.values
    expected = left @ left / 10.0 * np.linalg.inv(DESIGN.T @ DESIGN)
    np.testing.assert_allclose(found.uncertainty.covariance, expected, rtol=1e-6)


def test_a_bound_that_binds_is_reached_and_named():
    """The slope of the data is -0.7: of slopes above -0.2 the best is -0.2, with the offset that goes with it."""
    problem = line()
    bounded = parameter("slope", "model.slope", "1", transform=Interval(-0.2, 3.0))
    problem = problem.with_parameters(ParameterSet((problem.parameters.entries[0], bounded)))
    found = fit(problem, method=Method.L_BFGS_B, n_starts=3)
    offset = np.mean(DATA + 0.2 * X)
    np.testing.assert_allclose(found.values, [offset, -0.2], rtol=1e-6)
    assert found.ends == (None, "lower") and found.converged
    # Of the offset alone, because the slope stays where it is.
    np.testing.assert_allclose(found.uncertainty.standard_errors[0], 0.3 / np.sqrt(12.0), rtol=1e-6)
    assert "ran to the lower end of its range" in found.uncertainty.not_identified["slope"]


def test_only_what_lies_on_its_bound_is_said_to():
    """Values whose sizes differ by powers of ten: a share of 0.3 and a time of half a millisecond are no bounds."""
    entries = (
        parameter("size", "model.size", "Pa", transform=Positive(1e9)),
        parameter("share", "model.share", "1", transform=Positive(1.0)),
        parameter("time", "model.time", "s", transform=LogInterval(1e-9, 1e6)),
        parameter("order", "model.order", "1", transform=Interval(0.0, 1.0)),
        parameter("free", "model.free", "1", transform=Identity()),
    )
    problem = Problem(ParameterSet(entries), {entry.name: 0.5 for entry in entries}, ())
    none = MultiStart(np.zeros((1, 5)), np.zeros(1), np.zeros(1, int), np.zeros(1, int))

    def ends(*values):
        return _ends(problem, none, np.array(values), Method.L_BFGS_B)

    assert ends(2e9, 0.3, 5e-4, 0.5, 0.0) == [None] * 5
    assert ends(0.0, 1e-12, 1e-9 * (1.0 + 1e-12), 1e-12, -1e9) == ["lower"] * 4 + [None]
    assert ends(1e12, 1e12, 1e6 * (1.0 - 1e-12), 1.0 - 1e-12, 1e9) == [None, None, "upper", "upper", None]


def test_methods_that_do_not_go_with_the_problem_are_refused():
    with pytest.raises(InputError, match="`dogleg` needs a sum of squares"):
        fit(line(noise_is_free=True), method=Method.DOGLEG)
    with pytest.raises(InputError, match="`scale_errors` goes with sums of squares without priors"):
        fit(line(priors=True), scale_errors=True)


def test_values_of_someone_else_are_judged():
    best = fit(line(), n_starts=2)
    assert judge(line(), best.values).converged
    assert not judge(line(), best.values + 0.1).converged
    with pytest.raises(InputError, match="values to be judged must be 2 single numbers .offset, slope., got 3"):
        judge(line(), np.zeros(3))


def test_data_without_a_number_are_refused():
    problem = line()
    noise = NoiseModel(additive=1.0)
    broken = Measurement("line", problem.measurements[0].predict, jnp.full(12, jnp.nan), unordered(12), noise)
    with pytest.raises(InputError, match="the cost is not a number at any start"):
        fit(Problem(problem.parameters, problem.model, (broken,)))


def test_constants_of_a_solid_come_back_from_its_moduli():
    """Exact data: the constants to the solver's tolerance, whatever the start."""
    frequency = np.geomspace(0.1, 100.0, 25)
    truth = FractionalZener(2e3, 9e3, 0.08, 0.6)
    modulus = np.asarray(complex_modulus(truth, 2.0 * np.pi * frequency))
    sweeps = group_sweeps(dma_data(frequency, np.full(25, 37.0), np.stack([modulus.real, modulus.imag], axis=1)))
    found = fit(dma_problem(sweeps, estimate_noise=False, with_priors=False))
    np.testing.assert_allclose(found.values, [2e3, 7e3, 0.08, 0.6], rtol=1e-6)
    assert found.starts.n_agreeing >= 8


def test_uniform_priors_do_not_pull():
    """The penalised fit does not depend on the transform: a flat prior leaves the maximum of the likelihood."""
    problem = line()
    flat = parameter("slope", "model.slope", "1", Uniform(-5.0, 5.0))
    found = fit(problem.with_parameters(ParameterSet((problem.parameters.entries[0], flat))), n_starts=2)
    np.testing.assert_allclose(found.values, np.linalg.lstsq(DESIGN, DATA, rcond=None)[0], rtol=1e-6)
