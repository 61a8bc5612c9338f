"""Minima within bounds, where bounds are what matters: L-BFGS-B of jaxopt, the one file that knows that package.

It works on the values themselves, so that a value can lie on its bound exactly, which no transform reaches. jaxopt is
no longer maintained; its implicit derivatives are not used here (they were measured 3.6 percent wrong by default).
"""

import warnings
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from inverse.least_squares import MultiStart

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # it warns that nobody maintains it, at import
    import jaxopt


def multi_start_bounded(
    cost: Callable[[Float[Array, " n"]], Float[Array, ""]],
    starts: Float[Array, "start n"],
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
    *,
    scale: Float[Array, " n"],
    tolerance: float = 1e-4,
    max_steps: int = 1000,
) -> MultiStart:
    """Minimise `cost(values)` with every value between its bounds, from every row of `starts`.

    Args:
        cost: Function of the values.
        starts: One start a row.
        lower: Bounds; minus infinity where there is none.
        upper: Bounds; infinity where there is none.
        scale: Of each value, over which the cost changes by about one: steps and gradients are measured in it.
        tolerance: Largest component of the projected gradient per `scale` at which a start has converged.
        max_steps: Steps after which a start is stopped.

    Returns:
        What every start reached, in values.
    """
    solver = jaxopt.LBFGSB(fun=lambda x: cost(x * scale), maxiter=max_steps, tol=tolerance, implicit_diff=False)

    def solve(start):
        found, state = solver.run(jnp.clip(start, lower, upper) / scale, (lower / scale, upper / scale))
        values = jnp.clip(found * scale, lower, upper)
        reached = cost(values)
        sound = jnp.isfinite(reached)
        status = jnp.where(state.error <= tolerance, 0, 1)
        return values, jnp.where(sound, reached, jnp.inf), jnp.where(sound, status, 2), state.iter_num

    return MultiStart(*jax.jit(jax.vmap(solve))(starts))
