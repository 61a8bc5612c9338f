"""Linear models with normal noise and normal priors, whose posterior and evidence are known."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from inverse.inference.noise import NoiseModel, unordered
from inverse.inference.parameter_set import ParameterSet, parameter
from inverse.inference.problem import Measurement, Problem
from inverse.priors import Normal


class Line(eqx.Module):
    """Coefficients of a linear model."""

    coefficients: Float[Array, " n"]


def conjugate_problem(n: int = 3, n_data: int = 12, seed: int = 0, sd: float = 0.4) -> Problem:
    """Data that are a linear function of the coefficients, with columns that resemble one another."""
    design, measured = _data(n, n_data, seed, sd)
    entries = tuple(
        parameter(f"coefficient_{k}", f"model.coefficients[{k}]", "m", Normal(0.3 * k, 1.5)) for k in range(n)
    )
    noise = NoiseModel(known=jnp.full(n_data, sd))
    measurement = Measurement("line", Predict(design), jnp.asarray(measured), unordered(n_data), noise, "m")
    return Problem(ParameterSet(entries), Line(jnp.zeros(n)), (measurement,))


class Predict:
    """Compared by its design, so that problems of one shape need one compilation."""

    def __init__(self, design: np.ndarray) -> None:
        self.design = design

    def __call__(self, model: Line) -> Float[Array, " n"]:
        return jnp.asarray(self.design) @ model.coefficients

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Predict) and np.array_equal(self.design, other.design)

    def __hash__(self) -> int:
        return hash(self.design.tobytes())


def _data(n: int, n_data: int, seed: int, sd: float) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    design = random.normal(size=(n_data, n)) + 2.0 * random.normal(size=(n_data, 1))
    return design, design @ np.linspace(0.5, 1.5, n) + sd * random.normal(size=n_data)


def exact_posterior(problem: Problem) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean, covariance and log evidence, by the matrix formulas of the linear model."""
    measurement = problem.measurements[0]
    design, measured = measurement.predict.design, np.asarray(measurement.measured)
    priors = [entry.parameter.prior for entry in problem.parameters.entries]
    mean, sd = np.array([p.mean for p in priors]), np.array([p.sd for p in priors])
    noise = np.asarray(measurement.noise.known)
    precision = np.diag(sd**-2.0) + design.T @ (design / noise[:, None] ** 2)
    covariance = np.linalg.inv(precision)
    centre = covariance @ (mean / sd**2 + design.T @ (measured / noise**2))
    marginal = design @ np.diag(sd**2) @ design.T + np.diag(noise**2)
    rest = measured - design @ mean
    evidence = -0.5 * (
        rest @ np.linalg.solve(marginal, rest) + np.linalg.slogdet(marginal)[1] + len(measured) * np.log(2.0 * np.pi)
    )
    return centre, covariance, float(evidence)
