"""Logarithms of p-values against closed forms and integrals, where a p-value itself is no float."""

import numpy as np
import pytest
from scipy import special, stats

from inverse.diagnosis.tails import log_p_of_one_variance, log_p_of_t


@pytest.mark.parametrize("freedom", [1, 2, 7, 60, 500, 5000])
def test_where_the_p_value_is_a_float(freedom):
    t = np.array([0.0, 0.3, 2.0, 5.0, 20.0])
    np.testing.assert_allclose(log_p_of_t(t, freedom), stats.t.logsf(t, freedom), rtol=1e-12)


@pytest.mark.parametrize("t", [1e80, 1e120])
def test_four_degrees_of_freedom(t):
    """Far out the density is C t^-5 with C = 4^(5/2) Gamma(5/2) / (sqrt(4 pi) Gamma(2)), and the tail C t^-4 / 4."""
    constant = 4.0**2.5 * special.gamma(2.5) / (np.sqrt(4.0 * np.pi) * special.gamma(2.0)) / 4.0
    assert log_p_of_t(np.array([t]), 4)[0] == pytest.approx(np.log(constant) - 4.0 * np.log(t), rel=1e-12)


@pytest.mark.parametrize(("t", "freedom"), [(300.0, 500), (50.0, 5000), (80.0, 500), (1e3, 140)])
def test_against_the_integral_of_the_density(t, freedom):
    """Gauss-Laguerre in the logarithm of t, beyond which the density falls as its power."""
    fall = freedom * t**2 / (freedom + t**2)
    nodes, weights = special.roots_laguerre(60)
    beyond = t * np.exp(nodes / fall)
    terms = stats.t.logpdf(beyond, freedom) + np.log(beyond / fall) + nodes + np.log(weights)
    assert log_p_of_t(np.array([t]), freedom)[0] == pytest.approx(special.logsumexp(terms), rel=1e-9)


def test_it_goes_on_smoothly_where_tables_end():
    t = np.geomspace(10.0, 1e4, 4000)
    slope = np.diff(log_p_of_t(t, 300)) / np.diff(np.log(t))
    assert np.all(np.diff(slope) < 1e-6) and np.all(np.isfinite(slope))


def test_one_variance():
    gain = np.array([0.0, 0.5, 10.0, 600.0])
    np.testing.assert_allclose(log_p_of_one_variance(gain), stats.chi2.logsf(gain, 1), rtol=1e-10)
    assert log_p_of_one_variance(np.array([4000.0]))[0] == pytest.approx(-2000.0 - 0.5 * np.log(2e3 * np.pi), abs=1e-3)
