"""The model with causes in it, refitted in full: strengths with intervals, and predictions of data left out."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy import optimize, stats

from inverse.diagnosis.cause import DmaConditions, Extension
from inverse.diagnosis.dma_problem import DmaProblem, predict_coordinates
from inverse.diagnosis.noise import Noise
from inverse.parameters import Parameter, constrain, unconstrain

INTERVAL_LEVEL = 0.95


@dataclasses.dataclass(frozen=True)
class ExtendedFit:
    """A refit with extensions.

    Attributes:
        extensions: What was added.
        strengths: Their fitted strengths.
        standard_errors: Of the strengths, for noise of the given kind and of the size that the fit leaves.
        intervals: Of the strengths at `INTERVAL_LEVEL`; a strength that cannot be negative has none below 0.
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
) -> ExtendedFit:
    """Refit all constants and strengths together.

    Args:
        problem: The data and the fit without extensions, which is where the refit starts.
        extensions: What to add; none refits the null model.
        noise: Member of the family that weighs the residuals.
        start: First guess of the strengths, in their units.
    """
    return Refit(problem, extensions, noise).fit(start)


class Refit:
    """Refits of one extended model, to all data or to parts; compiled once."""

    def __init__(self, problem: DmaProblem, extensions: Sequence[Extension], noise: Noise) -> None:
        """Prepare."""
        self.problem = problem
        self.extensions = tuple(extensions)
        self.white = WhiteResidual(problem, self.extensions, noise)
        self._scales = strength_scales(self.extensions)

    def fit(self, start: Float[np.ndarray, " extension"]) -> ExtendedFit:
        """Refit to all data."""
        everything = np.ones(self.problem.rows, dtype=bool)
        unknowns, converged, status = self.solve(start, everything)
        count = len(self.extensions)
        mask = jnp.ones(self.problem.weights.size)
        white, jacobian = (np.asarray(part) for part in _white_and_slope(self.white, jnp.asarray(unknowns), mask))
        errors, freedom = _errors(jacobian, white, count)
        strengths, errors = unknowns[:count] * self._scales, errors * self._scales
        half = stats.t.ppf(0.5 + 0.5 * INTERVAL_LEVEL, freedom) * errors
        intervals = np.stack([strengths - half, strengths + half], axis=-1).reshape(-1, 2)
        one_sided = np.array([extension.cause.sign > 0 for extension in self.extensions], dtype=bool)
        return ExtendedFit(
            extensions=self.extensions,
            strengths=strengths,
            standard_errors=errors,
            intervals=np.where(one_sided[:, None], np.maximum(intervals, 0.0), intervals),
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
            Strengths in their plausible scales, then unconstrained constants; whether it converged; and how it ended.
        """
        moved = zip(self.problem.parameters, self.problem.moved, strict=True)
        free = np.concatenate([np.asarray(unconstrain(parameters, jnp.asarray(row))) for parameters, row in moved])
        one_sided = np.array([extension.cause.sign > 0 for extension in self.extensions], dtype=bool)
        strengths = np.where(one_sided, np.maximum(start / self._scales, _SMALL), start / self._scales)
        first = np.concatenate([strengths, np.clip(free, -_FARTHEST, _FARTHEST)])
        lower = np.concatenate([np.where(one_sided, 0.0, -np.inf), np.full(len(free), -np.inf)])
        mask = jnp.asarray(np.repeat(used.astype(float), self.problem.weights.shape[1]))
        solution = optimize.least_squares(
            lambda u: np.asarray(_white_and_slope(self.white, jnp.asarray(u), mask)[0]),
            first,
            jac=lambda u: np.asarray(_white_and_slope(self.white, jnp.asarray(u), mask)[1]),  # pyright: ignore[reportArgumentType]
            bounds=(lower, np.inf),
            x_scale="jac",
            ftol=1e-10,
            xtol=1e-8,
            max_nfev=200,
        )
        return np.asarray(solution.x), bool(solution.success), str(solution.message)

    def plain(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " n"]:
        """Measured less predicted, weighted but not whitened."""
        return np.asarray(_plain(self.white, jnp.asarray(unknowns)))


_SMALL = 1e-3
"""Part of the plausible strength at which one that cannot be negative starts at least."""
_FARTHEST = 12.0
"""Unconstrained numbers beyond which a constant is at its bound and no derivative would bring it back."""


def strength_scales(extensions: Sequence[Extension]) -> Float[np.ndarray, " extension"]:
    """Plausible strengths, in which the solver counts."""
    return np.array([extension.cause.plausible for extension in extensions], dtype=float)


class WhiteResidual(eqx.Module):
    """Whitened residuals as a function of strengths and unconstrained constants."""

    conditions: DmaConditions
    parameters: tuple[tuple[Parameter, ...], ...]
    measured: Float[np.ndarray, "row coordinate"]
    weights: Float[np.ndarray, "row coordinate"]
    log_deviation: Float[np.ndarray, " n"]
    previous: Float[np.ndarray, " n"]
    scales: Float[np.ndarray, " extension"]
    correlation: Float[Array, ""]
    extensions: tuple[Extension, ...]
    fractional: bool = eqx.field(static=True)
    has_phase: bool = eqx.field(static=True)

    def __init__(self, problem: DmaProblem, extensions: tuple[Extension, ...], noise: Noise) -> None:
        """Take what is needed from the problem."""
        self.conditions = problem.conditions
        # As arrays, so that other data of the same shape need no new compilation.
        self.parameters = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), problem.parameters)
        self.measured, self.weights = problem.measured, problem.weights
        self.log_deviation, self.previous = noise.log_deviation, noise.ordering.previous
        self.correlation = jnp.asarray(noise.correlation)
        self.scales = strength_scales(extensions)
        self.extensions = extensions
        self.fractional, self.has_phase = problem.model.fractional, problem.has_phase

    def constants(self, unknowns: Float[Array, " unknown"]) -> Float[Array, "sweep 4"]:
        """Reported constants of every sweep; order 1 for the conventional solid."""
        count = len(self.extensions)
        rows = unknowns[count:].reshape(len(self.parameters), -1)
        values = [constrain(one, row) for one, row in zip(self.parameters, rows, strict=True)]
        moved = jnp.stack(values)
        order = moved[:, 3:] if self.fractional else jnp.ones((len(values), 1))
        return jnp.concatenate([moved[:, :1], moved[:, :1] + moved[:, 1:2], moved[:, 2:3], order], axis=1)

    def plain(self, unknowns: Float[Array, " unknown"]) -> Float[Array, " n"]:
        """Measured less predicted, weighted."""
        strengths = unknowns[: len(self.extensions)] * self.scales
        predicted = predict_coordinates(
            self.constants(unknowns), self.conditions, self.extensions, strengths, self.has_phase
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
