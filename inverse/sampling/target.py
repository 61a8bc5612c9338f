"""What samplers call: the log density of many points at once, where to begin, and which problem a file belongs to."""

import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key, PRNGKeyArray

from arfjax.errors import InputError
from inverse.inference.compiled import as_arrays, cached
from inverse.inference.parameter_set import ParameterSet, Varying
from inverse.inference.problem import Problem
from inverse.sampling.checkpoint import opened, refuse_other_settings

_DRAWS_TRIED = 50
_SAME = 1e-6
"""Relative difference below which two log densities of one point are the same on another machine."""


def batched_log_density(
    problem: Problem, *, chunk: int | None = None
) -> Callable[[Float[np.ndarray, "point n"]], Float[np.ndarray, " point"]]:
    """The log density of many points at once, compiled once for each number of points.

    Args:
        problem: Whose posterior it is.
        chunk: Points that are evaluated together, where memory does not hold all of them; None for all.

    Returns:
        A function of points (point, n) that gives their log densities [nats], minus infinity where there is none.
    """
    arrays, static = eqx.partition(as_arrays(problem), eqx.is_array)
    leaves, structure = jax.tree.flatten(static)
    compiled = cached(_compiled, structure, tuple(leaves), chunk)

    def evaluate(points: Float[np.ndarray, "point n"]) -> Float[np.ndarray, " point"]:
        return np.array(compiled(arrays, points))

    return evaluate


@functools.lru_cache(maxsize=64)
def _compiled(structure: Any, leaves: tuple, chunk: int | None) -> Callable[[Any, Any], Float[Array, " point"]]:
    """Compiled for all problems that differ in numbers only.

    `eqx.filter_jit` would do the same, but takes a problem apart at every call, longer than a small model takes.
    """
    static = jax.tree.unflatten(structure, leaves)

    @jax.jit
    def evaluate(arrays: Any, points: Float[Array, "point n"]) -> Float[Array, " point"]:
        problem = eqx.combine(arrays, static)
        if chunk is None:
            return jax.vmap(problem.log_density)(points)
        return jax.lax.map(problem.log_density, points, batch_size=chunk)

    return evaluate


def batched_values(problem: Problem, points: Float[np.ndarray, "point n"]) -> Float[np.ndarray, "point m"]:
    """Values of the parameters, in their units, for many flat vectors."""
    return np.array(_values(as_arrays(problem).parameters, jnp.asarray(points)))


@eqx.filter_jit
def _values(parameters: ParameterSet, points: Float[Array, "point n"]) -> Float[Array, "point m"]:
    return jax.vmap(parameters.values)(points)


def prior_points(problem: Problem, key: PRNGKeyArray, count: int) -> Float[np.ndarray, "count n"]:
    """Flat vectors drawn from the prior.

    Raises:
        InputError: if a parameter has no prior.
    """
    return np.array(_draw(as_arrays(problem).parameters, jax.random.split(key, count)))


@eqx.filter_jit
def _draw(parameters: ParameterSet, keys: Key[Array, " count"]) -> Float[Array, "count n"]:
    return jax.vmap(parameters.draw)(keys)


def require_posterior(problem: Problem) -> None:
    """Refuse a problem that has no posterior density.

    Raises:
        InputError: if nothing is free, or a free parameter has no prior.
    """
    if problem.parameters.size == 0:
        raise InputError("nothing is free in this problem, so that there is nothing to sample: free a parameter.")
    bare = [entry.name for entry in problem.parameters.entries if entry.parameter.prior is None]
    if bare:
        raise InputError(
            f"`{bare[0]}` has no prior, so that there is no posterior to sample: give it one, hold it fixed, or fit by "
            "likelihood alone."
        )


def usable_points(
    problem: Problem,
    draw: Callable[[PRNGKeyArray, int], Float[np.ndarray, "count n"]],
    key: PRNGKeyArray,
    count: int,
    *,
    chunk: int | None = None,
) -> Float[np.ndarray, "count n"]:
    """Points of finite log density, drawn until there are enough.

    Raises:
        InputError: if hardly any point has a density.
    """
    evaluate, found = batched_log_density(problem, chunk=chunk), []
    for attempt in range(_DRAWS_TRIED):
        points = draw(jax.random.fold_in(key, attempt), count)
        found += list(points[np.isfinite(evaluate(points))])
        if len(found) >= count:
            return np.stack(found[:count])
    tried = _DRAWS_TRIED * count
    raise InputError(
        f"only {len(found)} of {tried} points to start from have a finite log density, needed are {count}: the model "
        "or its likelihood is not a number there. Check `problem.log_density(problem.start)`, or narrow the priors."
    )


def coordinate_names(parameters: ParameterSet) -> tuple[str, ...]:
    """A name for each number of the flat vector: the parameter's, numbered where it has several."""
    names: list[str] = []
    for entry in parameters.entries:
        if isinstance(entry, Varying):
            names += [name for name, _, _ in entry.columns]
        elif entry.size == 1:
            names.append(entry.name)
        else:
            names += [f"{entry.name}[{index}]" for index in range(entry.size)]
    return tuple(names)


def fingerprint(problem: Problem) -> dict[str, str | float]:
    """What tells a problem from another, for the attributes of a file: names, data, priors, and a log density."""
    digest = hashlib.sha256()
    for measurement in problem.measurements:
        digest.update(f"{measurement.name} [{measurement.unit}]".encode())
        digest.update(" ".join(f"{value:.10g}" for value in np.asarray(measurement.measured)).encode())
    columns = (f"{name} [{unit}]" for name, unit, _ in problem.parameters.columns)
    return {
        "parameters": ", ".join(columns),
        "priors": "; ".join(belief for belief, _ in problem.parameters.beliefs),
        "data": digest.hexdigest(),
        # Fixed constants and settings of the model are in no list: what they do to the density at one point is.
        "log_density_at_start": _density_somewhere(problem),
    }


def _density_somewhere(problem: Problem) -> float:
    """Log density at the start, or, where that lies outside of the priors, at the first draw of them that has one."""
    evaluate = batched_log_density(problem)
    at_start = float(evaluate(np.asarray(problem.start)[None])[0])
    if np.isfinite(at_start) or not problem.parameters.has_priors:
        return at_start
    drawn = evaluate(prior_points(problem, jax.random.key(0), _DRAWS_TRIED))
    return float(next(iter(drawn[np.isfinite(drawn)]), at_start))


def require_resumable(file: Path, problem: Problem, settings: dict[str, str | int | float]) -> None:
    """Refuse a file of a run that is not this problem's, or was begun with other settings.

    Args:
        file: That a sampler would go on with.
        problem: What is to be sampled.
        settings: Of the run, as the file's attributes hold them; some of them will do.

    Raises:
        InputError: saying what differs.
    """
    with opened(file) as held:
        found = dict(held.attrs)
    if "data" not in found or "sampler" not in found:
        raise InputError(
            f"{file}: holds no run of a sampler of ours; delete it to begin anew, or keep this run elsewhere."
        )
    refuse_other_problem(found, problem, str(file))
    refuse_other_settings(found, settings, str(file))


def refuse_other_problem(found: dict, problem: Problem, place: str) -> None:
    """Refuse a file whose fingerprint is not the problem's.

    Raises:
        InputError: saying what differs.
    """
    expected = fingerprint(problem)
    for key, said in (("parameters", "parameters"), ("priors", "priors"), ("data", "measured data")):
        if found.get(key) != expected[key]:
            shown = "" if key == "data" else f" ({found.get(key)}; here {expected[key]})"
            raise InputError(
                f"{place}: holds draws of another problem, its {said} differ{shown}; delete it to begin anew, or keep "
                "this run elsewhere."
            )
    before, now = float(found.get("log_density_at_start", np.nan)), float(expected["log_density_at_start"])
    if before != now and not abs(before - now) <= _SAME * max(abs(before), abs(now), 1.0):
        raise InputError(
            f"{place}: holds draws of another problem, its log density at the start was {before:.8g} and is {now:.8g}: "
            "a fixed constant or a setting of the model has changed; delete it to begin anew, or keep this run "
            "elsewhere."
        )
