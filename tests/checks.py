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


def assert_gradient_of_each_leaf(
    f: Callable, x, *, step: float = 3e-4, rtol: float = 1e-6, reverse: bool = True
) -> None:
    """As `assert_gradient`, for a relative change of one leaf of `x` at a time, so that none hides behind another.

    Every derivative must be there: none may be zero. `reverse` False leaves that mode out.
    """
    x = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), x)
    leaves, structure = jax.tree.flatten(x)
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_flatten_with_path(x)[0]]
    pick = [structure.unflatten([jnp.asarray(float(i == j)) for j in range(len(leaves))]) for i in range(len(leaves))]
    value = jax.jit(lambda scales: f(jax.tree.map(lambda leaf, scale: leaf * scale, x, scales)))
    ones = jax.tree.map(lambda leaf: jnp.ones(()), x)
    stacked = jax.tree.map(lambda *each: jnp.stack(each), *pick)
    forward = jax.jit(jax.vmap(lambda direction: jax.jvp(value, (ones,), (direction,))[1]))(stacked)
    assert np.all(forward != 0.0), dict(zip(names, forward, strict=True))
    if reverse:
        backward = jnp.stack(jax.tree.leaves(jax.jit(jax.grad(value))(ones)))
        np.testing.assert_allclose(backward, forward, rtol=1e-10, err_msg=f"reverse against forward mode: {names}")
    for name, direction, derivative in zip(names, pick, forward, strict=True):

        def along(length, direction=direction):
            return float(value(jax.tree.map(lambda scale, change: scale + length * change, ones, direction)))

        central = (8.0 * (along(step) - along(-step)) - (along(2.0 * step) - along(-2.0 * step))) / (12.0 * step)
        np.testing.assert_allclose(derivative, central, rtol=rtol, err_msg=f"against central difference: {name}")
