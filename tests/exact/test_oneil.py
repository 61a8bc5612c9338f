"""O'Neil's formula against tabulated values and against the integral that it solves."""

import numpy as np
import pytest

from arfjax.exact.oneil import axial_pressure
from arfjax.transducer import FocusedBowl

BOWL = FocusedBowl(aperture_radius=32e-3, hole_radius=10e-3, focal_length=62.6e-3)
WAVENUMBER = 2.0 * np.pi * 1.1e6 / 1482.0


def test_tabulated_magnitudes():
    z = np.array([20.0, 30.0, 40.0, 50.0, 55.0, 60.0, 62.1, 62.6, 65.0, 70.0, 80.0, 90.0]) * 1e-3
    expected = [0.9052, 3.7012, 2.5064, 9.8598, 9.2537, 34.7070, 37.4132, 37.2771, 33.2092, 15.4893, 5.9212, 2.2457]
    np.testing.assert_allclose(np.abs(axial_pressure(BOWL, z, wavenumber=WAVENUMBER)), expected, atol=6e-5)


def test_transcranial_benchmark_bowl():
    # 500 kHz, 64 mm aperture and curvature, 60 kPa: 1.0775 MPa at the focus, at most 1.0944 MPa at 61.9 mm.
    bowl = FocusedBowl(aperture_radius=32e-3, hole_radius=0.0, focal_length=64e-3)
    z = np.arange(50e-3, 70e-3, 0.1e-3)
    wavenumber = 2.0 * np.pi * 5e5 / 1500.0
    pressure = np.abs(axial_pressure(bowl, z, wavenumber=wavenumber, source_pressure=60e3))
    focus = np.abs(axial_pressure(bowl, np.array([64e-3]), wavenumber=wavenumber, source_pressure=60e3))
    np.testing.assert_allclose([pressure.max(), focus[0]], [1.0944e6, 1.0775e6], atol=60.0)
    np.testing.assert_allclose(z[np.argmax(pressure)], 61.9e-3, atol=1e-9)


@pytest.mark.parametrize("z", [12e-3, 62.6e-3, 90e-3])
def test_it_is_the_rayleigh_integral(z):
    nodes, weights = np.polynomial.legendre.leggauss(400)
    start, stop = np.arcsin(10.0 / 62.6), np.arcsin(32.0 / 62.6)
    angle = 0.5 * (start + stop) + 0.5 * (stop - start) * nodes
    distance = np.hypot(62.6e-3 * np.sin(angle), z - 62.6e-3 * (1.0 - np.cos(angle)))
    ring = 2.0 * np.pi * 62.6e-3**2 * np.sin(angle) * 0.5 * (stop - start) * weights
    direct = 0.5j * WAVENUMBER / np.pi * np.sum(ring * np.exp(-1j * WAVENUMBER * distance) / distance)
    np.testing.assert_allclose(axial_pressure(BOWL, np.array([z]), wavenumber=WAVENUMBER)[0], direct, rtol=1e-11)
