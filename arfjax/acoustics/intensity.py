"""What a field's harmonics carry and leave behind: intensity, heat and force.

Each harmonic is taken as a locally plane wave, whose intensity is |p|^2 / (2 rho c). What it loses by absorption
becomes heat; what it loses by attenuation, absorbed or scattered away, pushes. What the march takes from the upper
harmonics where a shock is thinner than they resolve is absorption too (`nonlinearity`).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.acoustics.field import HarmonicField
from arfjax.acoustics.nonlinearity import shock_absorption


def intensity(field: HarmonicField) -> Float[Array, "harmonic r z"]:
    """Time-averaged intensity of each harmonic [W/m^2]."""
    impedance = field.density[None, :] * field.sound_speed
    # Real and imaginary part squared: the absolute value has no derivative where the pressure is zero.
    return (field.pressure.real**2 + field.pressure.imag**2) / (2.0 * impedance[None])


def heat_deposition(field: HarmonicField) -> Float[Array, "r z"]:
    """Heat deposited [W/m^3], 2 alpha I summed over harmonics, alpha the local absorption."""
    absorption = field.absorption_fraction[None, None, :] * field.attenuation + _at_shocks(field)
    return jnp.sum(2.0 * absorption * intensity(field), axis=0)


def radiation_force_density(field: HarmonicField) -> Float[Array, "r z"]:
    """Radiation force density along the axis [N/m^3], 2 alpha I / c summed over harmonics, alpha local attenuation."""
    return jnp.sum(2.0 * (field.attenuation + _at_shocks(field)) * intensity(field), axis=0) / field.sound_speed


def force_density_of_intensity(field: HarmonicField) -> Float[Array, "r z"]:
    """Radiation force density as 2 alpha I / c [N/m^3], with all intensity but the fundamental's attenuation.

    That is the formula of the linear case. As higher harmonics are attenuated more it falls short of
    `radiation_force_density` where the wave has steepened.
    """
    return 2.0 * field.attenuation[0] * jnp.sum(intensity(field), axis=0) / field.sound_speed


def _at_shocks(field: HarmonicField) -> Float[Array, "harmonic r z"] | float:
    """Absorption that stands in for shocks [Np/m]."""
    if field.pressure.shape[0] == 1:
        return 0.0
    return jnp.moveaxis(shock_absorption(jnp.moveaxis(field.pressure, 0, -1), field.steepening_rate[None, :]), -1, 0)
