"""Places: where a number stands in a model, written as one writes it in Python.

`liver.attenuation.coefficients[2]` is the third coefficient of the liver's attenuation; a path without an index to an
array, such as `liver.attenuation.coefficients`, is all of it, for factors.
"""

import re
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from arfjax.errors import InputError

_STEP = re.compile(r"\.?([A-Za-z_]\w*)|\[(-?\d+)\]|\['([^']+)'\]")


def read(tree: Any, place: str) -> Array:
    """The number or numbers at a place.

    Raises:
        InputError: if there is no such place, saying what stands at its last sound step.
    """
    node, path = tree, ""
    for name, index in _steps(place):
        node, path = _below(node, name, index, path, place)
    if not _is_number(node):
        raise InputError(f"`{place}`: holds no number but {_kind(node)}{_offer(node, path)}.")
    return jnp.asarray(node, dtype=float)


def write(tree: Any, place: str, value: Array, *, relative: bool = False) -> Any:
    """The same tree with a value at a place, or with what stands there multiplied by it.

    Raises:
        InputError: if there is no such place, or the value's shape is not that of what stands there.
    """
    old = read(tree, place)
    new = old * value if relative else jnp.asarray(value, dtype=float)
    if new.shape != old.shape:
        raise InputError(f"`{place}`: holds numbers of shape {old.shape}, given were {new.shape}.")
    steps = _steps(place)
    inside = _array_steps(tree, steps)
    if inside == 0:
        return eqx.tree_at(lambda root: _walk(root, steps), tree, new)
    outer, last = steps[:-inside], tuple(index for _, index in steps[-inside:])
    array = jnp.asarray(_walk(tree, outer), dtype=float).at[last].set(new)
    return eqx.tree_at(lambda root: _walk(root, outer), tree, array)


def counted_from_start(tree: Any, place: str) -> str:
    """The same place, its indices counted from the first: of an array of five, `[-1]` is `[4]`.

    Raises:
        InputError: if there is no such place.
    """
    node, path = tree, ""
    for name, index in _steps(place):
        node, path = _below(node, name, index, path, place)
    return path


def numbers(tree: Any) -> dict[str, Array]:
    """Every place of a tree that holds numbers, with what stands there: what a fit may free."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    return {_written(path): jnp.asarray(leaf, dtype=float) for path, leaf in leaves if _is_number(leaf)}


def _steps(place: str) -> list[tuple[str | None, int | None]]:
    steps, at = [], 0
    while at < len(place):
        match = _STEP.match(place, at)
        if match is None:
            raise InputError(f"`{place}`: is no place; write it as in Python: `liver.attenuation.coefficients[2]`.")
        name, index, key = match.groups()
        steps.append((name if name is not None else key, None if index is None else int(index)))
        at = match.end()
    if not steps:
        raise InputError("a place is empty; write it as in Python: `liver.attenuation.coefficients[2]`.")
    return steps


def _below(node: Any, name: str | None, index: int | None, path: str, place: str) -> tuple[Any, str]:
    if index is not None:
        length = len(node) if isinstance(node, tuple | list) or getattr(node, "ndim", 0) else 0
        if not -length <= index < length:
            raise InputError(f"`{place}`: `{path}` is {_kind(node)} of length {length}, without a number {index}.")
        return node[index], f"{path}[{index % length}]"
    try:
        return _step(node, name, None), f"{path}.{name}".lstrip(".")
    except (AttributeError, KeyError):
        raise InputError(
            f"`{place}`: {'`' + path + '`' if path else 'the model'} ({_kind(node)}) has no `{name}`"
            f"{_offer(node, path)}."
        ) from None


def _step(node: Any, name: str | None, index: int | None) -> Any:
    if index is not None:
        return node[index]
    return node[name] if isinstance(node, dict) else getattr(node, str(name))


def _walk(node: Any, steps: list[tuple[str | None, int | None]]) -> Any:
    for name, index in steps:
        node = _step(node, name, index)
    return node


def _array_steps(tree: Any, steps: list[tuple[str | None, int | None]]) -> int:
    """How many of the last steps are indices into one array."""
    for count in range(1, len(steps)):
        if steps[-count][1] is None:
            return 0
        if _is_number(_walk(tree, steps[:-count])):
            return count
    return 0


def _is_number(node: Any) -> bool:
    if isinstance(node, jax.Array | np.ndarray):
        return jnp.issubdtype(node.dtype, jnp.inexact)
    return isinstance(node, float)


def _kind(node: Any) -> str:
    return "numbers" if _is_number(node) else type(node).__name__


def _offer(node: Any, path: str) -> str:
    found = [f"{path}{'' if each.startswith('[') or not path else '.'}{each}" for each in numbers(node)]
    if not found:
        return ""
    shown = ", ".join(f"`{each}`" for each in found[:12])
    return f"; numbers stand at {shown}{', ...' if len(found) > 12 else ''}"


def _written(path: tuple) -> str:
    text = ""
    for key in path:
        if isinstance(key, jax.tree_util.SequenceKey):
            text += f"[{key.idx}]"
        elif isinstance(key, jax.tree_util.DictKey):
            text += f".{key.key}" if str(key.key).isidentifier() else f"['{key.key}']"
        else:
            text += f".{getattr(key, 'name', key)}"
    return text.lstrip(".")
