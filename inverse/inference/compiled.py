"""A likelihood and its gradient, compiled once for all that is asked of a problem from outside of JAX.

A chain of sound, heat and motion takes far longer to compile than to run, and its second derivatives several times as
long again. So one thing is compiled: the log likelihood with its gradient in the values of the parameters. Costs, log
densities and what the data alone say are put together from it and from priors and transforms, which are small.

Problems that differ in numbers alone, such as their data, share what is compiled.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from inverse.inference.problem import Problem

Gradient = Callable[[Float[np.ndarray, " n"]], tuple[float, Float[np.ndarray, " n"]]]
"""A function of a point that gives its value there, and its gradient."""


def as_arrays(problem: Problem) -> Problem:
    """The same problem with every number an array, so that another of the same shape need not be compiled again."""

    def as_array(leaf: Any) -> Any:
        return jnp.asarray(leaf) if isinstance(leaf, float | np.ndarray) else leaf

    return jax.tree.map(as_array, problem)


def log_likelihood_of(problem: Problem) -> Gradient:
    """Logarithm of the density of all data [nats], in the values of the parameters."""
    return _compiled(problem, _likelihood)


def cost_of(problem: Problem) -> Gradient:
    """What fits minimise [nats], in the unconstrained numbers."""
    likelihood, around = log_likelihood_of(problem), _small(problem)

    def evaluate(u: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        parts = around(u)
        value, slope = likelihood(parts.values)
        return parts.penalty - value, parts.penalty_slope - parts.jacobian.T @ slope

    return evaluate


def cost_of_values(problem: Problem) -> Gradient:
    """What fits minimise [nats], in the values of the parameters."""
    likelihood, penalties = log_likelihood_of(problem), _compiled(problem, _penalty)

    def evaluate(values: Float[np.ndarray, " m"]) -> tuple[float, Float[np.ndarray, " m"]]:
        (penalty, penalty_slope), (value, slope) = penalties(values), likelihood(values)
        return penalty - value, penalty_slope - slope

    return evaluate


def log_density_of(problem: Problem) -> Gradient:
    """Logarithm of the posterior density [nats] in the unconstrained numbers, minus infinity where there is none."""
    likelihood, around = log_likelihood_of(problem), _small(problem)

    def evaluate(u: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        parts = around(u)
        value, slope = likelihood(parts.values)
        total = parts.prior + value
        return (total if np.isfinite(total) else -np.inf), parts.prior_slope + parts.jacobian.T @ slope

    return evaluate


class _Small(NamedTuple):
    """All of an objective at a point but for the likelihood.

    Attributes:
        values: Of the parameters.
        jacobian: Of the values in the unconstrained numbers.
        prior: Log density of the unconstrained numbers [nats].
        prior_slope: Its gradient.
        penalty: Half the squares of the priors' penalties [nats].
        penalty_slope: Its gradient.
    """

    values: Float[np.ndarray, " m"]
    jacobian: Float[np.ndarray, "m n"]
    prior: float
    prior_slope: Float[np.ndarray, " n"]
    penalty: float
    penalty_slope: Float[np.ndarray, " n"]


def _small(problem: Problem) -> Callable[[Float[np.ndarray, " n"]], _Small]:
    evaluate = _compiled(problem, _around)
    return lambda u: _Small(*evaluate(u))


def _around(problem: Problem, u: Float[Array, " n"]) -> tuple[Array, ...]:
    parameters = problem.parameters
    prior, prior_slope = jax.value_and_grad(parameters.log_prior)(u)
    penalty, penalty_slope = jax.value_and_grad(lambda each: _squares(problem, parameters.values(each)))(u)
    jacobian = jax.jacfwd(parameters.values)(u)
    return parameters.values(u), jacobian, prior, prior_slope, penalty, penalty_slope


def _likelihood(problem: Problem, values: Float[Array, " m"]) -> tuple[Array, Array]:
    return jax.value_and_grad(problem.log_likelihood_of)(values)


def _penalty(problem: Problem, values: Float[Array, " m"]) -> tuple[Array, Array]:
    return jax.value_and_grad(lambda each: _squares(problem, each))(values)


def _squares(problem: Problem, values: Float[Array, " m"]) -> Float[Array, ""]:
    return 0.5 * jnp.sum(problem.parameters.penalties(values) ** 2)


def _compiled(problem: Problem, function: Callable[..., tuple[Array, ...]]) -> Callable[[Any], Any]:
    """A function of problem and point, compiled for all problems that differ in numbers only.

    `eqx.filter_jit` would do the same, but takes a problem apart at every call, longer than a small model takes.
    """
    arrays, static = eqx.partition(as_arrays(problem), eqx.is_array)
    leaves, structure = jax.tree.flatten(static)
    run = cached(_program, function, structure, tuple(leaves))

    def evaluate(point: Any) -> tuple:
        return tuple(float(each) if each.ndim == 0 else np.array(each) for each in run(arrays, point))

    return evaluate


def cached(build: Any, *key: Any) -> Any:
    """What a function with a cache gives for a key, or, for what cannot be compared, the function itself."""
    try:
        return build(*key)
    except TypeError:  # a model with settings that cannot be compared: compiled each time
        return build.__wrapped__(*key)


@functools.lru_cache(maxsize=64)
def _program(function: Callable, structure: Any, leaves: tuple) -> Callable[[Any, Any], tuple[Array, ...]]:
    static = jax.tree.unflatten(structure, leaves)

    @jax.jit
    def run(arrays: Any, point: Float[Array, " n"]) -> tuple[Array, ...]:
        return function(eqx.combine(arrays, static), point)

    return run
