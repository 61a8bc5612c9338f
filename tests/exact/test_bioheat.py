"""The closed forms against simpler closed forms and against the heat equation itself."""

import numpy as np
import pytest
from scipy.special import exp1

from arfjax.exact.bioheat import (
    cylinder_mode,
    cylinder_mode_insulated,
    cylinder_mode_rate,
    gaussian_source_rise,
    heated_mode_amplitude,
)
from arfjax.media import ThermalMedium

MEDIUM = ThermalMedium(conductivity=0.5, heat_capacity=4e6, perfusion_conductance=5e4)
BLOODLESS = ThermalMedium(conductivity=0.5, heat_capacity=4e6, perfusion_conductance=0.0)
SOURCE = {"heat": 1e7, "radius": 1e-3, "half_length": 4e-3}


def test_middle_of_a_spherical_source():
    kappa, a, time = 0.5 / 4e6, 1e-3, 20.0
    rise = gaussian_source_rise(0.0, 0.0, time, BLOODLESS, heat=1e7, radius=a, half_length=a)
    exact = 1e7 / 4e6 * a**2 / (2.0 * kappa) * (1.0 - (1.0 + 4.0 * kappa * time / a**2) ** -0.5)
    np.testing.assert_allclose(rise, exact, rtol=1e-11)


def test_side_of_a_line_source():
    """A source without end: the heat of a thin line, E1(r^2 / 4 kappa t) / (4 pi k), shifted in age by a^2/4 kappa."""
    kappa, a, time, r = 0.5 / 4e6, 1e-3, 30.0, 2e-3
    rise = gaussian_source_rise(r, 0.0, time, BLOODLESS, heat=1e7, radius=a, half_length=1e3)
    power = 1e7 * np.pi * a**2
    exact = power / (4.0 * np.pi * 0.5) * (exp1(r**2 / (a**2 + 4.0 * kappa * time)) - exp1(r**2 / a**2))
    np.testing.assert_allclose(rise, exact, rtol=1e-9)


def test_a_pulse_is_the_difference_of_two_steps():
    r, z = np.linspace(0.0, 5e-3, 7)[:, None], np.linspace(-1e-2, 1e-2, 5)[None, :]
    pulse = gaussian_source_rise(r, z, 25.0, MEDIUM, **SOURCE, heating_duration=10.0)
    steps = gaussian_source_rise(r, z, 25.0, MEDIUM, **SOURCE) - gaussian_source_rise(r, z, 15.0, MEDIUM, **SOURCE)
    np.testing.assert_allclose(pulse, steps, atol=1e-11 * steps.max())


def test_gaussian_source_solves_the_equation():
    time, r, z, h, dt = 12.0, 1.3e-3, 2e-3, 1e-5, 1e-3

    def rise(dr=0.0, dz=0.0, later=0.0):
        return gaussian_source_rise(r + dr, z + dz, time + later, MEDIUM, **SOURCE)

    laplacian = (rise(dr=h) + rise(dr=-h) + rise(dz=h) + rise(dz=-h) - 4.0 * rise()) / h**2
    laplacian += (rise(dr=h) - rise(dr=-h)) / (2.0 * h * r)
    rate = (rise(later=dt) - rise(later=-dt)) / (2.0 * dt)
    heat = 1e7 * np.exp(-((r / 1e-3) ** 2) - (z / 4e-3) ** 2)
    np.testing.assert_allclose(4e6 * rate, 0.5 * laplacian - 5e4 * rise() + heat, rtol=1e-4)


@pytest.mark.parametrize("orders", [(1, 1), (2, 3)])
@pytest.mark.parametrize("insulated", [False, True])
def test_modes_are_eigenfunctions_between_their_walls(insulated, orders):
    size = {"radius": 7e-3, "length": 2e-2, "radial_order": orders[0], "axial_order": orders[1]}
    mode = cylinder_mode_insulated if insulated else cylinder_mode
    rate = cylinder_mode_rate(MEDIUM, **size, insulated=insulated)
    r, z, h = 2.1e-3, 6.7e-3, 1e-5
    at = mode(r, z, **size)
    laplacian = mode(r + h, z, **size) + mode(r - h, z, **size) + mode(r, z + h, **size) + mode(r, z - h, **size)
    laplacian = (laplacian - 4.0 * at) / h**2 + (mode(r + h, z, **size) - mode(r - h, z, **size)) / (2.0 * h * r)
    np.testing.assert_allclose(0.5 * laplacian - 5e4 * at, -rate * 4e6 * at, rtol=1e-4)
    edge = [mode(7e-3, z, **size), mode(r, 0.0, **size), mode(r, 2e-2, **size)]
    if insulated:
        inside = [mode(7e-3 - h, z, **size), mode(r, h, **size), mode(r, 2e-2 - h, **size)]
        np.testing.assert_allclose(inside, edge, atol=1e-4)
    else:
        np.testing.assert_allclose(edge, 0.0, atol=1e-12)


def test_a_driven_mode_follows_its_equation():
    rate, h = 0.05, 1e-3
    for time in (10.0, 40.0):
        around = [heated_mode_amplitude(t, rate, MEDIUM, heat=1e6, heating_duration=25.0) for t in (time - h, time + h)]
        here = heated_mode_amplitude(time, rate, MEDIUM, heat=1e6, heating_duration=25.0)
        drive = 1e6 / 4e6 if time < 25.0 else 0.0
        np.testing.assert_allclose((around[1] - around[0]) / (2.0 * h), drive - rate * here, rtol=1e-6)
    assert heated_mode_amplitude(0.0, rate, MEDIUM, heat=1e6) == 0.0
