"""Transforms: inverse of one another, inside their bounds, with the derivative that they claim."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inverse.parameters import Parameter, constrain, unconstrain
from inverse.transforms import Identity, Interval, LogInterval, Positive, Simplex

TRANSFORMS = [Identity(), Positive(), Positive(3e9), Interval(0.0, 1.0), Interval(-4.0, 7.0), LogInterval(1e-9, 1e6)]
U = np.linspace(-6.0, 6.0, 25)


@pytest.mark.parametrize("transform", TRANSFORMS, ids=str)
def test_round_trip_and_derivative(transform):
    values = jax.vmap(transform.forward)(U)
    np.testing.assert_allclose(jax.vmap(transform.inverse)(values), U, rtol=1e-9, atol=1e-9)
    assert np.all(np.diff(values) > 0.0)
    slope = jax.vmap(jax.grad(transform.forward))(U)
    np.testing.assert_allclose(jax.vmap(transform.log_derivative)(U), jnp.log(slope), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("transform", "bounds"), [(Interval(-4.0, 7.0), (-4, 7)), (LogInterval(1e-9, 1e6), (1e-9, 1e6))]
)
def test_values_far_out_stay_within_bounds(transform, bounds):
    values = np.array([transform.forward(u) for u in (-800.0, -40.0, 40.0, 800.0)])
    assert np.all((values >= bounds[0] * (1.0 - 1e-12 * np.sign(bounds[0]))) & (values <= bounds[1] * (1.0 + 1e-12)))


@pytest.mark.parametrize("transform", [Positive(2.0), Interval(0.0, 1.0), LogInterval(1e-3, 1e3)])
def test_ends_are_named(transform):
    assert [transform.end(u) for u in (-60.0, 0.0, 60.0)] == ["lower", None, "upper"]
    assert Identity().end(1e9) is None


def test_vectors_of_parameters():
    parameters = (Parameter("a", "Pa", Positive(10.0)), Parameter("b", "1", Interval(0.0, 1.0)))
    values = constrain(parameters, jnp.array([0.0, 0.0]))
    np.testing.assert_allclose(values, [10.0, 0.5])
    np.testing.assert_allclose(unconstrain(parameters, values), [0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize(
    ("transform", "inside", "beyond"),
    [
        # A millionth of the scale, or a million times it.
        (Positive(2.0), (2.0 * 1.5e-6, 2.0 / 1.5e-6), (2.0 * 0.7e-6, 2.0 / 0.7e-6)),
        # A millionth of the width, of 4.
        (Interval(-1.0, 3.0), (-1.0 + 6e-6, 3.0 - 6e-6), (-1.0 + 2.8e-6, 3.0 - 2.8e-6)),
        # Two percent of eight powers of ten.
        (LogInterval(1e-4, 1e4), (1e-4 * 10.0**0.2, 1e4 * 10.0**-0.2), (1e-4 * 10.0**0.12, 1e4 * 10.0**-0.12)),
    ],
)
def test_an_end_begins_where_the_range_is_used_up(transform, inside, beyond):
    assert [transform.end(float(transform.inverse(value))) for value in inside] == [None, None]
    assert [transform.end(float(transform.inverse(value))) for value in beyond] == ["lower", "upper"]


def test_shares_take_one_number_fewer():
    """Between two numbers, so that what comes after is still read at its own place."""
    parameters = (
        Parameter("a", "Pa", Positive(10.0)),
        Parameter("shares", "1", Simplex(3)),
        Parameter("b", "1", Interval(0.0, 1.0)),
    )
    values = jnp.array([20.0, 0.2, 0.5, 0.3, 0.25])
    u = unconstrain(parameters, values)
    assert u.shape == (4,)
    np.testing.assert_allclose(u[jnp.array([0, 3])], [np.log(2.0), np.log(0.25 / 0.75)], rtol=1e-12)
    np.testing.assert_allclose(constrain(parameters, u), values, rtol=1e-12)
    with pytest.raises(ValueError, match="these parameters have 5 values, got 6"):
        unconstrain(parameters, jnp.ones(6))
