"""Noise: each likelihood is that of the covariance or density that it stands for, written out without it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from arfjax import InputError
from inverse.inference.noise import NoiseModel, Series, unordered

RNG = np.random.default_rng(5)
N = 9
MEASURED = jnp.asarray(RNG.normal(10.0, 2.0, N))
PREDICTED = jnp.asarray(RNG.normal(10.0, 1.0, N))
# Two series of five and four, out of order, with unequal gaps; two groups with a reference each.
PREVIOUS = np.array([-1, 0, 3, 1, 2, -1, 5, 6, 7])
GAP = np.array([1.0, 1.0, 2.0, 1.0, 0.5, 1.0, 1.0, 3.0, 1.0])
SERIES = Series(jnp.asarray(np.geomspace(1.0, 50.0, N)), PREVIOUS, jnp.asarray(GAP), np.repeat([0, 1], [5, 4]), 2)


def covariance(noise: NoiseModel) -> np.ndarray:
    """By its definition, datum by datum."""
    known = 0.0 if noise.known is None else np.asarray(noise.known) * float(noise.scale)
    coordinate = np.asarray(SERIES.coordinate)
    deviation = np.sqrt(known**2 + float(noise.additive) ** 2 + (float(noise.relative) * np.asarray(PREDICTED)) ** 2)
    deviation = deviation * (coordinate / np.exp(np.mean(np.log(coordinate)))) ** float(noise.exponent)
    deviation = deviation * np.where(coordinate > noise.step_place, float(noise.step_ratio), 1.0)
    correlation = np.eye(N)
    for chain in ([0, 1, 3, 2, 4], [5, 6, 7, 8]):
        for a in range(len(chain)):
            for b in range(a + 1, len(chain)):
                distance = sum(GAP[chain[k]] for k in range(a + 1, b + 1))
                correlation[chain[a], chain[b]] = correlation[chain[b], chain[a]] = float(noise.correlation) ** distance
    full = correlation * np.outer(deviation, deviation)
    if noise.normalised:
        shared = float(noise.relative if noise.tie_reference else noise.reference_relative)
        same = SERIES.group[:, None] == SERIES.group[None, :]
        full = full + np.where(same, shared**2 * np.outer(PREDICTED, PREDICTED), 0.0)
    return full


NORMAL = [
    NoiseModel(additive=1.3),
    NoiseModel(relative=0.1),
    NoiseModel(known=jnp.asarray(RNG.uniform(0.5, 2.0, N)), scale=1.4, additive=0.2),
    NoiseModel(additive=1.0, exponent=0.4),
    NoiseModel(additive=1.0, step_ratio=3.0, step_place=7.0),
    NoiseModel(additive=1.0, correlation=0.6),
    NoiseModel(relative=0.1, tie_reference=True),
    NoiseModel(known=jnp.full(N, 0.7), correlation=0.3, reference_relative=0.05),
]


@pytest.mark.parametrize("noise", NORMAL, ids=str)
def test_normal_noise_has_the_density_of_its_covariance(noise):
    full = covariance(noise)
    expected = stats.multivariate_normal(np.asarray(PREDICTED), full).logpdf(np.asarray(MEASURED))
    np.testing.assert_allclose(noise.log_likelihood(MEASURED, PREDICTED, SERIES), expected, rtol=1e-10)


@pytest.mark.parametrize("noise", NORMAL, ids=str)
def test_residuals_are_the_whitened_ones(noise):
    difference = np.asarray(PREDICTED - MEASURED)
    expected = difference @ np.linalg.solve(covariance(noise), difference)
    found = noise.residuals(MEASURED, PREDICTED, SERIES)
    np.testing.assert_allclose(jnp.sum(found**2), expected, rtol=1e-10)


@pytest.mark.parametrize("noise", NORMAL, ids=str)
def test_draws_have_the_covariance(noise):
    """20 000 draws: entries within five standard errors of a sample covariance."""
    count = 20_000
    draw = jax.jit(jax.vmap(lambda key: noise.draw(key, PREDICTED, SERIES)))
    drawn = np.asarray(draw(jax.random.split(jax.random.key(3), count)))
    full = covariance(noise)
    error = np.sqrt((full**2 + np.outer(np.diag(full), np.diag(full))) / count)
    assert np.max(np.abs(np.cov(drawn.T) - full) / error) < 5.0
    np.testing.assert_allclose(drawn.mean(0), PREDICTED, atol=5.0 * np.sqrt(np.max(np.diag(full)) / count))


def test_student_t_of_independent_data():
    noise = NoiseModel(additive=1.5, degrees_of_freedom=4.0)
    expected = stats.t(4.0, np.asarray(PREDICTED), 1.5).logpdf(np.asarray(MEASURED)).sum()
    np.testing.assert_allclose(noise.log_likelihood(MEASURED, PREDICTED, unordered(N)), expected, rtol=1e-12)
    wide = NoiseModel(additive=1.5, degrees_of_freedom=1e7)
    normal = NoiseModel(additive=1.5).log_likelihood(MEASURED, PREDICTED, unordered(N))
    np.testing.assert_allclose(wide.log_likelihood(MEASURED, PREDICTED, unordered(N)), normal, rtol=1e-6)


def test_terms_add_up_to_the_whole_where_nothing_is_shared():
    noise = NoiseModel(additive=1.0, correlation=0.4)
    terms = noise.terms(MEASURED, PREDICTED, SERIES)
    np.testing.assert_allclose(jnp.sum(terms), noise.log_likelihood(MEASURED, PREDICTED, SERIES), rtol=1e-14)


@pytest.mark.parametrize("correlation", [0.0, 0.5])
def test_gradients_in_every_noise_parameter(correlation):
    """Reverse equals forward to 1e-10 and central differences to 1e-6, at zero correlation, too."""

    def likelihood(x):
        noise = NoiseModel(
            additive=x[0], relative=x[1], exponent=x[2], step_ratio=x[3], correlation=x[4], step_place=7.0,
            tie_reference=True,
        )  # fmt: skip
        return noise.log_likelihood(MEASURED, PREDICTED, SERIES)

    at = jnp.asarray([1.0, 0.1, 0.2, 1.5, correlation])
    reverse = jax.grad(likelihood)(at)
    np.testing.assert_allclose(reverse, jax.jacfwd(likelihood)(at), rtol=1e-10, atol=1e-12)
    if correlation > 0.0:
        step = 1e-5
        central = [
            (likelihood(at.at[k].add(step)) - likelihood(at.at[k].add(-step))) / (2.0 * step) for k in range(len(at))
        ]
        np.testing.assert_allclose(reverse, central, rtol=1e-6, atol=1e-6)
    assert np.all(np.isfinite(reverse))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "noise needs `known` standard deviations"),
        ({"additive": -1.0}, "`additive` of the noise must be"),
        ({"relative": 0.1, "tie_reference": True, "degrees_of_freedom": 4.0}, "no closed likelihood"),
    ],
)
def test_noise_that_is_none_is_refused(given, said):
    with pytest.raises(InputError, match=said):
        NoiseModel(**given)
