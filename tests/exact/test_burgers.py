"""Plane waves against tabulated harmonics, each other, the classical series and Burgers' equation itself."""

import numpy as np
import pytest
from scipy import special

from arfjax.exact.burgers import blackstock, fay, fubini, mendousse

FIRST_FIVE = np.arange(1, 6)


@pytest.mark.parametrize(
    ("solution", "sigma", "expected"),
    [
        (fubini, 0.5, [0.969074, 0.229807, 0.081285, 0.033996, 0.015601]),
        (fubini, 0.75, [0.931316, 0.309450, 0.152075, 0.088023, 0.055784]),
        (fubini, 1.0, [0.880101, 0.352834, 0.206042, 0.140565, 0.104456]),
        (blackstock, 1.5, [0.756365, 0.348602, 0.224688, 0.165520, 0.130987]),
        (blackstock, 3.0, [0.494324, 0.243645, 0.161807, 0.121168, 0.096860]),
        (lambda n, sigma: fay(n, sigma, 10.0), 4.0, [0.383807, 0.170184, 0.093928, 0.055144, 0.033057]),
    ],
)
def test_tabulated_harmonics(solution, sigma, expected):
    np.testing.assert_allclose(solution(FIRST_FIVE, sigma), expected, rtol=0.0, atol=5.0001e-7)


@pytest.mark.parametrize("solution", [fubini, lambda n, sigma: mendousse(n, sigma, 100.0)])
def test_it_starts_as_a_sine(solution):
    # Second harmonic sigma / 2 at first order; the fundamental falls by sigma / Gamma at most.
    amplitudes = solution(FIRST_FIVE, 1e-4)
    np.testing.assert_allclose(amplitudes, [1.0, 5e-5, 0.0, 0.0, 0.0], rtol=0.0, atol=2e-6)
    np.testing.assert_array_equal(fubini(FIRST_FIVE, 0.0), [1.0, 0.0, 0.0, 0.0, 0.0])


def test_blackstock_is_fubini_before_the_shock_and_the_sawtooth_far_beyond():
    n = np.arange(1, 40)
    for sigma in (0.0, 0.3, 0.9, 1.0):
        np.testing.assert_allclose(blackstock(n, sigma), fubini(n, sigma), rtol=0.0, atol=1e-14)
    far = blackstock(n, 1e3)
    np.testing.assert_allclose(far, 2.0 / (n * 1001.0), rtol=1e-4)


def test_weak_shock_dissipates_the_cube_of_its_jump():
    # The mean of P^2 falls by (2 sin Phi_s)^3 / (12 pi) per sigma; the jump's tail, constant n B_n, closes the sum.
    n = np.arange(1, 801)

    def energy(sigma):
        amplitude = blackstock(n, sigma)
        return np.sum(amplitude**2) + amplitude[-1] ** 2 * 800.0**2 / 800.5

    sigma, step = 2.0, 1e-3
    peak = 0.9477471335169906  # of the root of x = 2 sin x
    slope = (energy(sigma + step) - energy(sigma - step)) / (2.0 * step)
    np.testing.assert_allclose(slope, -4.0 / (3.0 * np.pi) * peak**3, rtol=1e-5)


@pytest.mark.parametrize(
    ("goldberg_number", "sigma"), [(0.1, 1.0), (1.0, 0.5), (10.0, 0.01), (10.0, 4.0), (10.0, 30.0)]
)
def test_the_mean_is_the_series_of_bessel_functions(goldberg_number, sigma):
    m, points = np.arange(1, 200), 4096
    theta = 2.0 * np.pi * np.arange(points) / points
    terms = special.ive(m, goldberg_number / 2.0) * np.exp(-(m**2) * sigma / goldberg_number) * (-1.0) ** m
    potential = special.ive(0, goldberg_number / 2.0) + 2.0 * np.cos(np.outer(theta, m)) @ terms
    pressure = -4.0 / goldberg_number * np.sin(np.outer(theta, m)) @ (m * terms) / potential
    expected = 2.0 / points * np.sin(np.outer(FIRST_FIVE, theta)) @ pressure
    np.testing.assert_allclose(mendousse(FIRST_FIVE, sigma, goldberg_number), expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("solution", "goldberg_number"), [(fay, 10.0), (mendousse, 10.0), (mendousse, 40.0)])
def test_burgers_equation_holds(solution, goldberg_number):
    """dB_n / dsigma = (n / 2) (1/2 sum_m B_m B_(n-m) - sum_m B_m B_(m+n)) - n^2 B_n / Gamma."""
    n, sigma, step = np.arange(1, 257), 4.0, 1e-3
    at = [solution(n, sigma + k * step, goldberg_number) for k in (-2, -1, 0, 1, 2)]
    slope = (at[0] - 8.0 * at[1] + 8.0 * at[3] - at[4]) / (12.0 * step)
    amplitude = at[2]
    correlation = np.correlate(amplitude, amplitude, "full")[256:]
    convolution = np.concatenate([[0.0], np.convolve(amplitude, amplitude)])[:256]
    change = 0.5 * n * (0.5 * convolution - np.append(correlation, 0.0)[:256]) - n**2 * amplitude / goldberg_number
    np.testing.assert_allclose(slope, change, rtol=0.0, atol=1e-9)


def test_the_limits_of_large_goldberg_number():
    # Before the shock and with it, the inviscid solutions are approached at first order in 1 / Gamma.
    for sigma in (0.5, 2.0):
        coarse, fine = (mendousse(FIRST_FIVE, sigma, gamma) - blackstock(FIRST_FIVE, sigma) for gamma in (2e3, 4e3))
        np.testing.assert_allclose(coarse / fine, 2.0, rtol=0.05)
    # Old age: Fay's solution, for it the shock must be thin and sigma large.
    np.testing.assert_allclose(mendousse(FIRST_FIVE, 20.0, 50.0), fay(FIRST_FIVE, 20.0, 50.0), rtol=3e-3)


def test_many_harmonics_of_a_thin_shock_fall_as_fays_do():
    n = np.array([1, 64, 128, 256])
    amplitude = mendousse(n, 4.0, 1000.0)
    assert np.all(amplitude > 0.0)
    np.testing.assert_allclose(amplitude / fay(n, 4.0, 1000.0), 1.0, atol=0.05)
    assert np.all(np.isfinite(fay(np.array([10_000]), 4.0, 1.0)))
