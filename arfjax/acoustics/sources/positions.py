"""Radii that a user gives, as they are stored."""

import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from arfjax.errors import InputError

_LARGEST = 1.0
"""No transducer and no scan reaches a metre from the axis; a millimetre's number does."""


def as_radii(values: Float[np.ndarray, " radius"] | tuple[float, ...] | list[float]) -> tuple[float, ...]:
    """Concrete radii [m] as a tuple, which can be static: hashed and compared.

    Raises:
        InputError: if they are fewer than two, traced, not finite, negative or in millimetres.
    """
    if isinstance(values, Tracer):
        raise InputError("radii must be concrete: quadrature and interpolation are laid out by them.")
    radii = np.asarray(values, dtype=float)
    if radii.ndim != 1 or len(radii) < 2:
        raise InputError(f"radii must be two or more in one dimension, got shape {radii.shape}.")
    if not np.all(np.isfinite(radii)) or np.any(radii < 0.0):
        raise InputError(f"radii must be finite and not negative [m], got {radii}.")
    if radii.max() > _LARGEST:
        raise InputError(f"radii up to {radii.max()} m are beyond any transducer. Millimetres? Pass metres.")
    return tuple(radii.tolist())
