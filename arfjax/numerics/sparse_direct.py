"""Sparse symmetric systems, factorised once and solved many times by a direct solver on the host.

A `Pattern` says where the matrix may differ from zero and in which order to eliminate; it is made once a mesh. Its
values come from element matrices, real or complex. The factors live on the host, and a compiled program holds only
their number, so that a solve moves no more than its right side and its solution:

    pattern = Pattern.of_elements(element_dofs, n_unknowns, free)
    factor = factorise(pattern, pattern.assemble(element_matrices))
    solution = solve(factor, right_side)

Matrices are symmetric; complex ones too (not Hermitian), so that the transposed system has the same factors.
Derivatives come from the implicit function theorem, forward and reverse, in the values and in the right side.

Life of the factors: the host keeps those used last, up to a number of bytes (`limit_factor_memory`); a factor asked
for again with the same values is not computed again. A solve whose factors have been dropped meanwhile raises an error.

On one core a solve in a program that runs in the background can wait for ever, as it holds the only thread that could
bring its numbers. `jax.config.update("jax_cpu_enable_async_dispatch", False)` before JAX starts prevents that; the
commands do so.
"""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Inexact, Int

from arfjax.numerics.host_factors import STORE, check_backend, factor_number
from arfjax.numerics.host_factors import limit_factor_memory as limit_factor_memory
from arfjax.numerics.host_factors import release_factors as release_factors
from arfjax.numerics.sparse_pattern import Pattern as Pattern
from arfjax.numerics.sparse_pattern import nested_dissection as nested_dissection

RightSide = Inexact[Array, " unknown"] | Inexact[np.ndarray, " unknown"]


class Factor(eqx.Module):
    """Factors that the host holds.

    Attributes:
        handle: Their number there; -1 if the values were not finite.
        values: Of the matrix.
        pattern: Of the matrix.
    """

    handle: Int[Array, ""]
    values: Inexact[Array, " entry"]
    pattern: Pattern = eqx.field(static=True)


def factorise(pattern: Pattern, values: Inexact[Array, " entry"], *, backend: str = "superlu") -> Factor:
    """Factors of a symmetric matrix, for `solve`.

    Args:
        pattern: Where its entries are.
        values: Entries, as `pattern.assemble` gives them; in float32 the host works in float64 all the same.
        backend: "superlu" (comes with scipy, any symmetric matrix), or for real positive definite matrices "cholmod"
            (package scikit-sparse, which is built against the system's SuiteSparse) or "cholespy" (wheels; it finds
            an order by itself, so that factors take twice as long). On 130 000 unknowns of a mesh, seconds for factors
            and for a solve, one core: 1.15 and 0.042; 1.05 and 0.028; 2.4 and 0.024.

    Raises:
        InputError: if the backend is not known or not installed, or the matrix is of a kind that it does not take.
        Exception: when it runs, naming the cause, if the matrix is singular to working precision or not symmetric.

    With values that are not finite all solutions are NaN. No derivative flows through the factors: `solve` supplies it.
    """
    check_backend(backend, complex_valued=jnp.iscomplexobj(values))
    held = jax.lax.stop_gradient(values)
    make = functools.partial(_factorise_on_host, pattern, backend)
    handle = jax.pure_callback(make, jax.ShapeDtypeStruct((), np.int32), held, vmap_method="expand_dims")
    return Factor(handle, values, pattern)


def solve(factor: Factor, right_side: RightSide) -> Inexact[Array, " unknown"]:
    """Solution of the system that was factorised; `vmap` for many right sides at once, which share one call.

    Accuracy: backward stable; in float32 only the result is rounded.
    Differentiability: forward and reverse, any number of times, in the values that were factorised and in the right
        side, by one more solve with the same factors.
    """
    right_side = jnp.asarray(right_side).astype(jnp.result_type(factor.values, right_side))
    handle, pattern = jax.lax.stop_gradient(factor.handle), factor.pattern

    def substitute(_: Callable, vector: Array) -> Array:
        shape = jax.ShapeDtypeStruct(vector.shape, vector.dtype)
        return jax.pure_callback(_solve_on_host, shape, handle, vector, vmap_method="expand_dims")

    return jax.lax.custom_linear_solve(
        lambda vector: pattern.multiply(factor.values, vector), right_side, substitute, symmetric=True
    )


def linear_solve(
    pattern: Pattern,
    values: Inexact[Array, " entry"],
    right_side: RightSide,
    *,
    backend: str = "superlu",
) -> Inexact[Array, " unknown"]:
    """Solution of one system: `solve` after `factorise`, with the derivatives of the former."""
    return solve(factorise(pattern, values, backend=backend), right_side)


def _factorise_on_host(pattern: Pattern, backend: str, values: Any) -> np.ndarray:
    values = np.asarray(values)
    double = np.complex128 if np.iscomplexobj(values) else np.float64
    rows, rounding = values.reshape(-1, pattern.n_entries).astype(double), float(np.finfo(values.dtype).eps)
    numbers = [factor_number(pattern, backend, row, rounding=rounding) for row in rows]
    return np.array(numbers, np.int32).reshape(values.shape[:-1])


def _solve_on_host(handle: Any, right_sides: Any) -> np.ndarray:
    right_sides = np.asarray(right_sides)
    batch, dtype = right_sides.shape[:-1], right_sides.dtype
    handles = np.broadcast_to(np.asarray(handle), batch).ravel()
    double = right_sides.reshape(-1, right_sides.shape[-1]).astype(np.result_type(dtype, np.float64), copy=False)
    solutions = np.full(double.shape, np.nan, double.dtype)
    for number in np.unique(handles):
        if number >= 0:
            members = handles == number
            solutions[members] = STORE.get(int(number)).solve(double[members].T).T
    return solutions.reshape(right_sides.shape).astype(dtype, copy=False)
