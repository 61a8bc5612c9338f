"""From thermal damage to the share of tissue that has coagulated: a threshold, or a smooth transition about it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError, lies_within
from arfjax.media import Scalar, Values

LETHAL_DOSE_MINUTES = 240.0
"""Dose [min] taken as the border of necrosis in soft tissue. Damianou, Hynynen & Fan, IEEE UFFC 42 (1995) 187;
the threshold of Suomi et al. 2016 too."""

SMALLEST_DAMAGE = 1e-30
"""Damage below which its logarithm is held, so that no damage has a finite one, in float32 as well."""


def coagulated_fraction(
    damage: Values | Float[np.ndarray, "..."], threshold: Scalar, *, width: Scalar
) -> Float[Array, "..."]:
    r"""Smooth closure for the fraction of tissue that has coagulated: $1 / (1 + (threshold / damage)^{1/width})$.

    Args:
        damage: In any unit, not negative.
        threshold: Damage at which half has coagulated.
        width: Of the transition in the logarithm of damage, positive; towards zero it is the sharp threshold. From a
            tenth to nine tenths, damage grows by the factor 81^width.

    Raises:
        InputError: if threshold or width is a number that is not positive.

    Differentiability: everywhere; at no damage the slope is zero. Finite for all damages up to 1e30, in float32 too.
    """
    require_transition(threshold=threshold, width=width)
    return jax.nn.sigmoid(log_excess(damage, threshold) / width)


def require_transition(**numbers: Scalar) -> None:
    """Refuse a threshold or a width of coagulation that is not positive, as far as it is concrete."""
    for name, value in numbers.items():
        if not lies_within(value, 0.0, above=True):
            raise InputError(f"`{name}` of coagulation must be positive, got {value}; correct it.")


def log_excess(damage: Values | Float[np.ndarray, "..."], threshold: Scalar) -> Float[Array, "..."]:
    """Natural logarithm of damage over threshold, held at the smallest damage."""
    return jnp.log(jnp.maximum(damage, SMALLEST_DAMAGE)) - jnp.log(threshold)
