"""Closed forms of heat in perfused tissue: a Gaussian source without walls, and the modes of a cylinder.

Notation: kappa = conductivity / heat_capacity, the diffusivity; w = perfusion_conductance / heat_capacity.
"""

import numpy as np
from jaxtyping import Float
from scipy.integrate import quad_vec
from scipy.special import j0, jn_zeros

from arfjax.media import ThermalMedium

QUADRATURE_TOLERANCE = 1e-12
"""Relative to the largest value over the points."""

Points = float | Float[np.ndarray, "..."]


def gaussian_source_rise(
    r: Points,
    z: Points,
    time: float,
    medium: ThermalMedium,
    *,
    heat: float,
    radius: float,
    half_length: float,
    heating_duration: float | None = None,
) -> Points:
    r"""Temperature rise of an infinite medium around a Gaussian source.

    The heat is $Q \exp(-r^2/a^2 - z^2/b^2)$. Each instant's heat spreads as a Gaussian and decays by perfusion:

    $$ T = \frac{Q}{\rho c} \int e^{-w s} \frac{a^2}{a^2 + 4 \kappa s} \frac{b}{\sqrt{b^2 + 4 \kappa s}}
       \exp\left(-\frac{r^2}{a^2 + 4 \kappa s} - \frac{z^2}{b^2 + 4 \kappa s}\right) ds $$

    over the ages s of the heat that was deposited.

    Args:
        r: Radial positions [m], broadcast against `z`.
        z: Axial positions from the middle of the source [m].
        time: Since the heat was switched on [s].
        medium: Uniform constants.
        heat: Q, at the middle [W/m^3].
        radius: a, where the heat has fallen to 1/e [m].
        half_length: b, likewise along the axis [m].
        heating_duration: When the heat is switched off [s]; never when None.

    Returns:
        Rise above the arterial temperature, from which the medium started [K].

    Accuracy: adaptive quadrature to a relative 1e-12 of the largest value.
    Source: convolution of the heat with Green's function of the heat equation (Carslaw & Jaeger, Conduction of Heat in
    Solids, 2nd ed., section 10.2); perfusion multiplies it by exp(-w s).
    """
    diffusivity = float(medium.conductivity / medium.heat_capacity)
    loss_rate = float(medium.perfusion_conductance / medium.heat_capacity)

    def spread(age: float) -> Float[np.ndarray, "..."]:
        width, length = radius**2 + 4.0 * diffusivity * age, half_length**2 + 4.0 * diffusivity * age
        peak = radius**2 / width * half_length / np.sqrt(length) * np.exp(-loss_rate * age)
        return np.asarray(peak * np.exp(-(np.asarray(r) ** 2) / width - np.asarray(z) ** 2 / length))

    youngest = 0.0 if heating_duration is None else max(0.0, time - heating_duration)
    integral, _ = quad_vec(spread, youngest, time, epsabs=0.0, epsrel=QUADRATURE_TOLERANCE, norm="max")
    return heat / float(medium.heat_capacity) * integral


def cylinder_mode(
    r: Points, z: Points, *, radius: float, length: float, radial_order: int = 1, axial_order: int = 1
) -> Points:
    """Eigenfunction of a cylinder, 0 <= r <= radius and 0 <= z <= length, whose walls are held at zero."""
    root = jn_zeros(0, radial_order)[-1]
    return j0(root * np.asarray(r) / radius) * np.sin(axial_order * np.pi * np.asarray(z) / length)


def cylinder_mode_insulated(
    r: Points, z: Points, *, radius: float, length: float, radial_order: int = 1, axial_order: int = 1
) -> Points:
    """Eigenfunction of a cylinder, 0 <= r <= radius and 0 <= z <= length, whose walls are insulated."""
    root = jn_zeros(1, radial_order)[-1]
    return j0(root * np.asarray(r) / radius) * np.cos(axial_order * np.pi * np.asarray(z) / length)


def cylinder_mode_rate(
    medium: ThermalMedium,
    *,
    radius: float,
    length: float,
    radial_order: int = 1,
    axial_order: int = 1,
    insulated: bool = False,
) -> float:
    """Rate [1/s] at which a mode decays by conduction and perfusion, as exp(-rate t)."""
    root = jn_zeros(1 if insulated else 0, radial_order)[-1]
    squared_wavenumber = (root / radius) ** 2 + (axial_order * np.pi / length) ** 2
    conduction = float(medium.conductivity) * squared_wavenumber
    return (conduction + float(medium.perfusion_conductance)) / float(medium.heat_capacity)


def heated_mode_amplitude(
    time: float, rate: float, medium: ThermalMedium, *, heat: float, heating_duration: float | None = None
) -> float:
    """Amplitude [K] of a mode of decay `rate` [1/s] that `heat` [W/m^3] in its own shape drives from zero.

    Args:
        time: Since the heat was switched on [s].
        rate: As given by `cylinder_mode_rate`.
        medium: Uniform constants.
        heat: Amplitude of the heat [W/m^3].
        heating_duration: When the heat is switched off [s]; never when None.
    """
    end = time if heating_duration is None else min(time, heating_duration)
    return heat / (float(medium.heat_capacity) * rate) * -np.expm1(-rate * end) * np.exp(-rate * (time - end))
