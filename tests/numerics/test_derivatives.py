"""A forward derivative that is taken by reverse mode."""

import jax
import jax.numpy as jnp
import numpy as np

from arfjax.numerics.derivatives import forward_by_reverse
from tests.checks import assert_gradient


def energy(argument):
    x, scale = argument
    return scale * jnp.sum(jnp.sin(x) ** 2) + x[0] ** 3


ARGUMENT = (jnp.asarray([0.3, -1.2, 2.0]), jnp.asarray(1.7))


def test_value_and_derivatives_are_those_of_the_function():
    assert_gradient(forward_by_reverse(energy), ARGUMENT)
    for derivative in (jax.jacfwd, jax.jacrev):
        for wrapped, plain in zip(
            derivative(forward_by_reverse(energy))(ARGUMENT), derivative(energy)(ARGUMENT), strict=True
        ):
            np.testing.assert_allclose(wrapped, plain, rtol=1e-14)


def test_whole_numbers_are_numbers():
    x, two = jnp.asarray([0.3, -1.2, 2.0]), jnp.asarray(2)
    of_x = forward_by_reverse(energy)
    np.testing.assert_allclose(jax.jacfwd(lambda x: of_x((x, 2)))(x), jax.grad(lambda x: energy((x, 2.0)))(x))
    np.testing.assert_allclose(jax.jacfwd(lambda x: of_x((x, two)))(x), jax.grad(lambda x: energy((x, 2.0)))(x))


def test_the_gradient_is_computed_once_for_all_tangents():
    count = 0

    def counted(x):
        nonlocal count
        count += 1
        return energy((x, 1.0))

    jax.jacfwd(forward_by_reverse(counted))(ARGUMENT[0])
    assert count == 1  # traced once, for value and gradient together
