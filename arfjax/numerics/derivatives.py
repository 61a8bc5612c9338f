"""How derivatives are taken where the obvious way is wasteful."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def forward_by_reverse(function: Callable[[Any], Float[Array, ""]]) -> Callable[[Any], Float[Array, ""]]:
    """The same scalar function, whose forward-mode derivative is its gradient times the tangent.

    A Jacobian by forward mode pushes one tangent for each parameter through the function. For a scalar function that
    costs as much as a few gradients with however many parameters, since the gradient is computed once for all tangents.

    Args:
        function: Of one pytree of numbers; it must not close over values that are differentiated.
    """

    @jax.custom_jvp
    def wrapped(argument: Any) -> Float[Array, ""]:
        return function(argument)

    @wrapped.defjvp
    def _derivative(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
        value, gradient = jax.value_and_grad(function)(primals[0])
        products = jax.tree.map(lambda slope, change: jnp.sum(slope * change), gradient, tangents[0])
        return value, jax.tree.reduce(jnp.add, products, jnp.zeros_like(value))

    def of_floats(argument: Any) -> Float[Array, ""]:
        # A frequency of 1_100_000 is a number as any other.
        return wrapped(jax.tree.map(lambda leaf: 1.0 * leaf if _is_integer(leaf) else leaf, argument))

    return of_floats


def _is_integer(leaf: Any) -> bool:
    return jnp.issubdtype(jnp.result_type(leaf), jnp.integer)
