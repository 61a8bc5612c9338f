"""What is left of a dynamic mechanical analysis, whitened, as a compiled function of all that a refit may move."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from inverse.diagnosis.cause import Extension
from inverse.diagnosis.dma.cause import DmaCause, DmaConditions
from inverse.diagnosis.dma.problem import DmaProblem, predict_coordinates
from inverse.diagnosis.noise import Noise
from inverse.parameters import Parameter, constrain, unconstrain


def strength_scales(causes: Sequence[DmaCause]) -> Float[np.ndarray, " cause"]:
    """Plausible strengths, in which the solver counts."""
    return np.array([cause.plausible for cause in causes], dtype=float)


class WhiteResidual(eqx.Module):
    """Whitened residuals as a function of strengths, shapes and unconstrained constants."""

    conditions: DmaConditions
    parameters: tuple[tuple[Parameter, ...], ...]
    measured: Float[np.ndarray, "row coordinate"]
    weights: Float[np.ndarray, "row coordinate"]
    log_deviation: Float[np.ndarray, " n"]
    previous: Int[np.ndarray, " n"]
    scales: Float[np.ndarray, " cause"]
    correlation: Float[Array, ""]
    causes: tuple[DmaCause, ...]
    fractional: bool = eqx.field(static=True)
    has_phase: bool = eqx.field(static=True)

    def __init__(self, problem: DmaProblem, causes: tuple[DmaCause, ...], noise: Noise) -> None:
        """Take what is needed from the problem."""
        self.conditions = problem.conditions
        # As arrays, so that other data of the same shape need no new compilation.
        self.parameters = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), problem.parameters)
        self.measured, self.weights = problem.measured, problem.weights
        self.log_deviation, self.previous = noise.log_deviation, noise.ordering.previous
        self.correlation = jnp.asarray(noise.correlation)
        self.scales = strength_scales(causes)
        self.causes = causes
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
def white_and_slope(residual_of: WhiteResidual, unknowns, mask):
    """Residuals and their derivative in all unknowns."""
    return residual_of(unknowns, mask), jax.jacfwd(residual_of)(unknowns, mask)


@eqx.filter_jit
def whitened(residual_of: WhiteResidual, unknowns, mask):
    """Residuals."""
    return residual_of(unknowns, mask)


@eqx.filter_jit
def plain_of(residual_of: WhiteResidual, unknowns):
    """Measured less predicted, weighted and not whitened."""
    return residual_of.plain(unknowns)


@eqx.filter_jit
def unconstrained_constants(parameters, moved):
    """Constants of every sweep as the solver counts them."""
    return jnp.stack([unconstrain(one, row) for one, row in zip(parameters, moved, strict=True)])


@eqx.filter_jit
def constants_of(residual_of: WhiteResidual, unknowns):
    """Reported constants of every sweep."""
    return residual_of.constants(unknowns)
