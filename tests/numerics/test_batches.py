"""A function mapped in batches gives what it gives for each element, and is compiled once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.numerics.batches import map_in_batches


def _wave(argument):
    scale, points = argument
    return {"sum": jnp.sum(jnp.sin(scale * points)), "each": jnp.cos(scale * points)}


def _elements(count):
    rng = np.random.default_rng(count)
    return jnp.asarray(rng.normal(size=count)), jnp.asarray(rng.normal(size=(count, 3)))


@pytest.mark.parametrize(("count", "at_once"), [(0, 4), (1, 4), (4, 4), (5, 4), (11, 4), (12, 4), (57, 20)])
def test_batches_give_what_each_element_gives(count, at_once):
    elements = _elements(count)
    found, expected = map_in_batches(_wave, elements, at_once), jax.vmap(_wave)(elements)
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert one.shape == other.shape
        # Sums of three numbers below one may cancel.
        np.testing.assert_allclose(one, other, rtol=1e-14, atol=1e-15)


def test_derivatives_do_not_know_of_what_fills_the_last_batch():
    scale, points = _elements(11)

    def total(scale):
        return jnp.sum(map_in_batches(_wave, (scale, points), 4)["sum"])

    expected = jnp.sum(points * jnp.cos(scale[:, None] * points), axis=1)
    np.testing.assert_allclose(jax.grad(total)(scale), expected, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(jax.jacfwd(total)(scale), expected, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("count", [4, 11, 57])
def test_the_function_is_traced_once_and_no_batch_is_larger_than_asked(count):
    sizes = []

    def function(x):
        sizes.append(x)
        return 2.0 * x

    jax.make_jaxpr(lambda x: map_in_batches(function, x, 4))(jnp.ones(count))
    assert len(sizes) == 1
    shapes = [equation.invars[-1].aval.shape for equation in _loops(count)]
    assert len(shapes) == (count > 4)
    assert all(shape[1] <= 4 for shape in shapes)


def _loops(count):
    jaxpr = jax.make_jaxpr(lambda x: map_in_batches(lambda each: 2.0 * each, x, 4))(jnp.ones(count))
    return [equation for equation in jaxpr.eqns if equation.primitive.name == "scan"]
