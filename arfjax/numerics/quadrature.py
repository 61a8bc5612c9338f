"""Points and weights of quadrature rules."""

import numpy as np
from jaxtyping import Float


def gauss_legendre(n_points: int) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
    """Points and weights on [-1, 1]; exact for polynomials of degree up to 2 `n_points` - 1."""
    if n_points < 1:
        raise ValueError(f"`n_points` must be at least 1, got {n_points}.")
    return np.polynomial.legendre.leggauss(n_points)
