r"""Course of temperature in the middle of a Gaussian source of heat that is switched on and off.

The source, $\exp(-r^2/a^2 - z^2/b^2)$, is on from `start` for `duration` in a uniform medium without perfusion; the
package's finite volumes solve it with phases whose lengths are constants like the others.

What a course can tell. Lengths and diffusivity $\kappa$ enter only as the diffusion time $a^2 / (4 \kappa)$: neither
the width nor the diffusivity by itself. The mean over a region with Gaussian weight of radius $w$ is the course in the
middle of a source of $a^2 + w^2$ in place of $a^2$ (likewise along the axis): the region is absorbed by the width.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax import AxisymmetricGrid, solve_bioheat
from arfjax.grid import graded_positions
from arfjax.instruments.thermocouple import Thermocouple
from arfjax.media import Scalar, ThermalMedium
from arfjax.numerics.interpolation import interpolation_weights
from arfjax.thermal.bioheat import Insulated, Phase, TemperatureHistory, Walls, uniform_field

COURSE_ACCURACY = 2.5e-3
"""Largest error of `temperature_rise`, relative to its amplitude, for constants within the bounds of the fit."""

_FINEST, _GROWTH, _EXTENT = 0.15, 1.2, 60.0  # of the grid, in radii a
_PARTS = (0.1, 1.0)  # of heating and of cooling, in ever longer steps
_STEPS = 20  # in each part


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
    course = jnp.asarray(jnp.where(since < duration, hot, after)) / middle[last]
    return jnp.asarray(jnp.where(since <= 0.0, 0.0, course))
