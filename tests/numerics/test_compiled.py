"""What is compiled for a closure is what `equinox.filter_jit` compiles, and goes with the closure."""

import gc
import weakref

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.numerics.compiled import compiled


class Scaled(eqx.Module):
    by: float
    values: jax.Array
    name: str = eqx.field(static=True, default="x")


def test_it_gives_what_the_function_gives_and_traces_arrays_alone():
    calls = []

    @compiled
    def run(scaled, shift, *, more):
        calls.append((scaled.by, scaled.name))
        # A number that is no array is known while compiling.
        return (scaled.by * scaled.values if scaled.by > 1.0 else scaled.values) + shift + more, scaled.name

    total, name = run(Scaled(2.0, jnp.arange(3.0)), np.ones(3), more=jnp.ones(()))
    np.testing.assert_allclose(total, 2.0 * np.arange(3.0) + 2.0)
    assert calls == [(2.0, "x")] and name == "x"


def test_it_compiles_once_for_equal_structure():
    calls = []

    @compiled
    def run(scaled):
        calls.append(1)
        return scaled.by * scaled.values

    for by, values in ((2.0, 1.0), (2.0, 5.0), (3.0, 1.0), (2.0, 2.0)):
        np.testing.assert_allclose(run(Scaled(by, jnp.full(2, values))), by * values)
    assert len(calls) == 2


def test_it_can_be_differentiated_and_mapped():
    run = compiled(lambda scaled: jnp.sum(scaled.values**scaled.by))
    at = jnp.asarray([1.0, 2.0])
    np.testing.assert_allclose(jax.grad(lambda x: run(Scaled(3.0, x)))(at), 3.0 * at**2)
    np.testing.assert_allclose(jax.vmap(lambda x: run(Scaled(2.0, x)))(at[:, None]), at**2)


@pytest.mark.parametrize(("wrap", "freed"), [(compiled, True), (eqx.filter_jit, False)])
def test_what_a_closure_holds_is_freed_with_it(wrap, freed):
    """The reason for its being: `filter_jit` keeps it; once it does not, it can take this one's place."""

    class Held:
        factor = 2.0

    held = Held()
    seen = weakref.ref(held)
    run = wrap(_closing_over(held))
    np.testing.assert_allclose(run(jnp.ones(2)), 2.0)
    del held, run
    gc.collect()
    assert (seen() is None) is freed


def _closing_over(held):
    return lambda values: held.factor * values
