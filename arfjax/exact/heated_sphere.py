"""Closed form of heat in perfused tissue around a sphere that is heated evenly.

Its heat has an edge, which a Gaussian's has not: a solver must place it between the centres of its cells.
"""

import numpy as np
from jaxtyping import Float
from scipy.integrate import quad_vec
from scipy.special import erf

from arfjax.exact.bioheat import QUADRATURE_TOLERANCE, Points
from arfjax.media import ThermalMedium


def heated_sphere_rise(
    distance: Points,
    time: float,
    medium: ThermalMedium,
    *,
    heat: float,
    radius: float,
    heating_duration: float | None = None,
) -> Points:
    r"""Temperature rise of an infinite medium, of which a sphere is heated evenly.

    Of the heat deposited an age s ago, conduction has left the part p at a distance d from the middle of the sphere of
    radius a, and perfusion has left exp(-w s) of that, with $\ell = \sqrt{4 \kappa s}$:

    $$ T = \frac{Q}{\rho c} \int e^{-w s} p(s) \, ds, \quad
       p = \frac12 \left[\mathrm{erf}\frac{a + d}{\ell} + \mathrm{erf}\frac{a - d}{\ell}\right]
       - \frac{\ell}{2 \sqrt\pi d} \left[e^{-(a - d)^2 / \ell^2} - e^{-(a + d)^2 / \ell^2}\right] $$

    Args:
        distance: From the middle of the sphere [m].
        time: Since the heat was switched on [s].
        medium: Uniform constants.
        heat: Q, inside the sphere [W/m^3].
        radius: a, of the sphere [m].
        heating_duration: When the heat is switched off [s]; never when None.

    Returns:
        Rise above the arterial temperature, from which the medium started [K].

    Accuracy: adaptive quadrature to a relative 1e-12 of the largest value.
    Source: Carslaw & Jaeger, Conduction of Heat in Solids, 2nd ed., section 10.3, for the sphere that was evenly hot at
    first; convolution with the heat; perfusion multiplies by exp(-w s).
    """
    diffusivity = float(medium.conductivity / medium.heat_capacity)
    loss_rate = float(medium.perfusion_conductance / medium.heat_capacity)
    away = np.asarray(distance, dtype=float)
    if time == 0.0:
        return np.zeros_like(away)

    def left(root_age: float) -> Float[np.ndarray, "..."]:
        # In the root of the age, in which the heat just deposited is smooth too: ds = 2 root d(root).
        spread = np.sqrt(4.0 * diffusivity) * root_age
        remaining = 2.0 * root_age * np.exp(-loss_rate * root_age**2)
        return np.asarray(remaining * _part_left(away, radius, spread))

    youngest = 0.0 if heating_duration is None else max(0.0, time - heating_duration)
    integral, _ = quad_vec(
        left, np.sqrt(youngest), np.sqrt(time), epsabs=0.0, epsrel=QUADRATURE_TOLERANCE, norm="max", limit=2000
    )
    return heat / float(medium.heat_capacity) * integral


def _part_left(distance: Float[np.ndarray, "..."], radius: float, spread: float) -> Float[np.ndarray, "..."]:
    """Rise around a sphere that was evenly at one, when heat has spread over a length."""
    inside = 0.5 * (erf((radius + distance) / spread) + erf((radius - distance) / spread))
    # The difference of exponentials over the distance, in a form that holds at the middle, where it is 4 a / l^2.
    exponent = 4.0 * radius * distance / spread**2
    per_exponent = -np.expm1(-exponent) / np.where(exponent > 0.0, exponent, 1.0) + (exponent == 0.0)
    over_distance = np.exp(-(((radius - distance) / spread) ** 2)) * per_exponent * 4.0 * radius / spread**2
    return np.asarray(inside - spread / (2.0 * np.sqrt(np.pi)) * over_distance)
