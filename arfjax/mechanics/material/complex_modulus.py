r"""Complex modulus of solids: what a dynamic mechanical analysis measures.

With $z = (i \omega \tau)^\alpha$ both Zener solids are one rational function, $M = (M_0 + M_\infty z) / (1 + z)$. Its
real and imaginary part are the two equations of Suomi et al. (2016), after Kohandel et al. (2005). They are evaluated
here in $z$ below the relaxation frequency and in $1/z$ above it, so that no power overflows and no sum cancels.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from arfjax.mechanics.material.viscoelastic import ModulusReading
from arfjax.media import (
    Elastic,
    FractionalKelvinVoigt,
    FractionalZener,
    KelvinVoigt,
    Prony,
    Scalar,
    Solid,
    Values,
    Zener,
)

Frequency = float | Float[Array, "..."] | Float[np.ndarray, "..."]


def complex_modulus(solid: Solid, angular_frequency: Frequency) -> Complex[Array, "..."]:
    r"""Complex modulus $M = M_S + i M_L$ of a solid, with the time convention exp(+i omega t).

    Args:
        solid: Constants of the solid: numbers with any frequencies, or fields with one frequency.
        angular_frequency: [rad/s], not negative.

    Returns:
        Complex modulus [Pa], in the shape of `angular_frequency`, or of the solid's fields.

    Accuracy: a few units of rounding, for every product of frequency and relaxation time, however large or small.
    Differentiability: everywhere in every constant, the ends of their ranges included (no relaxed modulus, fractional
        order 0 or 1, relaxation time 0). At zero frequency the modulus is the relaxed one, for every order; there its
        slope in frequency and in relaxation time is infinite for orders below 1, and 0 is returned in its place.
    Source: of the Zener solids: Suomi et al. (2016), section "Fitting dynamic modulus to fractional Zener model", its
        two equations.
    """
    return jax.lax.complex(*_storage_and_loss(solid, angular_frequency))


def storage_modulus(solid: Solid, angular_frequency: Frequency) -> Float[Array, "..."]:
    """Real part [Pa] of `complex_modulus`: never falls with angular frequency [rad/s]."""
    return _storage_and_loss(solid, angular_frequency)[0]


def loss_modulus(solid: Solid, angular_frequency: Frequency) -> Float[Array, "..."]:
    """Imaginary part [Pa] of `complex_modulus`: never negative, at angular frequency [rad/s]."""
    return _storage_and_loss(solid, angular_frequency)[1]


def modulus_magnitude(solid: Solid, angular_frequency: Frequency) -> Float[Array, "..."]:
    """Magnitude [Pa] of `complex_modulus` at angular frequency [rad/s]; its slope is 0 where the modulus is 0."""
    storage, loss = _storage_and_loss(solid, angular_frequency)
    squared = storage**2 + loss**2
    vanishes = squared == 0.0
    return jnp.where(vanishes, 0.0, jnp.sqrt(jnp.where(vanishes, 1.0, squared)))


def complex_shear_field(
    solid: Solid,
    shape: tuple[int, int],
    angular_frequency: Scalar,
    *,
    reading: ModulusReading,
    poisson_ratio: Scalar,
) -> Complex[Array, "rq zq"]:
    """Complex shear modulus [Pa] at the Gauss points of a mesh, for motion at one frequency.

    Args:
        solid: Constants, numbers or fields on the Gauss points.
        shape: Number of Gauss points, radial and axial.
        angular_frequency: [rad/s], not negative.
        reading: Which modulus was measured.
        poisson_ratio: Of the reading [1]; the same at all frequencies.

    Accuracy: that of `complex_modulus`; fractional solids and viscosities are exact here, not sums of branches.
    """
    storage, loss = _storage_and_loss(solid, angular_frequency)
    parts = (reading.shear_modulus(part, poisson_ratio) for part in (storage, loss))
    return jax.lax.complex(*(jnp.broadcast_to(jnp.asarray(part), shape) for part in parts))


def _storage_and_loss(solid: Solid, angular_frequency: Frequency) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    frequency = jnp.asarray(angular_frequency, dtype=jnp.result_type(float))
    match solid:
        case Elastic():
            storage = solid.modulus + jnp.zeros_like(frequency)
            return storage, jnp.zeros_like(storage)
        case KelvinVoigt():
            loss = frequency * solid.viscosity
            return solid.relaxed_modulus + jnp.zeros_like(loss), loss
        case FractionalKelvinVoigt():
            return _spring_pot(solid, frequency)
        case Prony():
            return _sum_of_branches(solid, frequency)
        case Zener() | FractionalZener():
            return _zener(solid, frequency)


def _spring_pot(
    solid: FractionalKelvinVoigt, frequency: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    static = frequency == 0.0
    power = jnp.where(static, 0.0, jnp.exp(solid.fractional_order * jnp.log(jnp.where(static, 1.0, frequency))))
    angle = 0.5 * jnp.pi * solid.fractional_order
    return solid.relaxed_modulus + solid.viscosity * power * jnp.cos(angle), solid.viscosity * power * jnp.sin(angle)


def _sum_of_branches(solid: Prony, frequency: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    # Branches along the last axis, so that frequencies or fields stand before them.
    times, moduli = (jnp.moveaxis(jnp.asarray(each), 0, -1) for each in (solid.relaxation_times, solid.branch_moduli))
    if times.ndim == 1:
        times, moduli = (each.reshape((1,) * frequency.ndim + each.shape) for each in (times, moduli))
    small, slow = _first_power(frequency.reshape(frequency.shape + (1,) * max(times.ndim - frequency.ndim, 0)) * times)
    denominator = 1.0 + small**2
    storage = jnp.sum(moduli * jnp.where(slow, small**2, 1.0) / denominator, axis=-1)
    return solid.relaxed_modulus + storage, jnp.sum(moduli * small / denominator, axis=-1)


def _zener(
    solid: Zener | FractionalZener, frequency: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
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


def _first_power(x: Float[Array, "..."]):
    """The smaller of x and 1/x, and whether that is x."""
    below = x <= 1.0
    return jnp.where(below, x, 1.0 / jnp.where(below, 1.0, x)), below


def _fractional_power(frequency: Float[Array, "..."], time: Float[Array, "..."], order: Values):
    """The smaller of (omega tau)^alpha and its inverse, and whether that is the power itself."""
    static = (frequency == 0.0) | (time == 0.0)
    logarithm = order * (jnp.log(jnp.where(static, 1.0, frequency)) + jnp.log(jnp.where(static, 1.0, time)))
    below = static | (logarithm <= 0.0)
    return jnp.where(static, 0.0, jnp.exp(jnp.where(below, logarithm, -logarithm))), below
