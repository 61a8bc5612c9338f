"""The mean of an exponential decay, which a quotient of small differences does not give."""

import jax.numpy as jnp
from jaxtyping import Array, Float

_SERIES_BELOW = 0.1
_N_TERMS = 10


def mean_decay(drop: Float[Array, "*any"]) -> Float[Array, "*any"]:
    """Mean of exp(-x) for x from 0 to a drop of either sign, (1 - exp(-drop)) / drop: 1 at no drop.

    Accuracy: rounding; near 0 it is a series, whose ten terms leave less than that, so that slopes keep their digits
        as well.
    Differentiability: everywhere, to any order.
    """
    near = jnp.abs(drop) < _SERIES_BELOW
    small, large = jnp.where(near, drop, 0.0), jnp.where(near, 1.0, drop)
    series = jnp.ones_like(small)
    for order in range(_N_TERMS, 1, -1):
        series = 1.0 - small / order * series
    return jnp.where(near, series, -jnp.expm1(-large) / large)
