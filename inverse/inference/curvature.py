"""Second derivatives of a problem's cost in the values of its parameters, exact or by differences of gradients."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from arfjax.errors import InputError
from inverse.descent import expand
from inverse.inference.compiled import cost_of_values, log_likelihood_of
from inverse.inference.problem import Problem
from inverse.priors import Normal
from inverse.transforms import Interval, LogInterval, Positive

_EPSILON = 1e-9
_ROOM = 0.07
"""Share of a large change by which differences move a value at most."""


def cost_curvature(problem: Problem, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m m"]:
    """Hessian of the cost.

    Raises:
        InputError: if a long computation has no value close by.
    """
    if not problem.is_long:
        return np.asarray(_exact_cost(problem, jnp.asarray(values)))
    return _finite(expand(cost_of_values(problem), values, _steps(problem, values)).curvature)


def data_curvature(problem: Problem, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m m"]:
    """Hessian of minus the log likelihood.

    Raises:
        InputError: if a long computation has no value close by.
    """
    if not problem.is_long:
        return np.asarray(_exact_data(problem, jnp.asarray(values)))
    return _finite(-expand(log_likelihood_of(problem), values, _steps(problem, values)).curvature)


def _finite(curvature: Float[np.ndarray, "m m"]) -> Float[np.ndarray, "m m"]:
    if not np.all(np.isfinite(curvature)):
        raise InputError(
            "the fit lies at the edge of what the model has a value for, where no standard errors can be told: widen "
            "what a fast model is prepared for, or narrow the priors."
        )
    return curvature


def large_changes(problem: Problem, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """A large change of each value: itself where it is positive, the width of its range, or of its prior."""
    scales = []
    at = 0
    for entry in problem.parameters.entries:
        transform, prior = entry.parameter.transform, entry.parameter.prior
        for value in values[at : at + len(entry.columns)]:
            if isinstance(transform, Positive | LogInterval):
                scales.append(abs(float(value)))
            elif isinstance(transform, Interval):
                scales.append(float(transform.upper - transform.lower))
            elif isinstance(prior, Normal):
                scales.append(float(prior.sd))
            else:
                scales.append(max(abs(float(value)), _EPSILON))
        at += len(entry.columns)
    return np.maximum(np.array(scales), 1e-300)


def root_of_curvature(curvature: Float[np.ndarray, "n n"], values: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n n"]:
    """A matrix J with J^T J equal to a curvature; directions that curve down count as flat."""
    scale = np.where(values == 0.0, 1.0, np.abs(values))
    scaled = curvature * np.outer(scale, scale)
    if not np.all(np.isfinite(scaled)):
        return np.full_like(curvature, math.nan)
    eigenvalues, axes = np.linalg.eigh(0.5 * (scaled + scaled.T))
    return (np.sqrt(np.maximum(eigenvalues, 0.0))[:, None] * axes.T) / scale[None, :]


def bounds(problem: Problem) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Lowest and highest value of each parameter of a plain set; infinite where there is no bound."""
    pairs = [entry.parameter.transform.bounds for entry in problem.parameters.entries]
    return np.array([float(low) for low, _ in pairs]), np.array([float(high) for _, high in pairs])


def _steps(problem: Problem, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Large changes, but no further than differences may go without leaving a range."""
    scales = large_changes(problem, values)
    if not problem.parameters.is_plain:
        return scales
    lower, upper = bounds(problem)
    return np.minimum(scales, np.maximum(np.minimum(values - lower, upper - values) / _ROOM, _EPSILON * scales))


@eqx.filter_jit
def _exact_cost(problem: Problem, values):
    return jax.hessian(problem.cost_of)(values)


@eqx.filter_jit
def _exact_data(problem: Problem, values):
    return jax.hessian(lambda each: -problem.log_likelihood_of(each))(values)
