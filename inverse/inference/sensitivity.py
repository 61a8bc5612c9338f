r"""Sensitivity: which constants a result depends on, near the model's values and over the priors.

Three questions, three answers:

- `local_sensitivity`: by how many percent does the result change for one percent of a constant? Exact derivatives.
- `one_at_a_time`: what does a change of a constant by so much, both ways, do? The paper's plus or minus 25 percent.
- `sobol_sensitivity`: which share of the result's variance over the priors is due to each constant, alone (first
  order) and with all that it interacts with (total)? A. Saltelli et al., Comput. Phys. Commun. 181 (2010) 259, as
  `scipy.stats.sobol_indices` has it, with bootstrap intervals.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy import stats

from arfjax.errors import InputError
from inverse.inference.parameter_set import ParameterSet
from inverse.inference.problem import State
from inverse.priors import Prior

Quantity = Callable[[Any], Float[Array, " k"]]
"""A result, or several, of a model; pure."""

_EDGE = 1e-9


@dataclasses.dataclass(frozen=True)
class LocalSensitivity:
    """Derivatives of logarithms.

    Attributes:
        names: Of the constants.
        values: Of the constants.
        result: What was asked for, there.
        elasticity: Percent of each result per percent of each constant; 1 is in proportion.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " n"]
    result: Float[np.ndarray, " k"]
    elasticity: Float[np.ndarray, "k n"]


@dataclasses.dataclass(frozen=True)
class Change:
    """What a change of one constant does.

    Attributes:
        name: Of the constant.
        change: As a share of the constant.
        result: What was asked for, after.
        difference: From the result before.
    """

    name: str
    change: float
    result: Float[np.ndarray, " k"]
    difference: Float[np.ndarray, " k"]


@dataclasses.dataclass(frozen=True)
class SobolSensitivity:
    """Shares of variance.

    Attributes:
        names: Of the constants.
        first_order: Share due to each constant alone.
        total: Share due to it and all interactions that it takes part in.
        first_order_interval: Bootstrap interval of `level`, lower and upper.
        total_interval: The same of `total`.
        level: Of the intervals.
        variance: Of each result over the priors.
        n_evaluations: Models that were computed.
        seed: Of the sample; intervals resample it anew at each call, so that their ends scatter a little.
    """

    names: tuple[str, ...]
    first_order: Float[np.ndarray, "k n"]
    total: Float[np.ndarray, "k n"]
    first_order_interval: Float[np.ndarray, "2 k n"]
    total_interval: Float[np.ndarray, "2 k n"]
    level: float
    variance: Float[np.ndarray, " k"]
    n_evaluations: int
    seed: int


def local_sensitivity(parameters: ParameterSet, model: Any, quantity: Quantity) -> LocalSensitivity:
    """Elasticities of a result at a model's own values.

    Args:
        parameters: Constants to ask about, a `ParameterSet` of single numbers.
        model: The model.
        quantity: Results that are not zero.
    """
    of_values, values = _as_function(parameters, model, quantity)
    result = np.asarray(jax.jit(of_values)(values))
    jacobian = np.asarray(jax.jit(jax.jacfwd(of_values))(values))
    elasticity = jacobian * np.asarray(values)[None, :] / result[:, None]
    return LocalSensitivity(parameters.names, np.asarray(values), result, elasticity)


def one_at_a_time(
    parameters: ParameterSet, model: Any, quantity: Quantity, *, change: float = 0.25
) -> tuple[Change, ...]:
    """The result with each constant lower, then higher, by a share of itself, the others as they are.

    Args:
        parameters: Constants to change, a `ParameterSet` of single numbers.
        model: The model.
        quantity: The result.
        change: Share, above 0 and below 1.

    Raises:
        InputError: if the share is out of range.
    """
    if not 0.0 < change < 1.0:
        raise InputError(f"`change` must be a share between 0 and 1, such as 0.25, got {change:g}.")
    of_values, values = _as_function(parameters, model, quantity)
    compiled = jax.jit(of_values)
    before, found = np.asarray(compiled(values)), []
    for place, name in enumerate(parameters.names):
        for share in (-change, change):
            result = np.asarray(compiled(values.at[place].multiply(1.0 + share)))
            found.append(Change(name, share, result, result - before))
    return tuple(found)


def sobol_sensitivity(
    parameters: ParameterSet,
    model: Any,
    quantity: Quantity,
    *,
    n_samples: int = 256,
    seed: int = 0,
    level: float = 0.95,
    batch: int = 16,
    on_step: Callable[[int, int], None] = lambda done, of: None,
) -> SobolSensitivity:
    """Shares of a result's variance over the priors.

    Args:
        parameters: Constants with priors, a `ParameterSet` of single numbers.
        model: The model.
        quantity: The result.
        n_samples: Size of the sample, a power of 2; n constants take n + 2 times as many models.
        seed: Of the sample.
        level: Of the bootstrap intervals.
        batch: Models that are computed together.
        on_step: Told how many models are done, of how many.

    Raises:
        InputError: if the size is no power of 2, a constant has no prior, or a result is not a number for some draw.
    """
    if n_samples < 2 or n_samples & (n_samples - 1):
        raise InputError(f"`n_samples` must be a power of 2 such as 256, got {n_samples}.")
    of_values, _ = _as_function(parameters, model, quantity)
    if not parameters.has_priors:
        raise InputError("shares of variance need a prior for every constant: give the missing ones.")
    compiled = jax.jit(lambda rows: jax.lax.map(of_values, rows, batch_size=batch))
    total = (len(parameters.names) + 2) * n_samples
    done, seen = 0, list[np.ndarray]()

    def results(columns: np.ndarray) -> np.ndarray:
        nonlocal done
        rows = jnp.asarray(columns.T)
        parts = []
        for start in range(0, len(rows), n_samples):
            parts.append(np.asarray(compiled(rows[start : start + n_samples])))
            done += len(parts[-1])
            on_step(done, total)
        found = np.concatenate(parts)
        seen.append(found)
        if not np.all(np.isfinite(found)):
            raise InputError(
                f"{np.sum(~np.all(np.isfinite(found), axis=1))} of {len(found)} models give a result that is not a "
                "number: narrow the priors."
            )
        return found.T

    distributions = [
        _Quantiles(entry.parameter.prior) for entry in parameters.entries if entry.parameter.prior is not None
    ]
    indices = stats.sobol_indices(func=results, n=n_samples, dists=distributions, rng=np.random.default_rng(seed))
    resampled = indices.bootstrap(confidence_level=level)
    first, whole = resampled.first_order.confidence_interval, resampled.total_order.confidence_interval
    shape = (-1, len(parameters.names))
    return SobolSensitivity(
        names=parameters.names,
        first_order=np.reshape(indices.first_order, shape),
        total=np.reshape(indices.total_order, shape),
        first_order_interval=np.stack([np.reshape(first.low, shape), np.reshape(first.high, shape)]),
        total_interval=np.stack([np.reshape(whole.low, shape), np.reshape(whole.high, shape)]),
        level=level,
        variance=np.var(np.concatenate(seen)[: 2 * n_samples], axis=0),
        n_evaluations=done,
        seed=seed,
    )


class _Quantiles:
    """A prior as scipy asks for it."""

    def __init__(self, prior: Prior) -> None:
        self._prior = prior

    def ppf(self, probability: np.ndarray) -> np.ndarray:
        return np.asarray(self._prior.quantile(jnp.clip(jnp.asarray(probability), _EDGE, 1.0 - _EDGE)))


def _as_function(
    parameters: ParameterSet, model: Any, quantity: Quantity
) -> tuple[Callable[[Float[Array, " n"]], Float[Array, " k"]], Float[Array, " n"]]:
    if not parameters.is_plain:
        raise InputError("sensitivities are to single numbers: hold shares and what varies from group to group fixed.")
    state = State(jax.tree.map(jnp.asarray, model), {})

    def of_values(values: Float[Array, " n"]) -> Float[Array, " k"]:
        return jnp.atleast_1d(quantity(parameters.write(state, values).model))

    return of_values, parameters.values(parameters.start(state))
