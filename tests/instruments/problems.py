"""Histories of temperature whose readings are known in closed form."""

import jax.numpy as jnp
import numpy as np
from scipy.special import erf

from arfjax.grid import AxisymmetricGrid
from arfjax.thermal.bioheat import TemperatureHistory

RADIUS, HALF_LENGTH = 1.5e-3, 4.0e-3
FOCUS = 0.0613


def grid(n: int = 40) -> AxisymmetricGrid:
    """Cells that widen away from the axis and from the focus."""
    xi, eta = np.linspace(0.0, 1.0, n + 1), np.linspace(-1.0, 1.0, 2 * n + 1)
    return AxisymmetricGrid(4e-3 * (0.6 * xi + 0.4 * xi**2), 0.06 + 8e-3 * (0.6 * eta + 0.4 * eta**3))


def on_cells(function, where: AxisymmetricGrid) -> jnp.ndarray:
    return jnp.asarray(function(where.r[:, None], where.z[None, :]) * np.ones(where.shape))


def gaussian(r, z):
    return np.exp(-((r / RADIUS) ** 2) - ((z - 0.06) / HALF_LENGTH) ** 2)


def history_of(times, course, shape) -> TemperatureHistory:
    """The field `shape` (r, z) times a course over time, above 37 degC."""
    course = jnp.asarray(course, dtype=float)
    return TemperatureHistory(jnp.asarray(times, dtype=float), 37.0 + course[:, None, None] * shape[None])


def gaussian_mean(centre, size, width):
    """Mean of exp(-x^2 / width^2) over an interval."""
    low, high = (centre - 0.5 * size) / width, (centre + 0.5 * size) / width
    return 0.5 * np.sqrt(np.pi) * (erf(high) - erf(low)) * width / size
