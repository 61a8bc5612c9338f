"""Assertions that many tests share."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np


def assert_gradient(f: Callable, x, *, seed: int = 0, step: float = 1e-5, rtol: float = 1e-6) -> None:
    """Reverse mode equals forward mode (1e-10) and a central difference (`rtol`) in a random direction.

    `x` is any pytree of floats; the direction is scaled by each leaf's size, so that leaves of different units
    all take part. The difference is fourth order, so that its own error stays below `rtol`.
    """
    leaves, structure = jax.tree.flatten(jax.tree.map(jnp.asarray, x))
    rng = np.random.default_rng(seed)
    direction = structure.unflatten(
        [jnp.asarray(rng.normal(size=leaf.shape)) * jnp.maximum(jnp.abs(leaf), 1e-30) for leaf in leaves]
    )
    x = structure.unflatten(leaves)
    f = jax.jit(f)

    def along(length: float):
        return float(f(jax.tree.map(lambda value, change: value + length * change, x, direction)))

    products = jax.tree.map(lambda g, d: jnp.sum(g * d), jax.grad(f)(x), direction)
    reverse = sum(jax.tree.leaves(products))
    forward = jax.jvp(f, (x,), (direction,))[1]
    central = (8.0 * (along(step) - along(-step)) - (along(2.0 * step) - along(-2.0 * step))) / (12.0 * step)
    np.testing.assert_allclose(reverse, forward, rtol=1e-10, err_msg="reverse mode against forward mode")
    np.testing.assert_allclose(reverse, central, rtol=rtol, err_msg="derivative against central difference")


def observed_order(spacings: Sequence[float], errors: Sequence[float]) -> float:
    """Slope of the logarithm of the error over the logarithm of the spacing."""
    return float(np.polyfit(np.log(spacings), np.log(errors), 1)[0])


def assert_order(spacings: Sequence[float], errors: Sequence[float], *, order: float, slack: float = 0.15) -> None:
    """The error falls with the spacing at least as fast as claimed."""
    slope = observed_order(spacings, errors)
    assert slope >= order - slack, f"observed order {slope:.2f}, claimed {order}: errors {list(errors)}"
