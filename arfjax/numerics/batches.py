"""A function of one element mapped over many, some at a time."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


def map_in_batches(function: Callable[[Any], Any], elements: Any, at_once: int) -> Any:
    """What `jax.lax.map` with `batch_size` gives, compiled once.

    That compiles its function twice where elements do not fill whole batches: for those, and for what is left. Here all
    batches are of one size, as small as so many batches can be, and the last is filled up with copies of the last
    element.

    Args:
        function: Of one element, a pytree.
        elements: Such a pytree, with an axis of elements in front of every array.
        at_once: Elements of a batch at most.
    """
    count = len(jax.tree.leaves(elements)[0])
    if count <= at_once:
        return jax.vmap(function)(elements)
    batches = -(-count // at_once)
    size = -(-count // batches)

    def cut(array: Any) -> Any:
        filled = jnp.concatenate([array, jnp.repeat(array[-1:], batches * size - count, axis=0)])
        return filled.reshape(batches, size, *array.shape[1:])

    found = jax.lax.map(jax.vmap(function), jax.tree.map(cut, elements))
    return jax.tree.map(lambda array: array.reshape(batches * size, *array.shape[2:])[:count], found)
