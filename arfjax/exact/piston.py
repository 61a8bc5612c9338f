"""Pressure on the axis of a flat piston in a rigid baffle, in closed form."""

import numpy as np
from jaxtyping import Complex, Float


def axial_pressure(
    z: Float[np.ndarray, " z"],
    *,
    radius: float,
    wavenumber: float | complex,
    hole_radius: float = 0.0,
    source_pressure: float = 1.0,
) -> Complex[np.ndarray, " z"]:
    """Complex pressure on the axis [Pa]: a wave from the edge taken from one from the centre (or the hole's edge).

    Its magnitude is 2 p_0 |sin(k (R_rim - R_hole) / 2)| without loss.

    Args:
        z: Distance from the piston [m].
        radius: Of the piston [m].
        wavenumber: k = omega / c - i alpha [rad/m].
        hole_radius: Of its central hole [m].
        source_pressure: Density times sound speed times surface velocity [Pa].
    """
    from_hole, from_rim = (np.exp(-1j * wavenumber * np.hypot(z, edge)) for edge in (hole_radius, radius))
    return source_pressure * wavenumber.real / wavenumber * (from_hole - from_rim)
