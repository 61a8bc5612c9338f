r"""Profile likelihood: how far a constant can go when all others follow.

At each held value the other constants are fitted again. The interval at a level is where the cost rises by half the
quantile of chi-square with one degree of freedom (0.5 times 3.84 nats at 95 percent). It holds where a normal
approximation does not, such as for a modulus that may be zero: standard errors covered that one in 78 to 87 of 100
cases instead of 95 when it was measured.
"""

import dataclasses
import enum
import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import stats

from arfjax.errors import InputError
from inverse.descent import descend, expand, newton_gain, whitening
from inverse.inference.compiled import cost_of
from inverse.inference.fit import Fit
from inverse.inference.parameter_set import ParameterSet
from inverse.inference.problem import Problem
from inverse.least_squares import multi_start
from inverse.minimise import multi_start_minimise

_FIRST_STEP = 0.5
_GROWTH = 1.6
_MOST_STEPS = 24
_BISECTIONS = 7
_FURTHEST = 20.0
"""Distance in the unconstrained coordinate, a factor of 5e8 of a positive constant, at which a search gives up."""
_FINISHED = 1e-3
"""Nats that one more step of a refit may still gain: a two-thousandth of what an interval at 95 percent rises by."""
_LOWER_MINIMUM = 1e-2
"""Nats by which a cost below the fit's is a lower minimum and not rounding."""


class Stop(enum.StrEnum):
    """Why a profile ends where it ends."""

    CROSSED = "reached the level"
    FLAT = "does not reach the level: neither data nor prior set a limit on this side"
    BOUND = "ran to the end of the parameter's range"
    LOWER_MINIMUM = "found a lower cost than the fit: fit again from more starts"
    NOT_FITTED = "the other constants could not be fitted there"


@dataclasses.dataclass(frozen=True)
class Profile:
    """A profile of one parameter.

    Attributes:
        name: Of the parameter.
        unit: Of its values.
        level: Of the interval, such as 0.95.
        values: At which it was held, ascending.
        rise: Cost above the fit's at each [nats].
        threshold: Rise at the ends of the interval [nats].
        interval: Lower and upper end; the last value tried, or the bound, where there is no crossing.
        stops: Why each side ended.
        refits: Fits of the other constants on each side.
        unfinished: How many of them did not come to a minimum. Their costs are too high, so that an end that lies
            among them may lie too near.
    """

    name: str
    unit: str
    level: float
    values: Float[np.ndarray, " n"]
    rise: Float[np.ndarray, " n"]
    threshold: float
    interval: tuple[float, float]
    stops: tuple[Stop, Stop]
    refits: tuple[int, int]
    unfinished: tuple[int, int]

    @property
    def is_closed(self) -> bool:
        """Whether data and priors, which count in the cost, limit the parameter on both sides."""
        return all(stop is Stop.CROSSED for stop in self.stops)

    @property
    def converged(self) -> bool:
        """Whether every fit of the other constants came to a minimum."""
        return self.unfinished == (0, 0)

    @property
    def ends(self) -> tuple[str, str]:
        """Why each side ended, and whether its fits did, in words."""
        lower, upper = (
            stop.value
            + (f", but {unfinished} of {count} fits of the other constants did not converge" * bool(unfinished))
            for stop, count, unfinished in zip(self.stops, self.refits, self.unfinished, strict=True)
        )
        return lower, upper

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader of the interval must know, a sentence a side."""
        found = []
        for side, stop, count, unfinished in zip(
            ("lower", "upper"), self.stops, self.refits, self.unfinished, strict=True
        ):
            if unfinished:
                found.append(
                    f"Profile of {self.name}: {unfinished} of {count} fits of the other constants on the {side} side "
                    "did not converge, so that the interval may be too narrow there."
                )
            if stop in (Stop.LOWER_MINIMUM, Stop.NOT_FITTED):
                found.append(f"Profile of {self.name}: the {side} side {stop.value}.")
        return tuple(found)


def profile(fit: Fit, name: str, *, level: float = 0.95, refit: "Refit | None" = None) -> Profile:
    """Profile of one parameter of a fit.

    Args:
        fit: At its minimum.
        name: Of the parameter, one number that does not vary from group to group.
        level: Of the interval.
        refit: From `refit_of`, where several profiles of one fit are taken.

    Raises:
        InputError: if the parameter is unknown or not a single number, or the level is not between 0 and 1.
    """
    if not 0.0 < level < 1.0:
        raise InputError(f"the level of an interval must lie between 0 and 1, such as 0.95, got {level:g}.")
    parameters = fit.problem.parameters
    (entry,) = parameters.only([name]).entries
    if not parameters.is_plain:
        raise InputError("profiles are of single numbers: hold shares and what varies from group to group fixed.")
    place = parameters.entries.index(entry)
    column = entry.columns[0]
    threshold = 0.5 * float(stats.chi2.ppf(level, 1))
    search = _Search(fit, place, threshold, refit or refit_of(fit))
    down = search.side(-1.0)
    below = search.count()
    up = search.side(+1.0)
    above = search.count()
    transform = entry.parameter.transform
    tried = sorted(search.tried.items())
    return Profile(
        name=name,
        unit=column[1],
        level=level,
        values=np.array([float(transform.forward(u)) for u, _ in tried]),
        rise=np.array([rise for _, rise in tried]),
        threshold=threshold,
        interval=(float(transform.forward(down[0])), float(transform.forward(up[0]))),
        stops=(down[1], up[1]),
        refits=(below[0], above[0] - below[0]),
        unfinished=(below[1], above[1] - below[1]),
    )


def profiles(
    fit: Fit, *, level: float = 0.95, on_step: Callable[[str], None] = lambda what: None
) -> tuple[Profile, ...]:
    """Profiles of all parameters of a fit; `on_step` is told in words how far they are."""
    found, refit, entries = [], refit_of(fit), fit.problem.parameters.entries
    for number, entry in enumerate(entries):
        on_step(f"profiles: {entry.name}, {number + 1} of {len(entries)}")
        found.append(profile(fit, entry.name, level=level, refit=refit))
    return tuple(found)


Refit = Callable[[int, float, Float[np.ndarray, " k"]], tuple[float, Float[np.ndarray, " k"], bool]]
"""Given a place, the unconstrained number held there and the others' first guess: the lowest cost, the others, and
whether that is a minimum."""


def refit_of(fit: Fit) -> Refit:
    """How the other constants of a fit are fitted again while one is held."""
    problem = fit.problem
    return _on_one_gradient(problem, _solution(fit)) if problem.is_long else functools.partial(_in_a_batch, problem)


def _in_a_batch(
    problem: Problem, place: int, held: float, others: Float[np.ndarray, " k"]
) -> tuple[float, Float[np.ndarray, " k"], bool]:
    start, at = jnp.asarray(others), jnp.asarray(held)
    if len(others) == 0:
        return float(_cost_alone(problem, at)), others, True
    refit = _refit_squares if problem.is_least_squares else _refit
    cost, found, status = refit(problem, jnp.asarray(place), at, start)
    if int(status) == 0:
        return float(cost), np.asarray(found), True
    # A solver that crept along a flat valley to its last step may be at the bottom all the same.
    slope, curvature = (np.asarray(each) for each in _expanded(problem, jnp.asarray(place), at, found))
    sound = np.all(np.isfinite(slope)) and np.all(np.isfinite(curvature))
    return float(cost), np.asarray(found), bool(sound) and newton_gain(slope, curvature) <= _FINISHED


def _on_one_gradient(problem: Problem, solution: Float[np.ndarray, " n"]) -> Refit:
    """In coordinates in which the cost curves by one at the fit, where a search takes a few steps."""
    cost = cost_of(problem)
    curvature = expand(cost, solution).curvature

    def refit(place: int, held: float, others: Float[np.ndarray, " k"]) -> tuple[float, Float[np.ndarray, " k"], bool]:
        def gradient(each: Float[np.ndarray, " k"]) -> tuple[float, Float[np.ndarray, " k"]]:
            value, slope = cost(np.insert(each, place, held))
            return value, np.delete(slope, place)

        if len(others) == 0:
            return gradient(others)[0], others, True
        factor = whitening(np.delete(np.delete(curvature, place, 0), place, 1))
        found = descend(gradient, others, factor)
        if np.isfinite(found.value) and found.gain > _FINISHED:
            # Far from the fit its curvature is not that of the cost: once more, with the one that is there.
            found = descend(gradient, found.point)
        return found.value, found.point, found.gain <= _FINISHED

    return refit


def _solution(fit: Fit) -> Float[np.ndarray, " n"]:
    if fit.method == "l-bfgs-b":
        return np.asarray(_unconstrained(fit.problem, jnp.asarray(fit.values)))
    return np.asarray(fit.starts.solutions)[int(fit.starts.best)]


class _Search:
    """Goes outward from the minimum with the other constants following, and remembers what it saw."""

    def __init__(self, fit: Fit, place: int, threshold: float, refit: Refit) -> None:
        self._problem, self._place, self._threshold, self._refit = fit.problem, place, threshold, refit
        solution = _solution(fit)
        self._centre = float(np.clip(solution[place], -_FURTHEST, _FURTHEST))
        self._others = np.clip(np.delete(solution, place), -2.0 * _FURTHEST, 2.0 * _FURTHEST)
        self._minimum = fit.cost
        self._step = _FIRST_STEP * self._width(fit)
        self.tried: dict[float, float] = {self._centre: 0.0}
        self._ended: list[bool] = []

    def count(self) -> tuple[int, int]:
        """Refits so far, and how many of them did not come to a minimum."""
        return len(self._ended), self._ended.count(False)

    def _width(self, fit: Fit) -> float:
        """About one standard deviation in the unconstrained coordinate."""
        entry = fit.problem.parameters.entries[self._place]
        error, at = float(fit.uncertainty.standard_errors[self._place]), float(fit.values[self._place])
        slope = float(np.exp(np.asarray(entry.parameter.transform.log_derivative(self._centre))))
        width = error / slope if slope > 0.0 else np.inf
        return float(np.clip(width, 1e-6 * max(abs(self._centre), 1e-3), 1.0)) if at == at else 1.0

    def side(self, sign: float) -> tuple[float, Stop]:
        """Where the cost crosses the threshold on one side, and why the search ended there."""
        inner, others, step = self._centre, self._others, self._step
        entry = self._problem.parameters.entries[self._place]
        for _ in range(_MOST_STEPS):
            outer = inner + sign * step
            rise, found = self._rise(outer, others)
            if not np.isfinite(rise):
                return inner, Stop.NOT_FITTED
            if rise < -_LOWER_MINIMUM:
                return outer, Stop.LOWER_MINIMUM
            if rise >= self._threshold:
                return self._refine(inner, outer, others), Stop.CROSSED
            if entry.parameter.transform.end(outer) is not None:
                return outer, Stop.BOUND
            if abs(outer - self._centre) > _FURTHEST:
                return outer, Stop.FLAT
            inner, others, step = outer, found, step * _GROWTH
        return inner, Stop.FLAT

    def _refine(self, inner: float, outer: float, others: Float[np.ndarray, " k"]) -> float:
        """Secant steps on the root of the rise, which is close to straight, kept within the bracket."""
        low, high = inner, outer
        for _ in range(_BISECTIONS):
            a, b = (np.sqrt(max(self.tried[each], 0.0)) for each in (low, high))
            share = (np.sqrt(self._threshold) - a) / (b - a) if b > a else 0.5
            middle = low + float(np.clip(share, 0.05, 0.95)) * (high - low)
            rise, found = self._rise(middle, others)
            if abs(rise - self._threshold) < 1e-3:
                return middle
            if rise < self._threshold:
                low, others = middle, found
            else:
                high = middle
        return 0.5 * (low + high)

    def _rise(self, held: float, others: Float[np.ndarray, " k"]) -> tuple[float, Float[np.ndarray, " k"]]:
        cost, found, converged = self._refit(self._place, held, others)
        rise = cost - self._minimum
        self._ended.append(converged)
        self.tried[held] = rise
        return rise, found


def _joined(others, place, held):
    """The flat vector with a held number at a place; the place may be traced."""
    length = others.shape[0] + 1
    index = jnp.arange(length)
    source = jnp.clip(jnp.where(index > place, index - 1, index), 0, length - 2)
    return jnp.where(index == place, held, others[source])


@eqx.filter_jit
def _unconstrained(problem: Problem, values):
    parts = [entry.parameter.transform.inverse(value) for entry, value in _pairs(problem.parameters, values)]
    return jnp.stack([jnp.asarray(part) for part in parts])


def _pairs(parameters: ParameterSet, values):
    return zip(parameters.entries, values, strict=True)


@eqx.filter_jit
def _cost_alone(problem: Problem, held):
    return problem.cost(held[None])


@eqx.filter_jit
def _expanded(problem: Problem, place, held, others):
    def cost(each):
        return problem.cost(_joined(each, place, held))

    return jax.grad(cost)(others), jax.hessian(cost)(others)


@eqx.filter_jit
def _refit_squares(problem: Problem, place, held, start):
    found = multi_start(lambda others, _: problem.residuals(_joined(others, place, held)), start[None])
    solution = jnp.asarray(found.solutions)[0]
    return problem.cost(jnp.asarray(_joined(solution, place, held))), solution, found.status[0]


@eqx.filter_jit
def _refit(problem: Problem, place, held, start):
    found = multi_start_minimise(lambda others, _: problem.cost(_joined(others, place, held)), start[None])
    return found.costs[0], jnp.asarray(found.solutions)[0], found.status[0]
