"""Priors: densities that integrate to one, quantiles that agree with them, and transforms onto their support."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from arfjax import InputError
from inverse.priors import Dirichlet, HalfNormal, LogNormal, LogUniform, Normal, Uniform
from inverse.transforms import Simplex

PRIORS = [
    Normal(3.0, 0.5),
    LogNormal(2e3, 0.7),
    Uniform(-1.0, 4.0),
    LogUniform(1e-3, 1e2),
    HalfNormal(0.4),
]
SHARES = jnp.linspace(0.02, 0.98, 13)


@pytest.mark.parametrize("prior", PRIORS, ids=lambda prior: type(prior).__name__)
def test_quantiles_are_those_of_the_density(prior):
    """The density integrated between two quantiles is the difference of their shares."""
    ends = np.asarray(prior.quantile(SHARES))
    for low, high, share in zip(ends, ends[1:], np.diff(SHARES), strict=False):
        found, _ = quad(lambda value: float(jnp.exp(prior.log_density(value))), low, high, epsabs=0.0, epsrel=1e-10)
        np.testing.assert_allclose(found, share, rtol=1e-8)


@pytest.mark.parametrize("prior", PRIORS, ids=lambda prior: type(prior).__name__)
def test_density_of_unconstrained_numbers_integrates_to_one(prior):
    def density(u):
        value = prior.transform.forward(u)
        return float(jnp.exp(prior.log_density(value) + prior.transform.log_derivative(u)))

    found, _ = quad(density, -40.0, 40.0, points=[-3.0, 0.0, 3.0], limit=400)
    np.testing.assert_allclose(found, 1.0, rtol=1e-7)


def test_nothing_outside_the_support():
    for prior, outside in ((Uniform(0.0, 1.0), 1.1), (LogUniform(1.0, 2.0), 0.9), (HalfNormal(1.0), -0.1)):
        assert prior.log_density(outside) == -jnp.inf


def test_penalty_is_the_standardised_distance():
    assert float(Normal(3.0, 0.5).penalty(4.0)) == 2.0
    np.testing.assert_allclose(LogNormal(10.0, 0.5).penalty(10.0 * np.exp(1.0)), 2.0, rtol=1e-14)
    assert float(Uniform(0.0, 1.0).penalty(0.3)) == 0.0


@pytest.mark.parametrize("prior", PRIORS, ids=lambda prior: type(prior).__name__)
def test_draws_follow_the_density(prior):
    """The share of 4000 draws below each decile, within five binomial standard deviations."""
    drawn = np.asarray(jax.vmap(prior.draw)(jax.random.split(jax.random.key(1), 4000)))
    deciles = jnp.linspace(0.1, 0.9, 9)
    below = np.mean(drawn[:, None] < np.asarray(prior.quantile(deciles))[None, :], axis=0)
    assert np.all(np.abs(below - deciles) < 5.0 * np.sqrt(deciles * (1.0 - deciles) / 4000))


def test_shares_of_a_whole():
    transform = Simplex(4)
    np.testing.assert_allclose(transform.forward(jnp.zeros(3)), 0.25, rtol=1e-14)
    u = jnp.asarray([0.3, -1.2, 2.0])
    shares = transform.forward(u)
    np.testing.assert_allclose(jnp.sum(shares), 1.0, rtol=1e-14)
    np.testing.assert_allclose(transform.inverse(shares), u, rtol=1e-12)
    slope = jax.jacfwd(lambda each: transform.forward(each)[:-1])(u)
    np.testing.assert_allclose(transform.log_derivative(u), jnp.linalg.slogdet(slope)[1], rtol=1e-12)
    drawn = jax.vmap(Dirichlet(jnp.asarray([1.0, 2.0, 5.0])).draw)(jax.random.split(jax.random.key(0), 2000))
    np.testing.assert_allclose(jnp.mean(drawn, axis=0), np.array([1.0, 2.0, 5.0]) / 8.0, atol=0.02)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Normal(0.0, 0.0), "`sd` of a prior must be positive"),
        (lambda: LogNormal(-2.0, 1.0), "`median` of a prior must be positive"),
        (lambda: Uniform(2.0, 1.0), "`lower` must be below its `upper`"),
        (lambda: LogUniform(0.0, 1.0), "`lower` of a prior must be positive"),
    ],
)
def test_impossible_priors_are_refused(make, said):
    with pytest.raises(InputError, match=said):
        make()


def test_penalty_of_a_spread_is_in_units_of_its_scale():
    """Minus the logarithm of the half-normal density rises by half of its square."""
    prior = HalfNormal(0.4)
    rise = prior.log_density(0.0) - prior.log_density(1.0)
    np.testing.assert_allclose(0.5 * prior.penalty(1.0) ** 2, rise, rtol=1e-12)


def test_density_of_shares():
    concentration, shares = np.array([2.0, 3.0, 1.5]), np.array([0.2, 0.5, 0.3])
    found = Dirichlet(jnp.asarray(concentration)).log_density(jnp.asarray(shares))
    np.testing.assert_allclose(found, stats.dirichlet(concentration).logpdf(shares), rtol=1e-12)


@pytest.mark.parametrize(
    ("prior", "said"),
    [
        (Normal(3.0, 0.5), "normal, 3 ± 0.5 Pa"),
        (LogNormal(2e3, 0.7), "log-normal, median 2000 Pa, standard deviation of its logarithm 0.7"),
        (Uniform(-1.0, 4.0), "uniform from -1 to 4 Pa"),
        (LogUniform(1e-3, 1e2), "log-uniform from 0.001 to 100 Pa"),
        (HalfNormal(0.4), "half-normal, scale 0.4 Pa"),
    ],
)
def test_what_a_table_says_of_a_prior(prior, said):
    assert prior.describe("Pa") == said
