"""The model with causes in it, refitted in full: strengths with intervals, and predictions of data left out."""

import dataclasses
import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy import optimize, stats

from inverse.diagnosis.cause import DmaCause, DmaConditions, Extension
from inverse.diagnosis.dma_problem import DmaProblem, predict_coordinates
from inverse.diagnosis.noise import Noise
from inverse.parameters import Parameter, constrain, unconstrain

INTERVAL_LEVEL = 0.95


@dataclasses.dataclass(frozen=True)
class ExtendedFit:
    """A refit with extensions.

    Attributes:
        extensions: What was added, in the shapes that fit best.
        strengths: Their fitted strengths.
        standard_errors: Of the strengths, for noise of the given kind and of the size that the fit leaves.
        intervals: Of the strengths at `INTERVAL_LEVEL`; a strength that cannot be negative has none below 0. Where a
            cause has a shape, by the profile likelihood over it.
        constants: Of every sweep.
        residuals: Measured less predicted, weighted.
        converged: Whether it did.
        status: The outcome in words.
    """

    extensions: tuple[Extension, ...]
    strengths: Float[np.ndarray, " extension"]
    standard_errors: Float[np.ndarray, " extension"]
    intervals: Float[np.ndarray, "extension 2"]
    constants: Float[np.ndarray, "sweep 4"]
    residuals: Float[np.ndarray, " n"]
    converged: bool
    status: str


def fit_extended(
    problem: DmaProblem,
    extensions: Sequence[Extension],
    noise: Noise,
    start: Float[np.ndarray, " extension"],
    *,
    profile: bool = True,
) -> ExtendedFit:
    """Refit all constants, strengths and shapes together.

    Args:
        problem: The data and the fit without extensions, which is where the refit starts.
        extensions: What to add, in the shapes to start from; none refits the null model.
        noise: Member of the family that weighs the residuals.
        start: First guess of the strengths, in their units.
        profile: Whether to profile intervals over shapes; without, they are what the curvature at the best fit gives.
    """
    return Refit(problem, extensions, noise).fit(start, profile=profile)


class Refit:
    """Refits of one extended model, to all data or to parts; compiled once for each set of causes."""

    def __init__(self, problem: DmaProblem, extensions: Sequence[Extension], noise: Noise) -> None:
        """Prepare."""
        self.problem = problem
        self.extensions = tuple(extensions)
        self.white = WhiteResidual(problem, self.extensions, noise)
        self._scales = strength_scales(self.extensions)
        self._everything = np.ones(problem.rows, dtype=bool)
        self._all = jnp.ones(problem.weights.size)

    def fit(self, start: Float[np.ndarray, " extension"], *, profile: bool = True) -> ExtendedFit:
        """Refit to all data."""
        unknowns, converged, status = self.solve(start, self._everything)
        count = len(self.extensions)
        white, jacobian = self._at(unknowns)
        errors, freedom = _errors(jacobian, white, count)
        reach = float(stats.t.ppf(0.5 + 0.5 * INTERVAL_LEVEL, freedom))
        ends = unknowns[:count, None] + reach * errors[:, None] * np.array([-1.0, 1.0])
        if profile:
            square = float(white @ white) * (1.0 + reach**2 / freedom)
            for which, extension in enumerate(self.extensions):
                if extension.has_shape:
                    ends[which] = self._profiled(which, unknowns, square)
        one_sided = np.array([extension.cause.sign > 0 for extension in self.extensions], dtype=bool)
        shapes = [float(shape) for shape in unknowns[count : 2 * count]]
        return ExtendedFit(
            extensions=tuple(Extension(e.cause, shape) for e, shape in zip(self.extensions, shapes, strict=True)),
            strengths=unknowns[:count] * self._scales,
            standard_errors=errors * self._scales,
            intervals=np.where(one_sided[:, None], np.maximum(ends, 0.0), ends) * self._scales[:, None],
            constants=np.asarray(_constants(self.white, jnp.asarray(unknowns))),
            residuals=self.plain(unknowns),
            converged=converged,
            status=status,
        )

    def solve(
        self, start: Float[np.ndarray, " extension"], used: Bool[np.ndarray, " row"]
    ) -> tuple[Float[np.ndarray, " unknown"], bool, str]:
        """Refit to the rows in use, from the fit to everything.

        Returns:
            Strengths in their plausible scales, shapes, then unconstrained constants; whether it converged; and how it
            ended.
        """
        free = np.asarray(_unconstrained(self.white.parameters, jnp.asarray(self.problem.moved))).ravel()
        one_sided = np.array([extension.cause.sign > 0 for extension in self.extensions], dtype=bool)
        strengths = np.where(one_sided, np.maximum(start / self._scales, _SMALL), start / self._scales)
        shapes = np.array([float(extension.shape) for extension in self.extensions])
        first = np.concatenate([strengths, shapes, np.clip(free, -_FARTHEST, _FARTHEST)])
        moved = np.concatenate(
            [np.ones(len(strengths), dtype=bool), [e.has_shape for e in self.extensions], np.ones(len(free), dtype=bool)]
        ).astype(bool)
        return self._solve(first, moved, used)

    def plain(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " n"]:
        """Measured less predicted, weighted but not whitened."""
        return np.asarray(_plain(self.white, jnp.asarray(unknowns)))

    def _at(self, unknowns) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n unknown"]]:
        white, jacobian = _white_and_slope(self.white, jnp.asarray(unknowns), self._all)
        return np.asarray(white), np.asarray(jacobian)

    def _solve(self, first, moved, used) -> tuple[Float[np.ndarray, " unknown"], bool, str]:
        """Least squares in the unknowns that are moved."""
        count = len(self.extensions)
        lower, upper = np.full(len(first), -np.inf), np.full(len(first), np.inf)
        for which, extension in enumerate(self.extensions):
            lower[which] = 0.0 if extension.cause.sign > 0 else -np.inf
            lower[count + which], upper[count + which] = extension.cause.shapes[0], extension.cause.shapes[-1]
        mask = jnp.asarray(np.repeat(used.astype(float), self.problem.weights.shape[1]))
        kept: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

        def both(part):
            # The solver asks for the slope where it has just asked for the value.
            if (key := part.tobytes()) not in kept:
                kept.clear()
                whole = first.copy()
                whole[moved] = part
                value, slope = _white_and_slope(self.white, jnp.asarray(whole), mask)
                kept[key] = np.asarray(value), np.asarray(slope)[:, moved]
            return kept[key]

        solution = optimize.least_squares(
            lambda part: both(part)[0],
            np.clip(first, lower, upper)[moved],
            jac=lambda part: both(part)[1],  # pyright: ignore[reportArgumentType]
            bounds=(lower[moved], upper[moved]),
            x_scale="jac",
            ftol=1e-10,
            xtol=1e-8,
            max_nfev=200,
        )
        unknowns = first.copy()
        unknowns[moved] = solution.x
        return unknowns, bool(solution.success), str(solution.message)

    def _profiled(self, which: int, best: Float[np.ndarray, " unknown"], square: float) -> Float[np.ndarray, " 2"]:
        """Strengths whose best sum of squares over shapes and constants stays below a bound.

        At a given shape the sum of squares is a parabola in the strength as good as anything; shapes are tried one by
        one because the strength that fits bends with them.
        """
        count, ends = len(self.extensions), []
        shapes = self.extensions[which].cause.shapes
        place = count + which
        held = np.isin(np.arange(len(best)), np.arange(count, 2 * count))
        for shape in np.unique(np.append(np.linspace(shapes[0], shapes[-1], _PROFILED), best[place])):
            first = best.copy()
            first[place] = shape
            unknowns = self._solve(first, ~held, self._everything)[0]
            white, jacobian = self._at(unknowns)
            room = square - float(white @ white)
            if room < 0.0:
                continue
            jacobian = np.where(held, 0.0, jacobian)
            errors, freedom = _errors(jacobian, white, count)
            half = math.sqrt(room) * errors[which] / math.sqrt(float(white @ white) / freedom)
            ends += [unknowns[which] - half, unknowns[which] + half]
        return np.array([min(ends), max(ends)])


_SMALL = 1e-3
"""Part of the plausible strength at which one that cannot be negative starts at least."""
_FARTHEST = 12.0
"""Unconstrained numbers beyond which a constant is at its bound and no derivative would bring it back."""
_PROFILED = 9
"""Shapes at which the strength is profiled, beside the best."""


def strength_scales(extensions: Sequence[Extension]) -> Float[np.ndarray, " extension"]:
    """Plausible strengths, in which the solver counts."""
    return np.array([extension.cause.plausible for extension in extensions], dtype=float)


class WhiteResidual(eqx.Module):
    """Whitened residuals as a function of strengths, shapes and unconstrained constants."""

    conditions: DmaConditions
    parameters: tuple[tuple[Parameter, ...], ...]
    measured: Float[np.ndarray, "row coordinate"]
    weights: Float[np.ndarray, "row coordinate"]
    log_deviation: Float[np.ndarray, " n"]
    previous: Int[np.ndarray, " n"]
    scales: Float[np.ndarray, " extension"]
    correlation: Float[Array, ""]
    causes: tuple[DmaCause, ...]
    fractional: bool = eqx.field(static=True)
    has_phase: bool = eqx.field(static=True)

    def __init__(self, problem: DmaProblem, extensions: tuple[Extension, ...], noise: Noise) -> None:
        """Take what is needed from the problem."""
        self.conditions = problem.conditions
        # As arrays, so that other data of the same shape need no new compilation.
        self.parameters = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), problem.parameters)
        self.measured, self.weights = problem.measured, problem.weights
        self.log_deviation, self.previous = noise.log_deviation, noise.ordering.previous
        self.correlation = jnp.asarray(noise.correlation)
        self.scales = strength_scales(extensions)
        self.causes = tuple(extension.cause for extension in extensions)
        self.fractional, self.has_phase = problem.model.fractional, problem.has_phase

    def constants(self, unknowns: Float[Array, " unknown"]) -> Float[Array, "sweep 4"]:
        """Reported constants of every sweep; order 1 for the conventional solid."""
        rows = unknowns[2 * len(self.causes) :].reshape(len(self.parameters), -1)
        values = [constrain(one, row) for one, row in zip(self.parameters, rows, strict=True)]
        moved = jnp.stack(values)
        order = moved[:, 3:] if self.fractional else jnp.ones((len(values), 1))
        return jnp.concatenate([moved[:, :1], moved[:, :1] + moved[:, 1:2], moved[:, 2:3], order], axis=1)

    def plain(self, unknowns: Float[Array, " unknown"]) -> Float[Array, " n"]:
        """Measured less predicted, weighted."""
        count = len(self.causes)
        shapes = unknowns[count : 2 * count]
        extensions = tuple(Extension(cause, shapes[i]) for i, cause in enumerate(self.causes))
        predicted = predict_coordinates(
            self.constants(unknowns), self.conditions, extensions, unknowns[:count] * self.scales, self.has_phase
        )
        return jnp.ravel(self.weights * (self.measured - predicted))

    def __call__(self, unknowns: Float[Array, " unknown"], mask: Float[Array, " n"]) -> Float[Array, " n"]:
        """The same in coordinates in which the noise is white; what the mask leaves out is zero."""
        scaled = mask * self.plain(unknowns) * jnp.exp(-self.log_deviation)
        later = (self.previous >= 0) & (mask[self.previous] > 0.0)
        innovation = (scaled - self.correlation * scaled[self.previous]) / jnp.sqrt(1.0 - self.correlation**2)
        return mask * jnp.where(later, innovation, scaled)


@eqx.filter_jit
def _white_and_slope(residual_of: WhiteResidual, unknowns, mask):
    return residual_of(unknowns, mask), jax.jacfwd(residual_of)(unknowns, mask)


@eqx.filter_jit
def _plain(residual_of: WhiteResidual, unknowns):
    return residual_of.plain(unknowns)


@eqx.filter_jit
def _unconstrained(parameters, moved):
    return jnp.stack([unconstrain(one, row) for one, row in zip(parameters, moved, strict=True)])


@eqx.filter_jit
def _constants(residual_of: WhiteResidual, unknowns):
    return residual_of.constants(unknowns)


def _errors(jacobian, white, count: int) -> tuple[Float[np.ndarray, " extension"], int]:
    """Standard errors of the first `count` unknowns with all others free, and the degrees of freedom left."""
    lengths = np.linalg.norm(jacobian, axis=0)
    felt = lengths > 1e-12 * np.max(lengths)
    _, singular, directions = np.linalg.svd(jacobian[:, felt] / lengths[felt], full_matrices=False)
    kept = singular > 1e-9 * singular[0]
    freedom = max(len(white) - int(np.sum(kept)), 1)
    errors = np.full(len(lengths), np.inf)
    covariance = np.sum((directions[kept] / singular[kept, None]) ** 2, axis=0) / lengths[felt] ** 2
    errors[felt] = np.sqrt(covariance * float(white @ white) / freedom)
    return errors[:count], freedom
