"""Static numbers in the precision in force."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def constant(values: Float[np.ndarray, "..."]) -> Float[Array, "..."]:
    """Static numbers as they are computed with: `dtype=float` is float32 where x64 is off."""
    return jnp.asarray(values, dtype=float)
