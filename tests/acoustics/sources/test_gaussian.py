"""The Gaussian source: its march under the parabolic operator against the closed form, power, gradients."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.diffraction import ExactOneWay, Parabolic
from arfjax.acoustics.power import power_through_plane
from arfjax.acoustics.sources.gaussian import GaussianSource
from arfjax.errors import InputError
from arfjax.exact.gaussian_beam import pressure
from tests.acoustics.sources.problems import (
    BASIS,
    COMPLEX_WAVENUMBER,
    DENSITY,
    FREQUENCY,
    IMPEDANCE,
    WAVENUMBER,
    axial_wavenumber,
    marched,
    series,
)
from tests.checks import assert_gradient_of_each_leaf

Z, R = np.array([5e-3, 40e-3, 60e-3, 80e-3]), np.array([0.0, 1e-3, 4e-3])


@pytest.mark.parametrize(("radius", "focal"), [(5e-3, math.inf), (7e-3, 60e-3)])
def test_parabolic_march_is_the_closed_form(radius, focal):
    # In one step each: the sponge, which the beam does not reach, is the only thing to make the step matter.
    field = marched(series(GaussianSource(radius, focal)), Z, R, diffraction=Parabolic(), step=5e-3)
    exact = pressure(R, Z, radius=radius, wavenumber=WAVENUMBER, focal_length=focal)
    np.testing.assert_allclose(field, exact, rtol=0.0, atol=1e-6 * np.abs(exact).max())


def test_a_narrow_beam_hardly_needs_the_exact_operator():
    field = marched(series(GaussianSource(7e-3)), Z, R, diffraction=ExactOneWay(), step=5e-3)
    exact = pressure(R, Z, radius=7e-3, wavenumber=WAVENUMBER)
    # Of next order in (1 / (k radius))^2, times the distance in units of the beam's own.
    np.testing.assert_allclose(field, exact, rtol=0.0, atol=2e-3)


def test_the_closed_form_starts_as_the_source_and_loses_what_the_medium_takes():
    wavenumber = WAVENUMBER - 2j
    start = pressure(R, np.zeros(1), radius=3e-3, wavenumber=wavenumber, focal_length=0.05, source_pressure=4.0)
    source = GaussianSource(3e-3, 0.05).pressure_on_plane(4.0, jnp.asarray(wavenumber), R, 0.0)
    np.testing.assert_allclose(start[:, 0], source, rtol=1e-12)
    lossy, lossless = (pressure(R, Z, radius=3e-3, wavenumber=k) for k in (wavenumber, WAVENUMBER))
    np.testing.assert_allclose(np.abs(lossy / lossless), np.exp(-2.0 * Z)[None, :].repeat(3, axis=0), rtol=1e-12)


@pytest.mark.parametrize(("radius", "focal"), [(5e-3, math.inf), (8e-3, 40e-3)])
def test_power_is_that_of_the_area_less_the_obliquity(radius, focal):
    source = GaussianSource(radius, focal)
    frequency = jnp.asarray([FREQUENCY])
    power = power_through_plane(series(source)[None], axial_wavenumber(), BASIS, DENSITY, frequency)
    obliquity = (1.0 / (WAVENUMBER * radius)) ** 2 + (radius / focal) ** 2 / 4.0
    np.testing.assert_allclose(2.0 * IMPEDANCE * power / source.area, 1.0 - obliquity, atol=2e-4)


def test_gradient_in_radius_and_focal_length():
    def total(parameters):
        amplitude = GaussianSource(*parameters).series(1.0, COMPLEX_WAVENUMBER, BASIS)
        return jnp.sum(jnp.abs(amplitude * jnp.arange(256.0)) ** 2)

    assert_gradient_of_each_leaf(total, (5e-3, 60e-3), reverse=False)


def test_gradient_without_a_lens_is_finite():
    def on_plane(focal):
        return jnp.sum(jnp.abs(GaussianSource(5e-3, focal).pressure_on_plane(1.0, COMPLEX_WAVENUMBER, R, 0.0)))

    assert jax.grad(on_plane)(jnp.inf) == 0.0


@pytest.mark.parametrize(("radius", "focal"), [(0.0, 1.0), (-1e-3, 1.0), (5e-3, 0.0)])
def test_what_is_no_gaussian_is_refused(radius, focal):
    with pytest.raises(InputError, match="a Gaussian source needs"):
        GaussianSource(radius, focal).check()
