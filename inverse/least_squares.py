"""Least squares from many starts: Levenberg-Marquardt (optimistix), all starts in one batch.

The solver takes no bounds: keep parameters inside theirs with those of `inverse.transforms`.
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from arfjax.numerics.compiled import compiled

STATUS = (
    "converged",
    "stopped at the largest number of steps: look for constants that the data do not fix",
    "met a value that is not finite: check the data and the bounds",
    "the solver gave up: try other starts or another seed",
)
"""What the status of a start means, in words. Whoever lets a user change the number of steps says so itself."""

_KEPT = 8
"""Residuals of which `descend` keeps what was compiled, the last that it was asked for."""

_SAME_COST = 1e-6
_NO_COST = 1e-16

_TRUST_REGION = optx.ClassicalTrustRegion(high_cutoff=0.75, low_cutoff=0.01, high_constant=3.5, low_constant=0.25)
"""Damping is relaxed once three quarters of the predicted gain came true; optimistix waits for 99 percent, with which
most fits of real sweeps were still creeping along a flat valley after 300 steps."""


class MultiStart(eqx.Module):
    """What every start reached.

    Attributes:
        solutions: Unconstrained parameters at which each start ended.
        costs: Half the sum of squared residuals there; infinite where it is not a number.
        status: Index into `STATUS`.
        steps: Steps taken.
    """

    solutions: Float[Array, "start n"] | Float[np.ndarray, "start n"]
    costs: Float[Array, " start"] | Float[np.ndarray, " start"]
    status: Int[Array, " start"] | Int[np.ndarray, " start"]
    steps: Int[Array, " start"] | Int[np.ndarray, " start"]

    @property
    def agree(self) -> Bool[Array, " start"]:
        """Which starts reached the lowest cost, but for a millionth of it."""
        costs = jnp.asarray(self.costs)
        lowest = jnp.min(costs)
        return costs <= lowest + _SAME_COST * jnp.abs(lowest) + _NO_COST

    @property
    def best(self) -> Int[Array, ""]:
        """Index of the start with the lowest cost; of those that agree with it, one that converged is preferred."""
        costs = jnp.asarray(self.costs)
        sound = self.agree & (jnp.asarray(self.status) == 0)
        return jnp.where(jnp.any(sound), jnp.argmin(jnp.where(sound, costs, jnp.inf)), jnp.argmin(costs))

    @property
    def converged(self) -> bool:
        """Whether the best start converged."""
        return int(self.status[self.best]) == 0

    @property
    def n_agreeing(self) -> int:
        """How many starts reached the lowest cost, but for a millionth of it."""
        return int(jnp.sum(self.agree))

    def describe(self) -> str:
        """The outcome in one sentence: how the best start ended, and how many others agree with it."""
        count = len(self.costs)
        return f"{STATUS[int(self.status[self.best])]}; {self.n_agreeing} of {count} starts reached this minimum"


def multi_start(
    residual: Callable[[Float[Array, " n"], Any], Float[Array, " m"]],
    starts: Float[Array, "start n"] | Float[np.ndarray, "start n"],
    args: Any = None,
    *,
    rtol: float = 1e-8,
    atol: float = 1e-8,
    max_steps: int = 500,
    dogleg: bool = False,
) -> MultiStart:
    """Minimise half the sum of squares of `residual(u, args)` from every row of `starts`.

    A pure function of its arrays: it can be batched over `args` with `jax.vmap` and compiled with `jax.jit`. A start
    that does not converge keeps its place in the result, with its status.

    Args:
        residual: Residual vector of the unconstrained parameters u and of `args`.
        starts: One start a row.
        args: Anything the residual needs, such as data.
        rtol: Relative change of parameters and cost at which a start has converged.
        atol: Absolute change of parameters and cost at which a start has converged.
        max_steps: Steps after which a start is stopped.
        dogleg: Powell's dogleg instead of Levenberg's and Marquardt's damping.

    Returns:
        What every start reached, in the order of `starts`.
    """
    plain = optx.Dogleg(rtol=rtol, atol=atol) if dogleg else optx.LevenbergMarquardt(rtol=rtol, atol=atol)
    solver = eqx.tree_at(lambda method: method.search, plain, _TRUST_REGION)

    def solve(start):
        solution = optx.least_squares(residual, solver, start, args=args, max_steps=max_steps, throw=False)
        cost = 0.5 * jnp.sum(residual(solution.value, args) ** 2)
        finite = jnp.isfinite(cost)
        ended = jnp.where(solution.result == optx.RESULTS.nonlinear_max_steps_reached, 1, 3)
        status = jnp.where(solution.result == optx.RESULTS.successful, 0, ended)
        steps = jnp.asarray(solution.stats["num_steps"])
        return solution.value, jnp.where(finite, cost, jnp.inf), jnp.where(finite, status, 2), steps

    return MultiStart(*jax.vmap(solve)(jnp.asarray(starts)))


@dataclasses.dataclass(frozen=True)
class Descent:
    """How one start went, step by step.

    Attributes:
        solution: Where it ended.
        residual: Residual vector there.
        jacobian: Its derivative in the parameters there.
        first_residual: Residual vector at the start.
        costs: Half the sum of squares after each accepted or refused step.
        converged: Whether it ended because nothing changed any more.
        message: How it ended, in words.
    """

    solution: Float[Array, " n"] | Float[np.ndarray, " n"]
    residual: Float[Array, " m"]
    jacobian: Float[Array, "m n"]
    first_residual: Float[Array, " m"]
    costs: tuple[float, ...]
    converged: bool
    message: str

    @property
    def out_of_steps(self) -> bool:
        """Whether it was stopped at the largest number of steps."""
        return self.message == STATUS[1]


def descend(
    residual: Callable[[Float[Array, " n"], Any], Float[Array, " m"]],
    start: Float[Array, " n"] | Float[np.ndarray, " n"],
    args: Any = None,
    *,
    rtol: float = 1e-4,
    atol: float = 1e-4,
    max_steps: int = 50,
    on_step: Callable[[int, float], None] = lambda step, cost: None,
) -> Descent:
    """Minimise half the sum of squares from one start, one compiled step at a time.

    For residuals that take seconds, where a person wants to see how far it is. Compiled once for each `residual`; the
    last few are kept.

    Args:
        residual: Residual vector of the unconstrained parameters u and of `args`.
        start: Where to begin.
        args: Anything the residual needs, such as data.
        rtol: Relative change of parameters and cost at which it has converged.
        atol: Absolute change of parameters and cost at which it has converged.
        max_steps: Steps after which it is stopped.
        on_step: Told the number of each step and the lowest cost so far.
    """
    solver = optx.LevenbergMarquardt(rtol=rtol, atol=atol)
    point = jnp.asarray(start)
    first_state, one_step, jacobian_of = _steps(residual)
    state = first_state(solver, point, args)
    costs: list[float] = []
    first, status = state.f_info.residual, 1
    for step in range(1, max_steps + 1):
        point, state, ended, failed = one_step(solver, point, args, state)
        first = state.f_info.residual if step == 1 else first
        costs.append(float(state.f_info.as_min()))
        on_step(step, costs[-1])
        if not math.isfinite(costs[-1]):
            status = 2
            break
        if bool(ended):
            status = 3 if bool(failed) else 0
            break
    return Descent(
        solution=point,
        residual=state.f_info.residual,
        jacobian=jacobian_of(state),
        first_residual=first,
        costs=tuple(costs),
        converged=status == 0,
        message=STATUS[status],
    )


@functools.lru_cache(maxsize=_KEPT)
def _steps(residual: Callable) -> tuple[Callable, Callable, Callable]:
    """Compiled for one residual: the state at the start, one step, and the Jacobian of a state as a matrix."""

    def with_no_auxiliary(u, args):
        return residual(u, args), None

    def first_state(solver, point, args):
        structure = jax.eval_shape(residual, point, args)
        return solver.init(with_no_auxiliary, point, args, {}, structure, None, frozenset())

    def one_step(solver, point, args, state):
        point, state, _ = solver.step(with_no_auxiliary, point, args, {}, state, frozenset())
        ended, result = solver.terminate(with_no_auxiliary, point, args, {}, state, frozenset())
        return point, state, ended, result != optx.RESULTS.successful

    return compiled(first_state), compiled(one_step), compiled(lambda state: state.f_info.jac.as_matrix())
