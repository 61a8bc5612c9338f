"""Double precision, without which no fit here ends."""

import jax.numpy as jnp


def require_double_precision(what: str = "fits") -> None:
    """Refuse to begin in single precision, before anything takes minutes.

    Args:
        what: Needs it, in the plural.

    Raises:
        ValueError: if JAX runs in single precision.
    """
    if jnp.result_type(float) != jnp.float64:
        raise ValueError(f"{what} need double precision; call jax.config.update('jax_enable_x64', True) first.")
