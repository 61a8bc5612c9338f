"""What a field's harmonics carry and leave behind: intensity, heat and force.

Each harmonic is taken as a locally plane wave, whose intensity is |p|^2 / (2 rho c). What it loses by absorption
becomes heat; what it loses by attenuation, absorbed or scattered away, pushes.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.acoustics.one_way import HarmonicField
from arfjax.media import Scalar


def intensity(field: HarmonicField) -> Float[Array, "harmonic r z"]:
    """Time-averaged intensity of each harmonic [W/m^2]."""
    impedance = field.density[None, :] * field.sound_speed
    # Real and imaginary part squared: the absolute value has no derivative where the pressure is zero.
    return (field.pressure.real**2 + field.pressure.imag**2) / (2.0 * impedance[None])


def heat_deposition(field: HarmonicField, absorption_fraction: Scalar = 1.0) -> Float[Array, "r z"]:
    """Heat deposited [W/m^3], 2 alpha I summed over harmonics, alpha the local one.

    Args:
        field: The field.
        absorption_fraction: Share of attenuation that is absorption; the rest scatters [1].
    """
    return absorption_fraction * jnp.sum(_lost(field), axis=0)


def radiation_force_density(field: HarmonicField) -> Float[Array, "r z"]:
    """Radiation force density along the axis [N/m^3], 2 alpha I / c summed over harmonics, with local attenuation."""
    return jnp.sum(_lost(field), axis=0) / field.sound_speed


def _lost(field: HarmonicField) -> Float[Array, "harmonic r z"]:
    """Power that each harmonic loses [W/m^3]."""
    return 2.0 * field.attenuation * intensity(field)
