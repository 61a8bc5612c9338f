r"""Fit of a heating and cooling course to the mean temperature of a region, as thermometry gives it.

The model is a Gaussian source of heat, $\exp(-r^2/a^2 - z^2/b^2)$, that is on from `start` for `duration` in a uniform
medium without perfusion, solved by the package's finite volumes with phases whose lengths are fitted.

What a course can tell. Lengths and diffusivity $\kappa$ enter only as the diffusion time $a^2 / (4 \kappa)$: neither
the width nor the diffusivity by itself. The mean over a region with Gaussian weight of radius $w$ is the course in the
middle of a source of $a^2 + w^2$ in place of $a^2$ (likewise along the axis): the region is absorbed by the width.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax import AxisymmetricGrid, InputError, solve_bioheat
from arfjax.grid import graded_positions
from arfjax.instruments.thermocouple import Thermocouple
from arfjax.media import Scalar, ThermalMedium
from arfjax.numerics.interpolation import interpolation_weights
from arfjax.thermal.bioheat import Insulated, Phase, TemperatureHistory, Walls, uniform_field
from inverse.datasets.thermometry import ThermometryData
from inverse.least_squares import MultiStart, multi_start
from inverse.parameters import Interval, LogInterval, Parameter, Positive, constrain, unconstrain
from inverse.uncertainty import Uncertainty, assess

COURSE_ACCURACY = 2.5e-3
"""Largest error of `temperature_rise`, relative to its amplitude, for constants within the bounds of the fit."""
STRONG_CORRELATION = 0.95
"""Correlation of two constants above which a report names the pair."""
CORRELATED_RESIDUALS = 0.5
"""Correlation of residuals of successive rows above which standard errors are said to be too small."""

_FINEST, _GROWTH, _EXTENT = 0.15, 1.2, 60.0  # of the grid, in radii a
_PARTS = (1.0 / 24.0, 1.0 / 4.0, 1.0)  # of heating and of cooling, in ever longer steps
_STEPS = 8  # in each part
_SHORTEST_TIME, _LONGEST_TIME = 1.0 / 100.0, 100.0  # diffusion time over the span of the data
_CURVE_POINTS = 401
_FLATTEST, _LONGEST = 0.25, 400.0  # ratio of diffusion times


class GaussianHeating(eqx.Module):
    """Heating by a Gaussian source and what follows, as five constants.

    Attributes:
        amplitude: Rise in the middle when the heat is switched off [K].
        diffusion_time: Squared radius of source and region over four diffusivities, a^2 / (4 kappa) [s].
        diffusion_time_ratio: Diffusion time along the axis over that across it, b^2 / a^2 [1].
        start: When the heat is switched on [s].
        duration: For how long it is on [s].
    """

    amplitude: Scalar
    diffusion_time: Scalar
    diffusion_time_ratio: Scalar
    start: Scalar
    duration: Scalar


CONSTANTS = (
    ("amplitude", "K", "$A$"),
    ("diffusion_time", "s", r"$\tau$"),
    ("diffusion_time_ratio", "1", r"$\rho$"),
    ("start", "s", "$t_0$"),
    ("duration", "s", "$D$"),
)
"""Name, unit and label of the constants, in the order of `GaussianHeating`."""


def temperature_rise(
    heating: GaussianHeating, time: Float[Array, " n"] | Float[np.ndarray, " n"]
) -> Float[Array, " n"]:
    """Rise in the middle of the source [K] at times [s].

    Accuracy: `COURSE_ACCURACY` of the amplitude, from steps that are short after switching and cells that are small in
    the middle; between steps by cubics.
    Differentiability: in every constant and in time, with a jump of slope at the start and at the end of the heat.
    """
    grid = _grid()
    medium = ThermalMedium(0.25 / heating.diffusion_time, 1.0, 0.0)  # lengths in radii, a unit heat capacity
    heat = jnp.exp(-jnp.asarray(grid.r**2)[:, None] - jnp.asarray(grid.z**2)[None, :] / heating.diffusion_time_ratio)
    time = jnp.asarray(time)
    span = jnp.max(time) - jnp.min(time)
    history = solve_bioheat(
        uniform_field(medium, grid),
        heat,
        grid,
        phases=_phases(heating.duration, 1.0) + _phases(span, 0.0),
        initial_temperature=0.0,
        arterial_temperature=0.0,
        walls=Walls(near=Insulated()),  # the plane of symmetry
    )
    middle = Thermocouple()(history, grid, z=0.0)
    return heating.amplitude * _course(history, middle, time - heating.start, heating.duration, span)


def _grid() -> AxisymmetricGrid:
    """One half of the space around the source, in radii a."""
    faces = graded_positions(0.0, _EXTENT, 0.0, finest=_FINEST, growth=_GROWTH, coarsest=_EXTENT)
    return AxisymmetricGrid(faces, faces)


def _phases(duration: Scalar, power: float) -> list[Phase]:
    """Parts of a stretch of time, each of the same number of steps."""
    lengths = np.diff(_PARTS, prepend=0.0)
    return [Phase(duration=duration * float(length), n_steps=_STEPS, power=power) for length in lengths]


def _course(
    history: TemperatureHistory, middle: Float[Array, " time"], since: Float[Array, " n"], duration: Scalar, span: Array
) -> Float[Array, " n"]:
    """The middle's rise over that at switch-off, at times since switch-on."""
    last = len(_PARTS) * _STEPS
    hot = interpolation_weights(jnp.clip(since, 0.0, duration), history.time[: last + 1]) @ middle[: last + 1]
    after = interpolation_weights(jnp.clip(since, duration, duration + span), history.time[last:]) @ middle[last:]
    return jnp.where(since <= 0.0, 0.0, jnp.where(since < duration, hot, after)) / middle[last]


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
        return (*outcome, *unsure, *_pairs(self.uncertainty), *self._noise())

    def _noise(self) -> tuple[str, ...]:
        if abs(self.autocorrelation) < CORRELATED_RESIDUALS:
            return ()
        return (
            f"Residuals of successive rows are correlated ({self.autocorrelation:+.2f}): the model lacks something, "
            "and the standard errors, which assume independent noise, are too small.",
        )


def fit_heating(
    data: ThermometryData, *, baseline: float | None = None, seed: int = 0, n_starts: int = 4
) -> HeatingFit:
    """Fit `GaussianHeating` to a course of temperature.

    Rows marked as occluded are left out: what was not seen is no measurement, and a value put in its place would
    count like one. Rows are weighted by their standard deviations where the file gives them.

    Args:
        data: From `read_thermometry`.
        baseline: Temperature before heating, from which rises are counted [degC]; that of the first row when None.
        seed: Of the starts but the first, which is read off the data.
        n_starts: Number of starts.

    Raises:
        InputError: if too few rows can be used, or temperature never rises.
        ValueError: if JAX runs in single precision.
    """
    if jnp.result_type(float) != jnp.float64:
        raise ValueError("fits need double precision; call jax.config.update('jax_enable_x64', True) first.")
    used = ~data.occluded
    baseline = float(data.temperature[0]) if baseline is None else baseline
    _require_heating(data, used, baseline)
    time, rise = data.time[used], data.temperature[used] - baseline
    scale = np.ones(len(time)) if data.sd is None else data.sd[used]
    parameters = _parameters(time, rise)
    starts = _starts(parameters, time, rise, n_starts, seed)
    result = _solve(parameters, starts, time, rise, scale)
    best = jnp.asarray(result.solutions)[result.best]
    curve_time = np.linspace(float(data.time[0]), float(data.time[-1]), _CURVE_POINTS)
    values, course, jacobian = _course_at(parameters, best, np.concatenate([data.time, curve_time]))
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
    return HeatingFit(
        data=data,
        baseline=baseline,
        heating=GaussianHeating(*map(float, values)),
        values=values,
        uncertainty=uncertainty,
        fitted=fitted,
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
            np.exp(rng.uniform(np.log(0.5), np.log(50.0), count)),
            on - 0.2 * (hottest - on) * rng.uniform(-0.5, 1.0, count),
            (hottest - on) * rng.uniform(0.7, 1.3, count),
        ],
        axis=-1,
    )
    values[0] = [rise.max(), 0.5 * (hottest - on), 5.0, on, hottest - on]
    return np.asarray(jax.vmap(lambda row: unconstrain(parameters, row))(values))


@eqx.filter_jit
def _solve(
    parameters: tuple[Parameter, ...], starts: np.ndarray, time: np.ndarray, rise: np.ndarray, scale: np.ndarray
) -> MultiStart:
    def residual(unconstrained: Array, _) -> Array:
        heating = GaussianHeating(*constrain(parameters, unconstrained))
        return (temperature_rise(heating, time) - rise) / scale

    return multi_start(residual, starts, rtol=1e-6, atol=1e-6, max_steps=100)


def _course_at(parameters: tuple[Parameter, ...], unconstrained: Array, time: np.ndarray) -> tuple[np.ndarray, ...]:
    """Values of the constants, the rise at times and its derivative in the values."""

    @jax.jit
    def both(values: Array) -> tuple[Array, Array]:
        def rise(values: Array) -> tuple[Array, Array]:
            course = temperature_rise(GaussianHeating(*values), time)
            return course, course

        return jax.jacfwd(rise, has_aux=True)(values)

    values = constrain(parameters, unconstrained)
    jacobian, course = both(values)
    return np.asarray(values), np.asarray(course), np.asarray(jacobian)


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
