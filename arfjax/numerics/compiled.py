"""Compiled closures that go when nobody needs them any more."""

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


class _Untraced(eqx.Module):
    """What a function gives beside arrays."""

    leaves: Any = eqx.field(static=True)


def compiled(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """`equinox.filter_jit` for a function made at run time: what is compiled for it is freed with it.

    `filter_jit` hands every function, with what it closes over, to one `jax.jit` as a static argument, and JAX keeps
    those and their programs as long as the process lives: one that makes such functions again and again runs out of
    memory for code. For functions of a module, made once, `filter_jit` is right.

    Args:
        function: Of pytrees, and giving one; arrays among the leaves are traced, all else is compiled in and has to be
            hashable.
    """
    plain: Callable[..., _Result] = function

    @functools.partial(jax.jit, static_argnums=1)
    def run(arrays: Any, rest: tuple[Any, tuple]) -> tuple[Any, _Untraced]:
        structure, leaves = rest
        arguments, named = eqx.combine(arrays, jax.tree.unflatten(structure, leaves))
        found, untraced = eqx.partition(plain(*arguments, **named), _is_traced)
        return found, _Untraced(untraced)

    @functools.wraps(function)
    def call(*arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        arrays, rest = eqx.partition((arguments, named), _is_traced)
        leaves, structure = jax.tree.flatten(rest)
        found, untraced = run(arrays, (structure, tuple(leaves)))
        return eqx.combine(found, untraced.leaves)

    return call


def _is_traced(leaf: Any) -> bool:
    return eqx.is_array(leaf) or isinstance(leaf, np.ndarray | np.generic)
