"""Pressure on the axis of a spherical bowl with a central hole, in closed form.

Every point of the bowl radiates like a point of a plane baffle (the Rayleigh integral over the bowl) into a uniform
lossless fluid; on the axis that integral is elementary.

Source: O'Neil, Theory of focusing radiators, J. Acoust. Soc. Am. 21 (1949) 516-526, extended to a hole by subtracting
the inner cap. Written with a sinc, so that the geometric focus is no special case.
"""

import numpy as np
from jaxtyping import Complex, Float

from arfjax.transducer import FocusedBowl


def axial_pressure(
    bowl: FocusedBowl, z: Float[np.ndarray, " z"], *, wavenumber: float, source_pressure: float = 1.0
) -> Complex[np.ndarray, " z"]:
    """Complex pressure on the axis [Pa].

    Args:
        bowl: The transducer, with concrete dimensions.
        z: Axial positions from the bowl's apex [m], before or beyond the focus.
        wavenumber: omega / c [rad/m].
        source_pressure: Density times sound speed times normal surface velocity, rho c u [Pa].
    """
    focal = float(bowl.focal_length)
    cosine_hole, cosine_rim = (
        np.sqrt(1.0 - (float(radius) / focal) ** 2) for radius in (bowl.hole_radius, bowl.aperture_radius)
    )
    from_hole, from_rim = (
        np.sqrt(focal**2 + (focal - z) ** 2 - 2.0 * focal * (focal - z) * cosine)
        for cosine in (cosine_hole, cosine_rim)
    )
    mean_distance = 0.5 * (from_hole + from_rim)
    aperture = focal**2 * (cosine_hole - cosine_rim) / mean_distance
    difference = aperture * (focal - z) / focal
    interference = np.sinc(0.5 * wavenumber * difference / np.pi)
    return 1j * source_pressure * wavenumber * aperture * interference * np.exp(-1j * wavenumber * mean_distance)
