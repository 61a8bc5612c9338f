"""Fit of a heating and cooling course to the mean temperature of a region, as thermometry gives it.

The model, and what such a course can tell at all, is in `inverse.thermometry_model`.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax import InputError
from inverse.datasets.thermometry import ThermometryData
from inverse.least_squares import STATUS, Descent, MultiStart, descend
from inverse.parameters import Parameter, constrain, unconstrain
from inverse.precision import require_double_precision
from inverse.thermometry_doubts import of_short_heat, of_switch_off
from inverse.thermometry_model import CONSTANTS, GaussianHeating, temperature_rise
from inverse.transforms import Interval, LogInterval, Positive
from inverse.uncertainty import Uncertainty, assess

STRONG_CORRELATION = 0.95
"""Correlation of two constants above which a report names the pair."""
CORRELATED_RESIDUALS = 0.5
"""Correlation of residuals of successive rows, of either sign, above which standard errors are said to be wrong."""

_SHORTEST_TIME, _LONGEST_TIME = 1.0 / 100.0, 100.0  # diffusion time over the span of the data
_RATIO = 2  # its place among the constants
_CURVE_POINTS = 401
_FLATTEST, _LONGEST = 1.0, 400.0  # ratio of diffusion times: a beam's source is longer along the beam than across
_PROFILE = (1.01, 1.5, 2.5, 5.0, 10.0, 20.0, 40.0, 80.0, 390.0)  # ratios at which the others are fitted again
_SIGNIFICANT = 3.84  # rise of chi-square that bounds 95 % of one constant
_LOWER_MINIMUM = 0.02  # fall of chi-square below the fit's that is a lower minimum and not rounding
_HOLD = 1e3  # of the row that holds the ratio
_MAX_STEPS = 60


@dataclasses.dataclass(frozen=True)
class HeatingFit:
    """A course fitted to a measurement.

    Attributes:
        data: The measurement.
        baseline: Temperature from which rises are counted [degC].
        heating: The fitted constants.
        values: The same in the order of `CONSTANTS`.
        uncertainty: Standard errors, correlations and what the data do not fix.
        fitted: Temperature of the fit at all rows [degC].
        ratio_range: Ratios of diffusion times between which chi-square, with all else fitted again, is within 95 %
            of its lowest; None where an end of the fit's own range is.
        ratio_doubt: What is wrong with that range, in a sentence; empty if nothing is.
        baseline_unseen: Whether the baseline was taken from a row that is occluded.
        curve_time: Evenly spaced times from the first row to the last [s].
        curve: Temperature of the fit there [degC].
        used: Rows that were fitted: those that are not occluded.
        rms: Root mean square of measured minus fitted, of these rows [K].
        noise_sd: Standard deviation of the noise as the residuals have it, degrees of freedom counted [K].
        autocorrelation: Correlation of the residuals of successive rows.
        n_starts: Number of starts.
        n_agreeing: How many of them reached this minimum.
        seed: Of the starts.
        converged: Whether the best start converged.
        status: The outcome in words.
    """

    data: ThermometryData
    baseline: float
    heating: GaussianHeating
    values: Float[np.ndarray, " n"]
    uncertainty: Uncertainty
    fitted: Float[np.ndarray, " rows"]
    ratio_range: tuple[float | None, float | None]
    ratio_doubt: str
    baseline_unseen: bool
    curve_time: Float[np.ndarray, " curve"]
    curve: Float[np.ndarray, " curve"]
    used: np.ndarray
    rms: float
    noise_sd: float
    autocorrelation: float
    n_starts: int
    n_agreeing: int
    seed: int
    converged: bool
    status: str

    @property
    def residuals(self) -> Float[np.ndarray, " rows"]:
        """Measured minus fitted [K]."""
        return self.data.temperature - self.fitted

    @property
    def warnings(self) -> tuple[str, ...]:
        """Everything that a reader of the numbers has to know."""
        outcome = () if self.converged else (f"The fit did not converge: {self.status}.",)
        unsure = (*self.uncertainty.not_identified.values(), *self.uncertainty.remarks)
        doubt = (self.ratio_doubt,) if self.ratio_doubt else ()
        return (
            *outcome, *unsure, *_pairs(self.uncertainty), self._profile(), *doubt, *self._noise(), *self._of_baseline()
        )  # fmt: skip

    def _of_baseline(self) -> tuple[str, ...]:
        if not self.baseline_unseen:
            return ()
        return (
            f"The baseline of {self.baseline:g} degC is that of the first row, which is occluded: rises are from a "
            "value that was not seen; give the temperature before heating (--baseline) if it is another.",
        )

    def _profile(self) -> str:
        low, high = self.ratio_range
        below = f"{low:.2g}" if low is not None else f"the lower end of its range ({_FLATTEST:g})"
        above = f"{high:.2g}" if high is not None else f"the upper end of its range ({_LONGEST:g})"
        return (
            f"With all else fitted again, the data hold diffusion_time_ratio only between {below} and {above} (95 %)."
        )

    def _noise(self) -> tuple[str, ...]:
        if abs(self.autocorrelation) < CORRELATED_RESIDUALS:
            return ()
        said = f"Residuals of successive rows are correlated ({self.autocorrelation:+.2f}): "
        if self.autocorrelation > 0.0:
            why = "the model lacks something, and the standard errors, which assume independent noise, are too small."
        else:
            why = "they alternate, so that the standard errors, which assume independent noise, are too large."
        return (said + why,)


def fit_heating(
    data: ThermometryData,
    *,
    baseline: float | None = None,
    seed: int = 0,
    n_starts: int = 4,
    on_step: Callable[[str], None] = lambda what: None,
) -> HeatingFit:
    """Fit `GaussianHeating` to a course of temperature.

    Rows marked as occluded are left out: what was not seen is no measurement, and a value put in its place would
    count like one. Rows are weighted by their standard deviations where the file gives them.

    Args:
        data: From `read_thermometry`.
        baseline: Temperature before heating, from which rises are counted [degC]; that of the first row when None.
        seed: Of the starts but the first, which is read off the data.
        n_starts: Number of starts.
        on_step: Told in words how far it is.

    Raises:
        InputError: if too few rows can be used, or temperature never rises.
        ValueError: if JAX runs in single precision.
    """
    require_double_precision()
    used = ~data.occluded
    unseen = baseline is None and bool(data.occluded[0])
    baseline = float(data.temperature[0]) if baseline is None else baseline
    _require_heating(data, used, baseline)
    time, rise = data.time[used], data.temperature[used] - baseline
    scale = np.ones(len(time)) if data.sd is None else data.sd[used]
    parameters = _parameters(time, rise)
    starts = _starts(parameters, time, rise, n_starts, seed)
    problem = _Problem(
        time=jnp.asarray(time),
        rise=jnp.asarray(rise),
        scale=jnp.asarray(scale),
        parameters=jax.tree.map(jnp.asarray, parameters),
        hold=jnp.asarray(0.0),
        held_ratio=jnp.asarray(2.0),
    )
    result = _best_of(problem, starts, on_step)
    best = jnp.asarray(result.solutions)[result.best]
    curve_time = np.linspace(float(data.time[0]), float(data.time[-1]), _CURVE_POINTS)
    values = np.asarray(constrain(parameters, best))
    times = jnp.concatenate([data.time, curve_time])
    jacobian, course = map(np.asarray, _course_at(jnp.asarray(values), times))
    fitted, curve = np.split(baseline + course, [len(data)])
    left = (data.temperature - fitted)[used]
    uncertainty = assess(
        jacobian[: len(data)][used] / scale[:, None],
        left / scale,
        values,
        parameters,
        ends=[p.transform.end(float(u)) for p, u in zip(parameters, best, strict=True)],
        in_standard_deviations=data.sd is not None,
    )
    uncertainty = of_switch_off(of_short_heat(uncertainty, values, time), values, time)
    variance = 1.0 if data.sd is not None else uncertainty.residual_variance
    ratio_range, ratio_doubt = _ratio_range(problem, best, variance, on_step)
    return HeatingFit(
        data=data,
        baseline=baseline,
        heating=GaussianHeating(*map(float, values)),
        values=values,
        uncertainty=uncertainty,
        fitted=fitted,
        ratio_range=ratio_range,
        ratio_doubt=ratio_doubt,
        baseline_unseen=unseen,
        curve_time=curve_time,
        curve=curve,
        used=used,
        rms=float(np.sqrt(np.mean(left**2))),
        noise_sd=float(np.sqrt(np.sum(left**2) / (len(left) - len(values)))),
        autocorrelation=float(np.sum(left[1:] * left[:-1]) / max(float(np.sum(left**2)), 1e-300)),
        n_starts=n_starts,
        n_agreeing=result.n_agreeing,
        seed=seed,
        converged=result.converged,
        status=result.describe(),
    )


def _require_heating(data: ThermometryData, used: np.ndarray, baseline: float) -> None:
    count = int(np.sum(used))
    if count <= len(CONSTANTS):
        raise InputError(
            f"{data.path}: {count} rows that are not occluded cannot fix {len(CONSTANTS)} constants and their errors; "
            f"expected {len(CONSTANTS) + 1} or more, before and after the heat is switched off."
        )
    hottest = int(np.argmax(data.temperature[used]))
    rise = float(data.temperature[used][hottest]) - baseline
    if rise <= 0.0 or hottest == 0:
        raise InputError(
            f"{data.path}: temperature never rises above its baseline of {baseline:g} degC after the first row; "
            "expected a course that is heated. If it starts hot, give the temperature before heating (--baseline)."
        )


def _parameters(time: np.ndarray, rise: np.ndarray) -> tuple[Parameter, ...]:
    span, hottest = float(time[-1] - time[0]), float(time[np.argmax(rise)])
    transforms = (
        Positive(float(rise.max())),
        LogInterval(_SHORTEST_TIME * span, _LONGEST_TIME * span),
        LogInterval(_FLATTEST, _LONGEST),
        Interval(float(time[0]) - 0.25 * span, hottest),
        Interval(0.0, 2.0 * span),
    )
    return tuple(
        Parameter(name, unit, transform, label)
        for (name, unit, label), transform in zip(CONSTANTS, transforms, strict=True)
    )


def _starts(
    parameters: tuple[Parameter, ...], time: np.ndarray, rise: np.ndarray, count: int, seed: int
) -> Float[np.ndarray, "start n"]:
    """Unconstrained starts: the first from the data's range, the others drawn about it."""
    rng = np.random.default_rng(seed)
    span, hottest = float(time[-1] - time[0]), float(time[np.argmax(rise)])
    warm = float(time[np.argmax(rise > 0.1 * rise.max())])
    on = min(warm, hottest - 0.1 * (hottest - float(time[0])) - 1e-3 * span)
    values = np.stack(
        [
            rise.max() * rng.uniform(0.7, 1.4, count),
            (hottest - on) * np.exp(rng.uniform(-2.0, 1.5, count)),
            np.exp(rng.uniform(np.log(1.2), np.log(50.0), count)),
            on - 0.2 * (hottest - on) * rng.uniform(-0.5, 1.0, count),
            (hottest - on) * rng.uniform(0.7, 1.3, count),
        ],
        axis=-1,
    )
    values[0] = [rise.max(), 0.5 * (hottest - on), 5.0, on, hottest - on]
    for column, parameter in enumerate(parameters):  # what lies outside an interval has no unconstrained value
        if isinstance(parameter.transform, LogInterval):
            low, high = float(parameter.transform.lower), float(parameter.transform.upper)
            values[:, column] = np.clip(values[:, column], 1.1 * low, 0.9 * high)
    return np.asarray(jax.vmap(lambda row: unconstrain(parameters, row))(values))


class _Problem(eqx.Module):
    """What a residual needs: arrays only, so that every fit of as many rows runs the same compiled program."""

    time: Array
    rise: Array
    scale: Array
    parameters: tuple[Parameter, ...]
    hold: Array
    held_ratio: Array


def _residual(unconstrained: Array, problem: _Problem) -> Array:
    """Misfit of every row, and a row that holds the ratio where it is to be held."""
    values = constrain(problem.parameters, unconstrained)
    misfit = (temperature_rise(GaussianHeating(*values), problem.time) - problem.rise) / problem.scale
    held = problem.hold * (unconstrained[_RATIO] - problem.parameters[_RATIO].transform.inverse(problem.held_ratio))
    return jnp.append(misfit, held)


def _descend(problem: _Problem, start: Array | np.ndarray, on_step: Callable[[str], None], what: str) -> Descent:
    def tell(step: int, cost: float) -> None:
        on_step(f"{what}: step {step}, cost {cost:.4g}")

    return descend(_residual, jnp.asarray(start), problem, rtol=1e-6, atol=1e-6, max_steps=_MAX_STEPS, on_step=tell)


def _best_of(problem: _Problem, starts: np.ndarray, on_step: Callable[[str], None]) -> MultiStart:
    ends = [
        _descend(problem, start, on_step, f"start {number} of {len(starts)}")
        for number, start in enumerate(starts, start=1)
    ]
    costs = [0.5 * float(jnp.sum(end.residual**2)) for end in ends]
    return MultiStart(
        solutions=np.stack([np.asarray(end.solution) for end in ends]),
        costs=np.nan_to_num(np.asarray(costs), nan=np.inf),
        status=np.asarray([STATUS.index(end.message) for end in ends]),
        steps=np.asarray([len(end.costs) for end in ends]),
    )


def _ratio_range(
    problem: _Problem, best: Array, variance: float, on_step: Callable[[str], None]
) -> tuple[tuple[float | None, float | None], str]:
    """Ratios at which chi-square, minimised over the other constants, has risen by `_SIGNIFICANT`, and any doubt."""
    lowest, logs, rises = float(jnp.sum(_residual(best, problem) ** 2)), [], []
    stopped = 0
    middle = float(constrain(problem.parameters, best)[_RATIO])
    for ratio in _PROFILE:
        held = eqx.tree_at(lambda p: (p.hold, p.held_ratio), problem, (jnp.asarray(_HOLD), jnp.asarray(ratio)))
        start = best.at[_RATIO].set(problem.parameters[_RATIO].transform.inverse(ratio))
        end = _descend(held, start, on_step, f"ratio held at {ratio:g}")
        logs.append(np.log(ratio))
        rises.append((float(jnp.sum(end.residual**2)) - lowest) / variance)
        stopped += not end.converged
    # Chi-square over the logarithm of the ratio is smooth: its root interpolates well.
    logs, depth = np.asarray([*logs, np.log(middle)]), np.sqrt(np.maximum([*rises, 0.0], 0.0))
    order = np.argsort(logs)
    logs, depth, bound = logs[order], depth[order], np.sqrt(_SIGNIFICANT)
    place = int(np.flatnonzero(order == len(_PROFILE))[0])
    ends = _crossing(logs[place::-1], depth[place::-1], bound), _crossing(logs[place:], depth[place:], bound)
    doubts = []
    if stopped:
        doubts.append(f"{stopped} of {len(_PROFILE)} fits of the other constants did not converge")
    if min(rises) < -_LOWER_MINIMUM:
        doubts.append("a ratio that was held fits better than the fit: fit again from more starts")
    return ends, f"The range of diffusion_time_ratio is in doubt: {'; '.join(doubts)}." if doubts else ""


def _crossing(logs: np.ndarray, depth: np.ndarray, bound: float) -> float | None:
    """Where `depth` first passes `bound` going outwards."""
    beyond = np.flatnonzero(depth > bound)
    if beyond.size == 0:
        return None
    i = int(beyond[0])
    share = (bound - depth[i - 1]) / (depth[i] - depth[i - 1])
    return float(np.exp(logs[i - 1] + share * (logs[i] - logs[i - 1])))


@eqx.filter_jit
def _course_at(values: Array, time: Array) -> tuple[Array, Array]:
    """Derivative of the rise in the values of the constants, and the rise, at times."""

    def rise(values: Array) -> tuple[Array, Array]:
        course = temperature_rise(GaussianHeating(*values), time)
        return course, course

    return jax.jacfwd(rise, has_aux=True)(values)


def _pairs(uncertainty: Uncertainty) -> tuple[str, ...]:
    """Sentences about constants that the data tell apart only poorly."""
    names = [name for name, _, _ in CONSTANTS]
    return tuple(
        f"{names[i]} and {names[j]} are hard to tell apart (correlation {uncertainty.correlation[i, j]:+.2f}): their "
        "errors are those of the pair, not of two separate findings."
        for i in range(len(names))
        for j in range(i)
        if abs(uncertainty.correlation[i, j]) > STRONG_CORRELATION
    )
