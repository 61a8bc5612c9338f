"""Exact harmonic motion of an infinite viscoelastic medium under a round Gaussian force."""

import numpy as np

from arfjax.numerics.quadrature import gauss_legendre


class UnboundedMedium:
    r"""Force density exp(-R^2 / a^2) along z, times exp(+i omega t).

    With $(\nabla^2 + k^2) \phi_k = -e^{-R^2 / a^2}$ and outgoing waves,
    $u = \phi_s \hat z / G + \nabla \partial_z (\phi_s - \phi_p) / (\rho \omega^2)$.
    """

    def __init__(self, *, width: float, shear: complex, bulk: float, density: float, frequency: float):
        self.width, self.shear = width, complex(shear)
        self.inertia = density * (2.0 * np.pi * frequency) ** 2
        self.shear_wave_number = np.sqrt(self.inertia / self.shear)
        self.pressure_wave_number = np.sqrt(self.inertia / (bulk + 4.0 * self.shear / 3.0))

    def _potential(self, k: complex, distance: float) -> tuple[complex, complex]:
        """The potential and its first derivative over the distance."""

        def integral(function, start, stop):
            points, weights = gauss_legendre(200)
            s = 0.5 * (start + stop) + 0.5 * (stop - start) * points
            return np.sum(0.5 * (stop - start) * weights * function(s) * s * np.exp(-((s / self.width) ** 2)))

        near = integral(lambda s: np.sin(k * s), 0.0, min(distance, 8.0 * self.width))
        far = integral(lambda s: np.exp(-1j * k * s), distance, max(distance, 8.0 * self.width))
        wave, standing = np.exp(-1j * k * distance), np.sin(k * distance)
        value = (wave * near + standing * far) / (k * distance)
        slope = (-1j * k * wave * near + k * np.cos(k * distance) * far) / (k * distance) - value / distance
        return value, slope / distance

    def axial_displacement(self, r: float, z: float) -> complex:
        """Axial displacement [m] at a point that is not the origin."""
        distance = np.hypot(r, z)
        source = np.exp(-((distance / self.width) ** 2))
        parts = []
        for k in (self.shear_wave_number, self.pressure_wave_number):
            value, slope = self._potential(k, distance)
            second = -source - 2.0 * slope - k**2 * value
            parts.append((value, slope + (second - slope) * (z / distance) ** 2))
        (shear_value, shear_zz), (_, pressure_zz) = parts
        return shear_value / self.shear + (shear_zz - pressure_zz) / self.inertia

    def radiated_power(self, omega: float) -> float:
        """Mean power [W] that an elastic medium carries away for a force of unit density at its centre."""
        total = np.pi**1.5 * self.width**3

        def share(k):
            return (k**3) * np.exp(-0.5 * (k * self.width) ** 2)

        waves = 2.0 * share(self.shear_wave_number.real) + share(self.pressure_wave_number.real)
        return omega * total**2 / (24.0 * np.pi * self.inertia) * waves
