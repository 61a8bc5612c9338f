"""The heated sphere against closed forms that are simpler and against the heat equation itself."""

import numpy as np
import pytest
from scipy.special import erfc

from arfjax.exact.heated_sphere import heated_sphere_rise
from arfjax.media import ThermalMedium

BLOODLESS = ThermalMedium(conductivity=0.5, heat_capacity=4e6, perfusion_conductance=0.0)
MEDIUM = ThermalMedium(conductivity=0.5, heat_capacity=4e6, perfusion_conductance=5e4)
SPHERE = {"heat": 1e7, "radius": 2e-3}
DISTANCES = np.array([1e-4, 1e-3, 2e-3, 2.1e-3, 5e-3])


def repeated_integral(order: int, x):
    """i^n erfc(x), by recurrence (Carslaw & Jaeger, appendix II)."""
    if order == -1:
        return 2.0 / np.sqrt(np.pi) * np.exp(-(x**2))
    if order == 0:
        return erfc(x)
    return (repeated_integral(order - 2, x) - 2.0 * x * repeated_integral(order - 1, x)) / (2.0 * order)


def bloodless_closed_form(distance, time: float):
    """Distance times rise obeys conduction in one dimension, with the heat d H(|d| < a): two steps and two ramps."""
    heat, a, kappa = SPHERE["heat"], SPHERE["radius"], 0.5 / 4e6
    spread = np.sqrt(4.0 * kappa * time)

    def step(x):
        return 2.0 * time * (repeated_integral(2, -x / spread) - np.maximum(x / spread, 0.0) ** 2)

    def ramp(x):
        return 2.0 * time * spread * (repeated_integral(3, -x / spread) - np.maximum(x / spread, 0.0) ** 3 / 3.0)

    driven = ramp(distance + a) - a * step(distance + a) - ramp(distance - a) - a * step(distance - a)
    return heat / 4e6 * driven / distance


def steady_with_perfusion(distance):
    """Sinh inside and a decaying exponential outside, of equal value and slope at the edge."""
    m = np.sqrt(5e4 / 0.5)
    x, edge = m * distance, m * SPHERE["radius"]
    inside = 1.0 - (1.0 + edge) * np.exp(-edge) * np.sinh(x) / x
    outside = (edge * np.cosh(edge) - np.sinh(edge)) * np.exp(-x) / x
    return SPHERE["heat"] / 5e4 * np.where(x < edge, inside, outside)


@pytest.mark.parametrize("time", [1.0, 20.0, 300.0])
def test_closed_form_without_perfusion(time):
    rise = heated_sphere_rise(DISTANCES, time, BLOODLESS, **SPHERE)
    np.testing.assert_allclose(rise, bloodless_closed_form(DISTANCES, time), rtol=1e-9, atol=1e-11 * rise.max())


def test_nothing_is_warm_at_first():
    np.testing.assert_array_equal(heated_sphere_rise(DISTANCES, 0.0, MEDIUM, **SPHERE), np.zeros(len(DISTANCES)))


def test_steady_state_with_perfusion():
    rise = heated_sphere_rise(DISTANCES, 4000.0, MEDIUM, **SPHERE)
    np.testing.assert_allclose(rise, steady_with_perfusion(DISTANCES), rtol=1e-11)


def test_steady_state_at_the_middle_without_perfusion():
    """Q a^2 / 2k, short of it by the part (2/3) a / sqrt(pi kappa t) that has not come back from far away."""
    time, kappa = 1e8, 0.5 / 4e6
    missing = 2.0 / 3.0 * 2e-3 / np.sqrt(np.pi * kappa * time)
    rise = heated_sphere_rise(0.0, time, BLOODLESS, **SPHERE)
    np.testing.assert_allclose(rise, 1e7 * 2e-3**2 / (2.0 * 0.5) * (1.0 - missing), rtol=1e-8)


def test_the_middle_warms_by_heat_alone_at_first_and_keeps_its_slope():
    np.testing.assert_allclose(heated_sphere_rise(0.0, 0.1, MEDIUM, **SPHERE), 1e7 / 4e6 * 0.1, rtol=1e-3)
    near = heated_sphere_rise(np.array([0.0, 1e-9, 1e-6]), 20.0, MEDIUM, **SPHERE)
    np.testing.assert_allclose(near, near[0], rtol=1e-6)


@pytest.mark.parametrize("distance", [1.3e-3, 2.8e-3])
def test_it_solves_the_equation(distance):
    time, h, dt = 12.0, 2e-5, 2e-3

    def rise(away=0.0, later=0.0):
        return heated_sphere_rise(distance + away, time + later, MEDIUM, **SPHERE)

    laplacian = (rise(h) + rise(-h) - 2.0 * rise()) / h**2 + (rise(h) - rise(-h)) / (h * distance)
    rate = (rise(later=dt) - rise(later=-dt)) / (2.0 * dt)
    heat = 1e7 if distance < 2e-3 else 0.0
    np.testing.assert_allclose(4e6 * rate, 0.5 * laplacian - 5e4 * rise() + heat, atol=1e-5 * 1e7)


def test_a_pulse_is_the_difference_of_two_steps():
    pulse = heated_sphere_rise(DISTANCES, 25.0, MEDIUM, **SPHERE, heating_duration=10.0)
    steps = heated_sphere_rise(DISTANCES, 25.0, MEDIUM, **SPHERE) - heated_sphere_rise(
        DISTANCES, 15.0, MEDIUM, **SPHERE
    )
    np.testing.assert_allclose(pulse, steps, atol=1e-11 * steps.max())


def test_all_heat_is_in_the_medium_or_in_the_blood():
    """Energy: the volume integral decays at the rate of perfusion alone."""
    points, weights = np.polynomial.legendre.leggauss(60)
    stored = 0.0
    for start, stop in ((0.0, 2e-3), (2e-3, 0.03)):
        distance = start + 0.5 * (stop - start) * (points + 1.0)
        rise = heated_sphere_rise(distance, 20.0, MEDIUM, **SPHERE)
        stored += 4e6 * 0.5 * (stop - start) * np.sum(weights * 4.0 * np.pi * distance**2 * rise)
    rate = 5e4 / 4e6
    delivered = 1e7 * 4.0 / 3.0 * np.pi * 2e-3**3 * -np.expm1(-rate * 20.0) / rate
    np.testing.assert_allclose(stored, delivered, rtol=1e-7)
