"""Fits: the most probable constants, or the most likely ones where there are no priors, with what is known of them.

Every fit starts from several places. Costs that are sums of squares are minimised by Levenberg and Marquardt's method
or Powell's dogleg, others by BFGS in coordinates of their own curvature; L-BFGS-B, where it
is asked for, goes on with bounds that it can reach. Where predictions are long computations, `Method.NEWTON` drives the
search from outside of JAX on one compiled gradient.
"""

import dataclasses
import enum

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError
from inverse.bounded import multi_start_bounded
from inverse.descent import NEWTON_STEPS, Descent, descend, expand, is_minimum, newton_gain, polish
from inverse.inference.compiled import as_arrays, cost_of
from inverse.inference.curvature import bounds, cost_curvature, root_of_curvature
from inverse.inference.problem import Problem
from inverse.least_squares import MultiStart, multi_start
from inverse.minimise import multi_start_minimise
from inverse.parameters import Parameter
from inverse.precision import require_double_precision
from inverse.transforms import Identity, LogInterval, Positive
from inverse.uncertainty import Uncertainty, assess


class Method(enum.StrEnum):
    """How a cost is minimised."""

    LEVENBERG_MARQUARDT = "levenberg-marquardt"
    DOGLEG = "dogleg"
    BFGS = "bfgs"
    L_BFGS_B = "l-bfgs-b"
    NEWTON = "newton"


_MINIMUM = 1e-3
"""Nats that a Newton step may still gain at values that count as a minimum."""

_ROUNDING = 1e-9
"""Share of a value's range, or of its size, that rounding may leave between it and a bound."""

_LEAST_SQUARES = {Method.LEVENBERG_MARQUARDT, Method.DOGLEG}


@dataclasses.dataclass(frozen=True)
class Fit:
    """Constants that fit.

    Attributes:
        problem: What was fitted.
        method: That found them.
        values: Of the parameters, in their units.
        cost: There [nats].
        starts: What every start reached.
        ends: For each value the end of its range at which it lies, or None.
        uncertainty: Standard errors, correlations, what the data do not fix; priors count as data.
        judged: Whether the values are someone else's, see `judge`.
    """

    problem: Problem
    method: Method
    values: Float[np.ndarray, " m"]
    cost: float
    starts: MultiStart
    ends: tuple[str | None, ...]
    uncertainty: Uncertainty
    judged: bool = False

    @property
    def converged(self) -> bool:
        """Whether the best start converged."""
        return self.starts.converged

    @property
    def status(self) -> str:
        """How the best start ended, and how many others agree with it."""
        return self.starts.describe()

    @property
    def columns(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and title of each value."""
        return self.problem.parameters.columns


def fit(
    problem: Problem,
    *,
    method: Method | None = None,
    n_starts: int = 16,
    seed: int = 0,
    scale_errors: bool = False,
    max_steps: int = 500,
) -> Fit:
    """Minimise the cost of a problem from several starts.

    Args:
        problem: What to fit.
        method: How. If not given, by Newton's where predictions are long computations, else by Levenberg and
            Marquardt where the cost is a sum of squares, else by BFGS.
        n_starts: Starts. The first is what stands in the model, others are drawn from the priors, or within a factor
            of about e where there are none.
        seed: Of the other starts.
        scale_errors: Take the deviations of the data as known but for a common factor, which the residuals then say.
            For sums of squares without priors.
        max_steps: Steps after which a start is stopped, and said not to have converged.

    Raises:
        InputError: if the method does not go with the problem, or the model's own values give no finite cost.
        ValueError: if JAX runs in single precision.
    """
    require_double_precision()
    problem = as_arrays(problem)
    chosen = method or _unbounded(problem)
    _check(problem, chosen, scale_errors)
    starts = draw_starts(problem, n_starts, seed)
    if not np.any(np.isfinite(np.asarray(_costs(problem, starts)))):
        raise InputError("the cost is not a number at any start: look for zeros, NaN or impossible values in the data.")
    found, values = _minimise(problem, chosen, starts, max_steps)
    ends = tuple(_ends(problem, found, values, chosen))
    return Fit(
        problem=problem,
        method=chosen,
        values=values,
        cost=float(np.asarray(found.costs)[int(found.best)]),
        starts=found,
        ends=ends,
        uncertainty=_uncertainty(problem, values, ends, scale_errors),
    )


def judge(problem: Problem, values: Float[np.ndarray, " m"]) -> Fit:
    """Someone else's values as a fit of this problem, to be audited: they count as converged if they are a minimum.

    Args:
        problem: Of single numbers.
        values: Such as those of a published table, inside their bounds.

    Raises:
        InputError: if values and parameters differ in number, or shares or what varies is among them.
    """
    problem = as_arrays(problem)
    if not problem.parameters.is_plain or len(values) != problem.parameters.size:
        raise InputError(
            f"values to be judged must be {problem.parameters.size} single numbers "
            f"({', '.join(problem.parameters.names)}), got {len(values)}."
        )
    entries = problem.parameters.entries
    u = jnp.stack([jnp.asarray(e.parameter.transform.inverse(v)) for e, v in zip(entries, values, strict=True)])
    about = expand(cost_of(problem), np.asarray(u))
    gain = newton_gain(about.slope, about.curvature)
    sound = gain < _MINIMUM and is_minimum(about.curvature)
    stands = MultiStart(u[None], jnp.asarray([about.value]), jnp.asarray([0 if sound else 1]), jnp.asarray([0]))
    ends = tuple(problem.parameters.ends(np.asarray(u)))
    return Fit(
        problem=problem,
        method=_unbounded(problem),
        values=np.asarray(values, dtype=float),
        cost=about.value,
        starts=jax.tree.map(np.asarray, stands),
        ends=ends,
        uncertainty=_uncertainty(problem, np.asarray(values, dtype=float), ends, False),
        judged=True,
    )


def draw_starts(problem: Problem, count: int, seed: int) -> Float[Array, "start n"]:
    """Unconstrained starts: what stands in the model, then draws from the priors or about it."""
    first = problem.start
    first = jnp.where(jnp.isfinite(first), first, jnp.sign(first) * 8.0)
    keys = jax.random.split(jax.random.key(seed), max(count - 1, 1))
    if problem.parameters.has_priors:
        others = _draws(problem, keys)
    else:
        others = jax.vmap(lambda key: first + jax.random.normal(key, first.shape))(keys)
    return jnp.concatenate([first[None], others])[:count]


@eqx.filter_jit
def _draws(problem: Problem, keys):
    return jax.vmap(problem.parameters.draw)(keys)


@eqx.filter_jit
def _costs(problem: Problem, starts):
    return jax.lax.map(problem.cost, starts)


def _check(problem: Problem, method: Method, scale_errors: bool) -> None:
    has_penalty = any(entry.parameter.prior is not None for entry in problem.parameters.entries)
    if method in _LEAST_SQUARES and not problem.is_least_squares:
        raise InputError(
            f"`{method}` needs a sum of squares, but noise is not normal, depends on the prediction or is a parameter: "
            f"take `{Method.BFGS}`, or give the noise fixed deviations."
        )
    if method is Method.L_BFGS_B and not problem.parameters.is_plain:
        raise InputError(f"`{method}` takes single numbers only, no shares of a whole and nothing that varies.")
    if scale_errors and (has_penalty or not problem.is_least_squares):
        raise InputError("`scale_errors` goes with sums of squares without priors: make the noise a parameter instead.")


def _minimise(
    problem: Problem, method: Method, starts: Float[Array, "start n"], max_steps: int
) -> tuple[MultiStart, Float[np.ndarray, " m"]]:
    if method is Method.L_BFGS_B:
        # From where a transformed search ended: first-order steps alone creep along the valleys of such costs.
        inner, values = _minimise(problem, _unbounded(problem), starts, max_steps)
        return _bounded(problem, inner, values, max_steps)
    if method is Method.NEWTON:
        found = _by_newton(problem, starts, max_steps)
    elif method in _LEAST_SQUARES:
        found = _squares(problem, starts, max_steps, method is Method.DOGLEG)
    else:
        found = _general(problem, starts, max_steps)
    found = jax.tree.map(np.asarray, found)
    return found, np.asarray(problem.values(jnp.asarray(found.solutions)[int(found.best)]))


def _unbounded(problem: Problem) -> Method:
    if problem.is_long:
        return Method.NEWTON
    return Method.LEVENBERG_MARQUARDT if problem.is_least_squares else Method.BFGS


def _by_newton(problem: Problem, starts: Float[Array, "start n"], max_steps: int) -> MultiStart:
    """Every start on its own by BFGS, the lowest finished by Newton's steps."""
    cost = cost_of(problem)
    ended = [descend(cost, np.asarray(start), max_steps=max_steps) for start in starts]
    lowest = int(np.argmin([each.value for each in ended]))
    left = max_steps - ended[lowest].n_steps
    polished = polish(cost, ended[lowest], max_steps=min(left, NEWTON_STEPS))
    # Newton's own limit is no limit of the caller's, who would be told in vain of one.
    ended[lowest] = dataclasses.replace(polished, out_of_steps=polished.out_of_steps and left <= NEWTON_STEPS)
    return MultiStart(
        np.stack([each.point for each in ended]),
        np.array([each.value for each in ended]),
        np.array([_status(each) for each in ended]),
        np.array([each.n_steps for each in ended]),
    )


def _status(ended: Descent) -> int:
    """Index into `inverse.least_squares.STATUS`."""
    if ended.converged:
        return 0
    if not np.isfinite(ended.value):
        return 2
    return 1 if ended.out_of_steps else 3


@eqx.filter_jit
def _squares(problem: Problem, starts, max_steps: int, dogleg: bool) -> MultiStart:
    found = multi_start(lambda u, each: each.residuals(u), starts, problem, max_steps=max_steps, dogleg=dogleg)
    return eqx.tree_at(lambda one: one.costs, found, jax.lax.map(problem.cost, found.solutions))


@eqx.filter_jit
def _general(problem: Problem, starts, max_steps: int) -> MultiStart:
    return multi_start_minimise(lambda u, each: each.cost(u), starts, problem, max_steps=max_steps)


def _bounded(
    problem: Problem, inner: MultiStart, values: Float[np.ndarray, " m"], max_steps: int
) -> tuple[MultiStart, Float[np.ndarray, " m"]]:
    lower, upper = bounds(problem)
    reached = np.stack([np.asarray(problem.values(u)) for u in jnp.asarray(inner.solutions)])
    # One standard deviation of each value alone, or the value itself where the cost hardly knows it.
    curvature = np.diag(cost_curvature(problem, values))
    widest = np.where(values == 0.0, 1.0, np.abs(values))
    scale = jnp.asarray(1.0 / np.sqrt(np.maximum(curvature, widest**-2.0)))
    found = multi_start_bounded(
        problem.cost_of, jnp.asarray(reached), jnp.asarray(lower), jnp.asarray(upper), scale=scale, max_steps=max_steps
    )
    found = jax.tree.map(np.asarray, found)
    return found, np.asarray(found.solutions)[int(found.best)]


def _ends(problem: Problem, found: MultiStart, values: Float[np.ndarray, " m"], method: Method) -> list[str | None]:
    if method is not Method.L_BFGS_B:
        return problem.parameters.ends(np.asarray(found.solutions)[int(found.best)])
    lower, upper = bounds(problem)
    return [
        "lower" if value <= low + above else "upper" if value >= high - below else None
        for value, low, high, (above, below) in zip(values, lower, upper, _on_bounds(problem), strict=True)
    ]


def _on_bounds(problem: Problem) -> list[tuple[float, float]]:
    """How near to its lower and upper bound each value of a plain set counts as on it, which is a matter of rounding.

    By its own range or size: of the range of a time that spans powers of ten the width says nothing at its lower end.
    """
    near = []
    for entry in problem.parameters.entries:
        transform = entry.parameter.transform
        low, high = (float(bound) for bound in transform.bounds)
        if isinstance(transform, LogInterval):
            near.append((_ROUNDING * low, _ROUNDING * high))
        else:
            size = float(transform.scale) if isinstance(transform, Positive) else high - low
            near.append((_ROUNDING * size,) * 2 if np.isfinite(size) else (0.0, 0.0))
    return near


def _uncertainty(
    problem: Problem, values: Float[np.ndarray, " m"], ends: tuple[str | None, ...], scale_errors: bool
) -> Uncertainty:
    """From the Jacobian of a sum of squares, else from the curvature of the cost, both in the values.

    Of what lies on a bound nothing is known but that; the errors of the others hold for it staying there.
    """
    inside = np.array([end is None for end in ends])
    if problem.is_least_squares:
        residuals, jacobian = _linearised(problem, jnp.asarray(values))
    else:
        curvature = cost_curvature(problem, values) * np.outer(inside, inside)
        jacobian = root_of_curvature(curvature, values)
        residuals = np.zeros(len(jacobian))
    return assess(
        np.asarray(jacobian) * inside[None, :],
        np.asarray(residuals),
        values,
        [Parameter(name, unit, Identity()) for name, unit, _ in problem.parameters.columns],
        ends=ends,
        in_standard_deviations=not scale_errors,
    )


@eqx.filter_jit
def _linearised(problem: Problem, values):
    return problem.residuals_of(values), jax.jacfwd(problem.residuals_of)(values)
