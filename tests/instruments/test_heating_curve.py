"""Averaging and normalising against closed forms, and the covariance they leave against many draws."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.instruments.heating_curve import (
    moving_mean,
    moving_mean_covariance,
    normalised_covariance,
    normalised_curve,
)
from tests.checks import assert_gradient

TEMPERATURE = np.asarray([30.0, 34.0, 36.5, 41.0, 48.0, 60.0])
CURVE = np.asarray([10.0, 9.8, 9.7, 9.5, 10.4, 6.0])
REFERENCE = 37.0


def spread(n=6):
    """Errors of neighbours that depend on each other."""
    index = np.arange(n)
    return (
        0.02**2 * np.exp(-np.abs(index[:, None] - index[None, :]) / 1.5) * (1.0 + index[:, None] * index[None, :] / 9)
    )


def test_moving_mean_of_a_line_is_the_line():
    values = 3.0 + 0.5 * np.arange(40.0)
    np.testing.assert_allclose(moving_mean(values, 25), values[12:-12], rtol=1e-13)
    np.testing.assert_allclose(moving_mean(values, 1), values, rtol=0)
    np.testing.assert_allclose(moving_mean(np.stack([values, -values]), 40), [[12.75], [-12.75]], rtol=1e-13)


def test_moving_mean_lowers_independent_noise_by_the_root_of_the_number():
    covariance = np.asarray(moving_mean_covariance(0.3**2 * np.eye(60), 25))
    lag = np.abs(np.arange(36)[:, None] - np.arange(36)[None, :])
    np.testing.assert_allclose(covariance, 0.3**2 / 25.0 * np.maximum(1.0 - lag / 25.0, 0.0), atol=1e-15)


def test_normalised_curve_is_one_at_the_reference():
    curve = np.asarray(normalised_curve(TEMPERATURE, CURVE, reference_temperature=REFERENCE))
    np.testing.assert_allclose(np.interp(REFERENCE, TEMPERATURE, curve), 1.0, rtol=1e-14)
    np.testing.assert_allclose(curve, CURVE / np.interp(REFERENCE, TEMPERATURE, CURVE), rtol=1e-14)
    for index, at in enumerate(TEMPERATURE):
        np.testing.assert_allclose(normalised_curve(TEMPERATURE, CURVE, reference_temperature=at)[index], 1.0)


def test_covariance_of_the_normalised_curve():
    """Against its own derivative, and the reference, which is 1, has no error."""
    found = np.asarray(normalised_covariance(TEMPERATURE, CURVE, spread(), reference_temperature=REFERENCE))
    slopes = jax.jacfwd(lambda y: normalised_curve(TEMPERATURE, y, reference_temperature=REFERENCE))(jnp.asarray(CURVE))
    np.testing.assert_allclose(found, slopes @ spread() @ slopes.T, rtol=1e-10, atol=1e-18)
    at_reading = np.asarray(normalised_covariance(TEMPERATURE, CURVE, spread(), reference_temperature=41.0))
    np.testing.assert_allclose(at_reading[3], 0.0, atol=1e-18)


def test_covariance_against_many_draws():
    """Averaged over three, then normalised: four standard errors of each entry of 40000 draws."""
    n_draws, rng = 40_000, np.random.default_rng(4)
    raw = rng.multivariate_normal(CURVE, spread(), size=n_draws)
    temperature = np.asarray(moving_mean(TEMPERATURE, 3))
    curves = np.asarray(
        jax.vmap(lambda y: normalised_curve(temperature, y, reference_temperature=REFERENCE))(moving_mean(raw, 3))
    )
    covariance = moving_mean_covariance(spread(), 3)
    expected = np.asarray(
        normalised_covariance(temperature, moving_mean(CURVE, 3), covariance, reference_temperature=REFERENCE)
    )
    sd = np.sqrt(np.diag(expected))
    standard_error = np.sqrt((np.outer(sd, sd) ** 2 + expected**2) / n_draws)
    # The second order in the reference's relative error of 0.2 % is far below that.
    assert np.all(np.abs(np.cov(curves.T) - expected) < 4.0 * standard_error)
    correlation = expected / np.outer(sd, sd)
    assert np.abs(correlation - np.diag(np.diag(correlation))).max() > 0.3


def test_gradient():
    def total(values):
        temperature, curve, reference, covariance = values
        shown = normalised_curve(temperature, curve, reference_temperature=reference)
        errors = normalised_covariance(temperature, curve, covariance, reference_temperature=reference)
        return jnp.sum(moving_mean(shown, 2) ** 2) + 1e3 * jnp.sum(jnp.sin(jnp.arange(36.0)).reshape(6, 6) * errors)

    assert_gradient(total, (TEMPERATURE, CURVE, REFERENCE, spread()))


def test_batches_agree_with_one_by_one():
    curves = jnp.stack([jnp.asarray(CURVE), jnp.asarray(CURVE) ** 2])
    batched = jax.jit(jax.vmap(lambda y: normalised_curve(TEMPERATURE, y, reference_temperature=REFERENCE)))(curves)
    single = [normalised_curve(TEMPERATURE, each, reference_temperature=REFERENCE) for each in curves]
    np.testing.assert_allclose(batched, single, rtol=1e-13)


@pytest.mark.parametrize(
    ("temperature", "curve", "reference", "cause"),
    [
        (TEMPERATURE, CURVE[:-1], REFERENCE, "of one length, 2 or more, got 6 and 5"),
        (TEMPERATURE[::-1], CURVE, REFERENCE, "`temperature` must ascend"),
        (np.where(TEMPERATURE > 50.0, np.nan, TEMPERATURE), CURVE, REFERENCE, "`temperature` must ascend"),
        (TEMPERATURE, CURVE, 310.15, "Kelvin? Pass degC"),
        (TEMPERATURE, CURVE, np.nan, "`reference_temperature` is nan degC"),
    ],
)
def test_impossible_curves(temperature, curve, reference, cause):
    with pytest.raises(InputError) as error:
        normalised_curve(temperature, curve, reference_temperature=reference)
    assert cause in str(error.value) and "\n" not in str(error.value)


def test_impossible_averages_and_covariances():
    with pytest.raises(InputError, match="`n_averaged` must lie in 1 to 6, the number of values, got 7"):
        moving_mean(CURVE, 7)
    with pytest.raises(InputError, match="got 0"):
        moving_mean(CURVE, 0)
    with pytest.raises(InputError, match=r"`covariance` has shape \(5, 5\) for 6 readings"):
        normalised_covariance(TEMPERATURE, CURVE, spread(5), reference_temperature=REFERENCE)
