"""A drive from the peak pressure that a hydrophone found in water."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from arfjax.acoustics.diffraction import Diffraction, ExactOneWay
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.base import Source
from arfjax.acoustics.waveform import peak_pressures
from arfjax.errors import InputError
from arfjax.media import AcousticMedium, Scalar
from arfjax.transducer import FocusedBowl, PressureDrive


def drive_for_peak_pressure(
    source: FocusedBowl | Source,
    *,
    frequency: Scalar,
    peak_pressure: Scalar,
    medium: AcousticMedium,
    z: Float[np.ndarray, " z"],
    diffraction: Diffraction = ExactOneWay(),  # noqa: B008  frozen and without state
    settings: MarchSettings = MarchSettings(),  # noqa: B008
) -> PressureDrive:
    """The drive with which the highest peak positive pressure on the axis is a given one.

    Newton's method in the logarithms, from the linear answer; each step is a march with its derivative.

    Args:
        source: The transducer.
        frequency: [Hz].
        peak_pressure: Peak positive pressure that was measured [Pa].
        medium: In which: water at the temperature of the measurement.
        z: Concrete positions about the focus among which the peak is sought [m]; between them by a parabola.
        diffraction: Which one-way operator.
        settings: Discretisation; with `n_harmonics` 1 the peak is the linear one.

    Returns:
        The drive; its pressure is NaN where Newton's method did not converge (no drive makes so much in this medium,
        or the settings do not resolve it), and where the peak is at the first or last of the positions.

    Raises:
        InputError: if there are fewer than three positions, or they are not evenly spaced.

    Accuracy: 1e-6 of the pressure, beside the march's own and the parabola's (1e-4 for a spacing of a tenth of the
    focus' length).
    Differentiability: by the implicit function theorem, in everything.
    """
    spacing = np.diff(z)
    if len(z) < 3 or not np.all(np.abs(spacing - spacing[0]) < 1e-6 * abs(spacing[0])):
        raise InputError(f"`z` must hold three or more evenly spaced positions about the focus [m], got {z}.")
    layers = [AcousticLayer(medium, float(z[-1]) + 1e-3)]

    def highest(pressure: Array, settings: MarchSettings) -> Array:
        drive = PressureDrive(frequency, pressure)
        field = solve_field(source, drive, layers, r=np.zeros(1), z=z, diffraction=diffraction, settings=settings)
        return _top(peak_pressures(field)[0][0])

    unit = jnp.asarray(1e5)
    linear = unit * peak_pressure / highest(unit, _linear(settings))
    if settings.n_harmonics == 1:
        return PressureDrive(frequency, linear)

    def excess(logarithm: Array, wanted: Array) -> Array:
        return jnp.log(highest(jnp.exp(logarithm), settings) / wanted)

    found = optx.root_find(
        excess,
        optx.Newton(rtol=1e-7, atol=1e-7),
        jnp.log(jax.lax.stop_gradient(linear)),
        args=jnp.asarray(peak_pressure, dtype=float),
        max_steps=20,
        throw=False,
    )
    return PressureDrive(frequency, jnp.where(found.result == optx.RESULTS.successful, jnp.exp(found.value), jnp.nan))


def _linear(settings: MarchSettings) -> MarchSettings:
    return dataclasses.replace(settings, n_harmonics=1)


def _top(values: Float[Array, " z"]) -> Float[Array, ""]:
    """Top of the parabola through the highest of the values and its neighbours; NaN where it has but one."""
    highest = jnp.argmax(values)
    middle = jnp.clip(highest, 1, len(values) - 2)
    left, top, right = (jax.lax.dynamic_index_in_dim(values, middle + i, keepdims=False) for i in (-1, 0, 1))
    slope, curvature = 0.5 * (right - left), right - 2.0 * top + left
    summit = jnp.where(curvature < 0.0, top - 0.5 * slope**2 / jnp.where(curvature < 0.0, curvature, -1.0), top)
    return jnp.where(highest == middle, summit, jnp.nan)
