"""Strengths of effects beside everything that is fitted, and how strong one has to be, in noise of one kind."""

import math

import numpy as np
from jaxtyping import Float
from scipy import stats

from inverse.diagnosis.noise import Noise
from inverse.diagnosis.projection import independent, project_out, unit_columns

INTERVAL_LEVEL = 0.95


class Regression:
    """Residuals of a model in coordinates in which the noise is white, what is fitted projected out.

    An effect that is smooth is worth fewer readings in noise that is: its strength and the error of that, taken as if
    noise were white, would be those of another experiment.

    Attributes:
        size: Standard deviation of the residuals there, by readings alone: what is believed of constants, which is data
            at the end, holds effects back and says nothing of the noise.
    """

    def __init__(self, residuals: Float[np.ndarray, " n"], fitted: Float[np.ndarray, "n p"], noise: Noise) -> None:
        """Prepare.

        Args:
            residuals: Measured less predicted, weighted.
            fitted: Derivative of the weighted prediction in what is fitted.
            noise: Of the data.
        """
        self._noise = noise
        self._basis = independent(noise.whiten(unit_columns(fitted)))
        self._left = self._beside(residuals)
        self._readings = len(residuals) - noise.beliefs
        taken = float(np.sum(self._basis[: self._readings] ** 2))
        self._freedom = max(self._readings - taken, 2.0)
        self.size = self._norm_of_readings(self._left) / math.sqrt(self._freedom)

    def length(self, direction: Float[np.ndarray, " n"]) -> float:
        """Of what a unit of an effect adds that nothing fitted can imitate."""
        return max(float(np.linalg.norm(self._beside(direction))), 1e-300)

    def strength(self, direction: Float[np.ndarray, " n"]) -> tuple[float, tuple[float, float]]:
        """Strength of an effect, and its interval at `INTERVAL_LEVEL` by Student's t."""
        across, length = self._beside(direction), self.length(direction)
        found = float(across @ self._left) / length**2
        rest = self._norm_of_readings(self._left - found * across) / math.sqrt(self._freedom - 1.0)
        reach = float(stats.t.ppf(0.5 + 0.5 * INTERVAL_LEVEL, self._freedom - 1.0)) * rest / length
        return found, (found - reach, found + reach)

    def _norm_of_readings(self, left: Float[np.ndarray, " n"]) -> float:
        return float(np.linalg.norm(left[: self._readings]))

    def _beside(self, data: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        return project_out(self._noise.whiten(data[:, None]), self._basis)[:, 0]
