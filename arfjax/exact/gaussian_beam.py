r"""The Gaussian beam in the parabolic approximation, in closed form.

$$ p(r, z) = \frac{p_0}{D} \exp(-B r^2 / D - i k z), \quad D = 1 - 2 i B z / k_0, \quad
   B = 1 / a^2 - i k_0 / (2 d) $$

k_0 is the real part of k = omega / c - i alpha, a the radius at which the source has 1/e of its pressure and d the
focal length of the thin lens on it (infinite for none).
"""

import math

import numpy as np
from jaxtyping import Complex, Float


def pressure(
    r: Float[np.ndarray, " r"],
    z: Float[np.ndarray, " z"],
    *,
    radius: float,
    wavenumber: float | complex,
    focal_length: float = math.inf,
    source_pressure: float = 1.0,
) -> Complex[np.ndarray, "r z"]:
    """Complex pressure [Pa].

    Args:
        r: Radii [m].
        z: Distances from the source [m].
        radius: Where the source's pressure is 1/e of that on its axis [m].
        wavenumber: k = omega / c - i alpha [rad/m].
        focal_length: Of the lens [m].
        source_pressure: On the axis at the source [Pa].
    """
    curvature = 1.0 / radius**2 - 0.5j * wavenumber.real / focal_length
    spread = 1.0 - 2j * curvature * z / wavenumber.real
    return source_pressure / spread * np.exp(-curvature * r[:, None] ** 2 / spread - 1j * wavenumber * z)
