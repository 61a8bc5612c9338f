"""Minima of any smooth function from many starts: BFGS (optimistix) in coordinates of its own curvature.

For costs that are no sum of squares, such as likelihoods with unknown noise. The solver takes no bounds: keep
parameters inside theirs with the transforms of `inverse.transforms`, or see `inverse.bounded`.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from inverse.least_squares import MultiStart

_FLATTEST = 1e-8
"""Curvature over the largest one at which a direction is scaled as if it had that much."""
_ROUNDS = 3
"""Times that the coordinates are renewed: near the minimum its own curvature makes BFGS a Newton method."""

_SOLVER_TOLERANCE = 1e-7
_FAR = 1e10
"""Stands for a cost that is not a number: line searches turn back from it."""


def multi_start_minimise(
    cost: Callable[[Float[Array, " n"], Any], Float[Array, ""]],
    starts: Float[Array, "start n"] | Float[np.ndarray, "start n"],
    args: Any = None,
    *,
    tolerance: float = 1e-6,
    max_steps: int = 200,
) -> MultiStart:
    """Minimise `cost(u, args)` from every row of `starts`.

    A pure function of its arrays: it can be batched over `args` with `jax.vmap` and compiled with `jax.jit`.

    Args:
        cost: Function of the unconstrained parameters u and of `args`.
        starts: One start a row.
        args: Anything the cost needs, such as data.
        tolerance: A start has converged where a Newton step would lower the cost by less, before the last round.
        max_steps: Steps after which a start is stopped, in each of three rounds.

    Returns:
        What every start reached, in the order of `starts`.
    """
    solver = optx.BFGS(rtol=_SOLVER_TOLERANCE, atol=_SOLVER_TOLERANCE)

    def finite(u):
        value = cost(u, args)
        return jnp.where(jnp.isfinite(value), value, _FAR)

    def round_from(centre, _):
        axes = _curvature_axes(jax.hessian(finite)(centre))
        gain = 0.5 * jnp.sum((axes.T @ jax.grad(finite)(centre)) ** 2)
        solution = optx.minimise(
            lambda w, _: finite(centre + axes @ w), solver, jnp.zeros_like(centre), max_steps=max_steps, throw=False
        )
        reached = centre + axes @ solution.value
        # A round that ends higher than it began, by a step that was never accepted, is not taken.
        better = finite(reached) <= finite(centre)
        return jnp.where(better, reached, centre), (gain, jnp.asarray(solution.stats["num_steps"]))

    def solve(start):
        point, (gains, steps) = jax.lax.scan(round_from, start, length=_ROUNDS)
        value = cost(point, args)
        sound = jnp.isfinite(value)
        # The solver's own test also fails where rounding ends the descent. The last round can only lower the cost.
        status = jnp.where(gains[-1] < tolerance, 0, 1)
        return point, jnp.where(sound, value, jnp.inf), jnp.where(sound, status, 2), jnp.sum(steps)

    return MultiStart(*jax.vmap(solve)(jnp.asarray(starts)))


def _curvature_axes(hessian: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Directions of principal curvature, scaled so that each curves by one."""
    sound = jnp.all(jnp.isfinite(hessian))
    safe = jnp.where(sound, hessian, jnp.eye(hessian.shape[0]))
    curvature, axes = jnp.linalg.eigh(safe)
    size = jnp.abs(curvature)
    return axes / jnp.sqrt(jnp.maximum(size, _FLATTEST * jnp.max(size)))[None, :]
