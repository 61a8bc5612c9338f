"""Power-law attenuation and its dispersion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.absorption import complex_wavenumber, phase_speed
from arfjax.media import AcousticMedium
from tests.checks import assert_gradient

FREQUENCIES = jnp.asarray([0.3e6, 1e6, 1.1e6, 11e6])


def tissue(exponent):
    return AcousticMedium(1060.0, 1584.0, 8.0, exponent, 7.2)


@pytest.mark.parametrize("exponent", [0.4, 1.1, 1.55, 1.9])
def test_dispersion_is_the_published_formula(exponent):
    medium, omega = tissue(exponent), 2.0 * np.pi * np.asarray(FREQUENCIES)
    reference = 2.0 * np.pi * 1e6
    prefactor = 8.0 / reference**exponent
    slowness = 1.0 / 1584.0 + prefactor * np.tan(0.5 * np.pi * exponent) * (
        omega ** (exponent - 1.0) - reference ** (exponent - 1.0)
    )
    np.testing.assert_allclose(phase_speed(medium, FREQUENCIES), 1.0 / slowness, rtol=1e-12)
    np.testing.assert_allclose(complex_wavenumber(medium, FREQUENCIES).imag, -prefactor * omega**exponent, rtol=1e-12)


@pytest.mark.parametrize("exponent", [1.0, 1.0 + 1e-12, 1.0 - 1e-7])
def test_at_exponent_one_the_slowness_is_logarithmic(exponent):
    slowness = 1.0 / 1584.0 - 2.0 / np.pi * 8.0 / (2.0 * np.pi * 1e6) * np.log(np.asarray(FREQUENCIES) / 1e6)
    np.testing.assert_allclose(phase_speed(tissue(exponent), FREQUENCIES), 1.0 / slowness, rtol=1e-9)


@pytest.mark.parametrize("exponent", [0.0, 2.0])
def test_no_dispersion_at_either_end(exponent):
    np.testing.assert_allclose(phase_speed(tissue(exponent), FREQUENCIES), 1584.0, rtol=1e-12)


@pytest.mark.parametrize("exponent", [1.0, 1.0 + 1e-3, 1.55])
def test_gradient_in_the_exponent(exponent):
    def functional(medium):
        k = complex_wavenumber(medium, FREQUENCIES)
        return jnp.sum(k.real) / 1e4 + jnp.sum(k.imag)

    assert_gradient(functional, tissue(exponent))
    assert np.isfinite(jax.grad(functional)(tissue(1.0)).absorption_exponent)
