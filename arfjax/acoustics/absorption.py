"""Power-law attenuation and the dispersion that causality ties to it, as one complex wavenumber."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from arfjax.media import AcousticMedium, Scalar
from arfjax.numerics.decay import mean_decay
from arfjax.units import REFERENCE_FREQUENCY


def complex_wavenumber(medium: AcousticMedium, frequency: Float[Array, " harmonic"]) -> Complex[Array, " harmonic"]:
    """Wavenumber k = omega / c(omega) - i alpha(omega) [rad/m] at each frequency [Hz].

    Time goes as exp(+i omega t), so that an outgoing wave exp(-i k z) decays.
    """
    return 2.0 * math.pi * frequency / phase_speed(medium, frequency) - 1j * attenuation(medium, frequency)


def attenuation(medium: AcousticMedium, frequency: Float[Array, " harmonic"]) -> Float[Array, " harmonic"]:
    """Amplitude attenuation coefficient [Np/m] at each frequency [Hz]."""
    return jnp.asarray(jax.vmap(medium.attenuation_at)(frequency))


def phase_speed(medium: AcousticMedium, frequency: Float[Array, " harmonic"]) -> Float[Array, " harmonic"]:
    r"""Phase speed [m/s] of a power-law medium at each frequency [Hz], from the Kramers-Kronig relation.

    $$ 1/c(\omega) = 1/c_0 + (\alpha_0/\omega_0) \tan(\pi y/2) ((\omega/\omega_0)^{y-1} - 1) $$

    with the limit $1/c_0 - (2/\pi) (\alpha_0/\omega_0) \ln(\omega/\omega_0)$ at y = 1; index 0 is the reference, 1 MHz.
    The exponent y lies from 0 to 2, and at both ends there is no dispersion.

    Differentiability: everywhere, in the exponent also at exactly 1.
    Source: Waters, Mobley & Miller, IEEE Trans. UFFC 52 (2005) 822.
    """
    excess = jnp.asarray(medium.absorption_exponent - 1.0, dtype=frequency.dtype)
    octaves = jnp.log(frequency / REFERENCE_FREQUENCY)
    # tan(pi y / 2) (x^(y-1) - 1) = -(2 / pi) log(x) phi(-excess log x) chi(pi excess / 2), smooth through y = 1.
    shape = 2.0 / math.pi * octaves * mean_decay(-excess * octaves) * _cotangent(0.5 * math.pi * excess)
    return 1.0 / (1.0 / medium.sound_speed - medium.attenuation / (2.0 * math.pi * REFERENCE_FREQUENCY) * shape)


def _cotangent(x: Scalar) -> Scalar:
    """Product of x and cot(x), by its series near 0; written with the sine so that it is 0 at pi/2."""
    x = jnp.asarray(x)
    is_small = jnp.abs(x) < 1e-2
    safe = jnp.where(is_small, 1.0, x)
    series = 1.0 - x**2 / 3.0 - x**4 / 45.0 - 2.0 * x**6 / 945.0
    return jnp.where(is_small, series, safe * jnp.cos(safe) / jnp.sin(safe))
