"""Fits of the conventional and the fractional Zener solid to dynamic mechanical analysis, one sweep at a time.

All sweeps, starts, models and residuals run in one compiled batch.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from arfjax import FractionalZener, Zener, complex_modulus
from inverse.datasets.dma import DmaData, Sweep
from inverse.dma_residuals import LinearModulus, LogModulus, ModulusResidual, Observations
from inverse.least_squares import MultiStart, multi_start
from inverse.parameters import Parameter, constrain, unconstrain
from inverse.precision import require_double_precision
from inverse.transforms import Interval, LogInterval, Positive
from inverse.uncertainty import Uncertainty, assess

_BEYOND_WINDOW = 1e6
"""How far the relaxation time may lie outside the time window of the frequencies, as a factor."""
_START_BEYOND_WINDOW = 10.0


class ZenerModel(eqx.Module):
    """A Zener solid as something to fit.

    The fit moves the relaxed modulus, the stiffness of the relaxing branch (their sum is the unrelaxed modulus, so
    that 0 <= M_0 <= M_inf holds by construction), the relaxation time and, if fractional, the order.

    Attributes:
        fractional: Whether the order is free; otherwise it is 1.
    """

    fractional: bool = eqx.field(static=True)

    @property
    def name(self) -> str:
        """What tables call the model."""
        return "fractional" if self.fractional else "zener"

    def constants(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and label of the constants that a fit reports."""
        constants = (
            ("relaxed_modulus", "Pa", "$M_0$"),
            ("unrelaxed_modulus", "Pa", r"$M_\infty$"),
            ("relaxation_time", "s", r"$\tau$"),
            ("fractional_order", "1", r"$\alpha$"),
        )
        return constants if self.fractional else constants[:3]

    def parameters(self, data: DmaData) -> tuple[Parameter, ...]:
        """What the fit moves, with bounds and scales from the data."""
        omega = 2.0 * np.pi * data.frequency_hz
        lowest, highest = float(np.min(data.modulus_magnitude)), float(np.max(data.modulus_magnitude))
        time = LogInterval(float(1.0 / (_BEYOND_WINDOW * np.max(omega))), float(_BEYOND_WINDOW / np.min(omega)))
        parameters = (
            Parameter("relaxed_modulus", "Pa", Positive(lowest), "$M_0$"),
            Parameter("branch_modulus", "Pa", Positive(highest), r"$M_\infty - M_0$"),
            Parameter("relaxation_time", "s", time, r"$\tau$"),
            Parameter("fractional_order", "1", Interval(0.0, 1.0), r"$\alpha$"),
        )
        return parameters if self.fractional else parameters[:3]

    def reported(self, moved: Float[Array, " n"]) -> Float[Array, " n"]:
        """Constants that a fit reports from the values of the parameters that it moves."""
        return jnp.concatenate([moved[:1], moved[:1] + moved[1:2], moved[2:]])

    def ends(self, data: DmaData, constants: Float[np.ndarray, " n"]) -> list[str | None]:
        """Ends of the fit's ranges at which reported constants lie ("lower" or "upper"), None for one inside of its."""
        moved = np.concatenate([constants[:1], constants[1:2] - constants[:1], constants[2:]])
        parameters = self.parameters(data)
        return _ends(parameters, np.asarray(_unconstrained(_as_arrays(parameters), moved[None, :]))[0])

    def solid(self, constants: Float[Array, " n"]) -> Zener | FractionalZener:
        """The solid from its reported constants."""
        kind = FractionalZener if self.fractional else Zener
        return kind(*constants)

    def starts(self, data: DmaData, count: int, seed: int) -> Float[np.ndarray, "start n"]:
        """Unconstrained starts: the first from the data's range, the others drawn about it."""
        rng = np.random.default_rng(seed)
        omega = 2.0 * np.pi * data.frequency_hz
        lowest, highest = np.min(data.modulus_magnitude), np.max(data.modulus_magnitude)
        early, late = 1.0 / (_START_BEYOND_WINDOW * np.max(omega)), _START_BEYOND_WINDOW / np.min(omega)
        values = np.stack(
            [
                lowest * np.exp(rng.uniform(-4.0, 0.0, count)),
                highest * np.exp(rng.uniform(-2.0, 1.5, count)),
                np.exp(rng.uniform(np.log(early), np.log(late), count)),
                rng.uniform(0.1, 0.9, count),
            ],
            axis=-1,
        )
        values[0] = [0.8 * lowest, highest, np.exp(-np.mean(np.log(omega))), 0.5]
        parameters = self.parameters(data)
        return np.asarray(_unconstrained(_as_arrays(parameters), values[:, : len(parameters)]))


def _as_arrays(parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
    """Bounds as arrays, so that other bounds need no new compilation."""
    return jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), parameters)


@eqx.filter_jit
def _unconstrained(parameters: tuple[Parameter, ...], values):
    return jax.vmap(lambda row: unconstrain(parameters, row))(values)


CONVENTIONAL = ZenerModel(fractional=False)
FRACTIONAL = ZenerModel(fractional=True)


@dataclasses.dataclass(frozen=True)
class SweepFit:
    """One model fitted to one sweep.

    Attributes:
        sweep: The measurements.
        model: What was fitted.
        residual: How model and measurement were compared.
        values: Constants of the solid, in the order of `model.constants()`.
        uncertainty: Standard errors, correlations and what the data do not fix.
        sse_log: Sum of squares of the differences of log modulus, complex if the phase was measured [1].
        sse_linear: Sum of squared magnitudes of the differences of modulus, complex if the phase was measured [Pa^2].
        sse_relative: Sum of squared relative errors of the magnitude, as the paper's table has it [1].
        n_points: Number of measured frequencies, repeats included.
        n_starts: Number of starts.
        n_agreeing: How many of them reached this minimum.
        converged: Whether the best start converged.
        status: The outcome in words.
    """

    sweep: Sweep
    model: ZenerModel
    residual: ModulusResidual
    values: Float[np.ndarray, " n"]
    uncertainty: Uncertainty
    sse_log: float
    sse_linear: float
    sse_relative: float
    n_points: int
    n_starts: int
    n_agreeing: int
    converged: bool
    status: str

    @property
    def solid(self) -> Zener | FractionalZener:
        """The fitted solid."""
        return self.model.solid(jnp.asarray(self.values))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Everything that a reader of the numbers has to know."""
        outcome = () if self.converged else (f"The fit did not converge: {self.status}.",)
        return (*outcome, *self.uncertainty.not_identified.values(), *self.uncertainty.remarks)

    def modulus(self, frequency_hz: Float[np.ndarray, " m"]) -> Complex[np.ndarray, " m"]:
        """Fitted complex modulus [Pa] at frequencies [Hz]."""
        return np.asarray(complex_modulus(self.solid, 2.0 * np.pi * frequency_hz))


@dataclasses.dataclass(frozen=True)
class NoFit:
    """A sweep that cannot fix the constants of a model, and what it does say.

    Attributes:
        sweep: The measurements.
        models: Names of the models that were not fitted.
        reason: Why.
        means: Mean modulus by kind (storage, loss, magnitude) [Pa], if all rows share one frequency.
        scatters: Standard deviation of single rows about it [Pa]; NaN of a single one.
    """

    sweep: Sweep
    models: tuple[str, ...]
    reason: str
    means: dict[str, float]
    scatters: dict[str, float]


@dataclasses.dataclass(frozen=True)
class DmaFit:
    """All fits of a data set.

    Attributes:
        sweeps: What the data were grouped into.
        fits: By residual, then model, then sweep.
        unfitted: Sweeps without a fit of some model, with the reason.
    """

    sweeps: tuple[Sweep, ...]
    fits: tuple[SweepFit, ...]
    unfitted: tuple[NoFit, ...]

    def select(self, *, model: ZenerModel | None = None, residual: ModulusResidual | None = None) -> list[SweepFit]:
        """Fits of one model or one residual."""
        return [
            fit
            for fit in self.fits
            if (model is None or fit.model == model) and (residual is None or fit.residual.name == residual.name)
        ]


def fit_sweeps(
    sweeps: Sequence[Sweep],
    *,
    models: Sequence[ZenerModel] = (CONVENTIONAL, FRACTIONAL),
    residuals: Sequence[ModulusResidual] = (LogModulus(), LinearModulus()),
    seed: int = 0,
    n_starts: int = 16,
    padded_to: int = 0,
) -> DmaFit:
    """Fit Zener solids to every sweep that can carry them.

    Args:
        sweeps: From `group_sweeps`, all with phase or all without.
        models: What to fit.
        residuals: How to compare; each gives its own fits.
        seed: Of the starts.
        n_starts: Starts of each fit.
        padded_to: Rows of a sweep that the compiled program has room for; parts of sweeps need no other then.

    Returns:
        The fits, by residual, then model, then sweep; and the sweeps that some model could not be fitted to, with the
        reason. Fits that did not converge are among the fits.

    Raises:
        ValueError: if JAX runs in single precision.
    """
    require_double_precision()
    lanes = [
        (residual, model, sweep)
        for residual in residuals
        for model in models
        for sweep in sweeps
        if sweep.data.distinct_frequencies >= len(model.constants())
    ]
    fits = _fit_lanes(lanes, tuple(residuals), seed, n_starts, padded_to) if lanes else []
    return DmaFit(tuple(sweeps), tuple(fits), _unfitted(sweeps, models))


def magnitude_only(sweeps: Sequence[Sweep]) -> tuple[Sweep, ...]:
    """The same sweeps without their phase, as the paper fitted them, and the deviations of the magnitude alone."""
    return tuple(dataclasses.replace(sweep, data=sweep.data.without_phase()) for sweep in sweeps)


def _fit_lanes(
    lanes: Sequence[tuple[ModulusResidual, ZenerModel, Sweep]],
    residuals: tuple[ModulusResidual, ...],
    seed: int,
    n_starts: int,
    padded_to: int,
) -> list[SweepFit]:
    length = max(padded_to, *(len(sweep.data) for _, _, sweep in lanes))
    observations = [residual.observations(sweep.data, length) for residual, _, sweep in lanes]
    parameters = [FRACTIONAL.parameters(sweep.data) for _, _, sweep in lanes]
    starts = np.stack([FRACTIONAL.starts(sweep.data, n_starts, seed) for _, _, sweep in lanes])
    which = np.array([residuals.index(residual) for residual, _, _ in lanes])
    order_is_free = np.array([model.fractional for _, model, _ in lanes])
    solved = _solve(residuals, which, order_is_free, _stack(observations), _stack(parameters), starts)
    solved = jax.tree.map(np.asarray, solved)
    rows = [jax.tree.map(lambda leaf, row=row: leaf[row], solved) for row in range(len(lanes))]
    return [
        _summarise(*lane, *given, *row)
        for lane, given, row in zip(lanes, zip(observations, parameters, strict=True), rows, strict=True)
    ]


@eqx.filter_jit
def _solve(residuals: tuple[ModulusResidual, ...], which, order_is_free, observations, parameters, starts):
    """Best fit of every lane with its Jacobian in the reported constants.

    A lane picks its residual by index, and a held order is 1 and has no effect, so that one program serves them all:
    compiling it takes far longer than running it.
    """

    def one(which, free, observations: Observations, parameters: tuple[Parameter, ...], starts):
        def of_constants(constants):
            held = constants.at[3].set(jnp.where(free, constants[3], 1.0))
            modulus = complex_modulus(FRACTIONAL.solid(held), observations.angular_frequency)
            return jnp.stack([residual(modulus, observations) for residual in residuals])[which]

        def constants_at(unconstrained):
            return FRACTIONAL.reported(constrain(parameters, unconstrained))

        result = multi_start(lambda u, _: of_constants(constants_at(u)), starts)
        constants = constants_at(result.solutions[result.best])
        return result, constants, of_constants(constants), jax.jacfwd(of_constants)(constants)

    return eqx.filter_vmap(one)(which, order_is_free, observations, parameters, starts)


def _stack(trees: Sequence):
    return jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf, dtype=float) for leaf in leaves]), *trees)


def _summarise(
    residual: ModulusResidual,
    model: ZenerModel,
    sweep: Sweep,
    observations: Observations,
    parameters: tuple[Parameter, ...],
    result: MultiStart,
    values: Float[np.ndarray, " n"],
    residuals: Float[np.ndarray, " m"],
    jacobian: Float[np.ndarray, "m n"],
) -> SweepFit:
    used, count = observations.in_use, len(model.constants())
    values, parameters = values[:count], parameters[:count]
    uncertainty = assess(
        jacobian[used, :count],
        residuals[used],
        values,
        _as_reported(model, parameters),
        ends=_ends(parameters, np.asarray(result.solutions)[int(result.best), :count]),
        in_standard_deviations=residual.standard_deviations(sweep.data) is not None,
    )
    fitted = np.asarray(complex_modulus(model.solid(jnp.asarray(values)), 2.0 * np.pi * sweep.data.frequency_hz))
    return SweepFit(
        sweep=sweep,
        model=model,
        residual=residual,
        values=values,
        uncertainty=uncertainty,
        **_sums_of_squares(fitted, sweep.data),
        n_points=len(sweep.data),
        n_starts=len(result.costs),
        n_agreeing=result.n_agreeing,
        converged=result.converged,
        status=result.describe(),
    )


def _as_reported(model: ZenerModel, parameters: tuple[Parameter, ...]) -> list[Parameter]:
    return [
        Parameter(name, unit, parameter.transform, label)
        for (name, unit, label), parameter in zip(model.constants(), parameters, strict=True)
    ]


def _ends(parameters: tuple[Parameter, ...], unconstrained: Float[np.ndarray, " n"]) -> list[str | None]:
    """Ends at which the reported constants lie; a vanishing branch is no end of the unrelaxed modulus itself."""
    ends = [p.transform.end(float(u)) for p, u in zip(parameters, unconstrained, strict=True)]
    if ends[1] == "lower":
        ends[1] = None
    return ends


def _sums_of_squares(fitted: Complex[np.ndarray, " n"], data: DmaData) -> dict[str, float]:
    relative = np.abs(fitted) / data.modulus_magnitude
    log, linear = np.log(relative), np.abs(fitted) - data.modulus_magnitude
    if data.storage_modulus is not None and data.loss_modulus is not None:
        measured = data.storage_modulus + 1j * data.loss_modulus
        log, linear = np.log(fitted / measured), fitted - measured
    return {
        "sse_log": float(np.sum(np.abs(log) ** 2)),
        "sse_linear": float(np.sum(np.abs(linear) ** 2)),
        "sse_relative": float(np.sum((relative - 1.0) ** 2)),
    }


def _unfitted(sweeps: Sequence[Sweep], models: Sequence[ZenerModel]) -> tuple[NoFit, ...]:
    unfitted = []
    for sweep in sweeps:
        count = sweep.data.distinct_frequencies
        needed = {model.name: len(model.constants()) for model in models if count < len(model.constants())}
        if not needed:
            continue
        if count == 1:
            reason = _single_frequency(sweep.data)
        else:
            models_needed = " and ".join(f"{number} ({name})" for name, number in needed.items())
            reason = f"{count} distinct frequencies cannot fix {models_needed} constants; measure more frequencies"
        means, scatters = _repeats(sweep.data) if count == 1 else ({}, {})
        unfitted.append(NoFit(sweep, tuple(needed), reason, means, scatters))
    return tuple(unfitted)


def _single_frequency(data: DmaData) -> str:
    alone, frequency = len(data) == 1, f"{data.frequency_hz[0]:.4g} Hz"
    rows = f"its only row is at {frequency}" if alone else f"all {len(data)} rows are at {frequency}"
    instead = "its modulus is" if alone else "the mean modulus and the scatter of repeats are"
    return f"{rows}: one frequency cannot fix the constants of a Zener solid; {instead} given instead"


def _repeats(data: DmaData) -> tuple[dict[str, float], dict[str, float]]:
    kinds = {"storage": data.storage_modulus, "loss": data.loss_modulus, "magnitude": data.modulus_magnitude}
    known = {name: values for name, values in kinds.items() if values is not None}
    means = {name: float(np.mean(values)) for name, values in known.items()}
    scatters = {n: float(np.std(v, ddof=1)) if len(v) > 1 else float("nan") for n, v in known.items()}
    return means, scatters
