"""Many starts of Levenberg-Marquardt: minima found, disagreement and failure reported."""

import jax
import jax.numpy as jnp
import numpy as np

from inverse.least_squares import multi_start


def rosenbrock(u, _):
    return jnp.stack([10.0 * (u[1] - u[0] ** 2), 1.0 - u[0]])


def test_rosenbrock_from_every_start():
    starts = np.random.default_rng(0).normal(size=(12, 2))
    result = multi_start(rosenbrock, starts)
    assert result.converged and result.n_agreeing == 12
    np.testing.assert_allclose(result.solutions, np.ones((12, 2)), atol=1e-7)
    assert result.describe() == "converged; 12 of 12 starts reached this minimum"


def test_the_best_of_two_minima_is_taken():
    def two_wells(u, _):
        return jnp.stack([u[0] ** 2 - 1.0, 0.1 * (u[0] - 1.0)])

    result = multi_start(two_wells, np.array([[-1.5], [-0.7], [1.4]]))
    np.testing.assert_allclose(result.solutions[int(result.best)], [1.0], atol=1e-7)
    assert result.n_agreeing == 1 and result.costs[0] > 1e-3


def test_too_few_steps_are_reported():
    result = multi_start(rosenbrock, np.array([[-1.2, 1.0]]), max_steps=3)
    assert not result.converged and "largest number of steps" in result.describe()


def test_values_that_are_not_finite_are_reported_and_never_best():
    def broken_below(u, _):
        return jnp.where(u < 0.0, jnp.nan, u - 2.0)

    result = multi_start(broken_below, np.array([[-1.0], [1.0]]))
    assert int(result.status[0]) == 2 and np.isinf(result.costs[0])
    assert result.converged and result.n_agreeing == 1


def test_batches_of_data():
    def line(u, y):
        return u[0] + u[1] * jnp.arange(3.0) - y

    data = jnp.array([[1.0, 2.0, 3.0], [0.0, -2.0, -4.0]])
    result = jax.jit(jax.vmap(lambda y: multi_start(line, np.zeros((1, 2)), y)))(data)
    np.testing.assert_allclose(result.solutions[:, 0], [[1.0, 1.0], [0.0, -2.0]], atol=1e-7)
