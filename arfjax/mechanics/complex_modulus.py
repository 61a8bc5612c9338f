r"""Complex modulus of the Zener solids: what a dynamic mechanical analysis measures.

With $z = (i \omega \tau)^\alpha$ both solids are one rational function, $M = (M_0 + M_\infty z) / (1 + z)$. Its real
and imaginary part are the two equations of Suomi et al. (2016), after Kohandel et al. (2005). They are evaluated here
in $z$ below the relaxation frequency and in $1/z$ above it, so that no power overflows and no sum cancels.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from arfjax.media import FractionalZener, Scalar, Zener

Frequency = float | Float[Array, "*points"] | Float[np.ndarray, "*points"]


def complex_modulus(solid: Zener | FractionalZener, angular_frequency: Frequency) -> Complex[Array, "*points"]:
    r"""Complex modulus $M = M_S + i M_L$ of a Zener solid, with the time convention exp(+i omega t).

    Args:
        solid: Constants of the solid.
        angular_frequency: [rad/s], not negative.

    Returns:
        Complex modulus [Pa], in the shape of `angular_frequency`.

    Accuracy: a few units of rounding, for every product of frequency and relaxation time, however large or small.
    Differentiability: everywhere in every constant, the ends of their ranges included (no relaxed modulus, fractional
        order 0 or 1, relaxation time 0). At zero frequency the modulus is the relaxed one, for every order; there its
        slope in frequency and in relaxation time is infinite for orders below 1, and 0 is returned in its place.
    Source: Suomi et al. (2016), section "Fitting dynamic modulus to fractional Zener model", its two equations.
    """
    return jax.lax.complex(*_storage_and_loss(solid, angular_frequency))


def storage_modulus(solid: Zener | FractionalZener, angular_frequency: Frequency) -> Float[Array, "*points"]:
    """Real part [Pa] of `complex_modulus`: never falls with angular frequency [rad/s]."""
    return _storage_and_loss(solid, angular_frequency)[0]


def loss_modulus(solid: Zener | FractionalZener, angular_frequency: Frequency) -> Float[Array, "*points"]:
    """Imaginary part [Pa] of `complex_modulus`: never negative, at angular frequency [rad/s]."""
    return _storage_and_loss(solid, angular_frequency)[1]


def modulus_magnitude(solid: Zener | FractionalZener, angular_frequency: Frequency) -> Float[Array, "*points"]:
    """Magnitude [Pa] of `complex_modulus` at angular frequency [rad/s]; its slope is 0 where the modulus is 0."""
    storage, loss = _storage_and_loss(solid, angular_frequency)
    squared = storage**2 + loss**2
    vanishes = squared == 0.0
    return jnp.where(vanishes, 0.0, jnp.sqrt(jnp.where(vanishes, 1.0, squared)))


def _storage_and_loss(
    solid: Zener | FractionalZener, angular_frequency: Frequency
) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    frequency = jnp.asarray(angular_frequency, dtype=jnp.result_type(float))
    time = jnp.asarray(solid.relaxation_time, dtype=frequency.dtype)
    if isinstance(solid, FractionalZener):
        small, relaxed_side = _fractional_power(frequency, time, solid.fractional_order)
        angle = 0.5 * jnp.pi * solid.fractional_order
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
    else:
        small, relaxed_side = _first_power(frequency * time)
        cosine, sine = 0.0, 1.0
    relaxed, unrelaxed = solid.relaxed_modulus, solid.unrelaxed_modulus
    near = jnp.where(relaxed_side, relaxed, unrelaxed)
    far = jnp.where(relaxed_side, unrelaxed, relaxed)
    denominator = 1.0 + 2.0 * cosine * small + small**2
    storage = (near + (near + far) * cosine * small + far * small**2) / denominator
    loss = (unrelaxed - relaxed) * sine * small / denominator
    return storage, loss


def _first_power(x: Float[Array, "*points"]):
    """The smaller of x and 1/x, and whether that is x."""
    below = x <= 1.0
    return jnp.where(below, x, 1.0 / jnp.where(below, 1.0, x)), below


def _fractional_power(frequency: Float[Array, "*points"], time: Float[Array, ""], order: Scalar):
    """The smaller of (omega tau)^alpha and its inverse, and whether that is the power itself."""
    static = (frequency == 0.0) | (time == 0.0)
    logarithm = order * (jnp.log(jnp.where(static, 1.0, frequency)) + jnp.log(jnp.where(static, 1.0, time)))
    below = static | (logarithm <= 0.0)
    return jnp.where(static, 0.0, jnp.exp(jnp.where(below, logarithm, -logarithm))), below
