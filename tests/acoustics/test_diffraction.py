"""Axial wavenumbers: dispersion relation, decay, small angles, gradients at grazing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.diffraction import ExactOneWay, Parabolic

KAPPA = jnp.asarray([0.0, 100.0, 4000.0, 4600.0, 4700.0, 12000.0])


@pytest.mark.parametrize("attenuation", [0.0, 5.0, 300.0])
def test_the_exact_one_satisfies_the_dispersion_relation_and_decays(attenuation):
    k = jnp.asarray([4663.0 - 1j * attenuation, 9326.0 - 2j * attenuation])
    kz = np.asarray(ExactOneWay().axial_wavenumber(k, KAPPA))
    # atol: the stated loss of 1e-12 in k^2.
    np.testing.assert_allclose(
        kz**2, np.asarray(k)[:, None] ** 2 - np.asarray(KAPPA)[None, :] ** 2, rtol=1e-12, atol=2e-4
    )
    assert np.all(np.imag(kz) < 0.0)
    assert np.all(np.real(kz) > 0.0)


def test_absorption_acts_along_the_path_of_each_component():
    attenuation, angle = 5.0, 0.5
    k = jnp.asarray([4663.0 - 1j * attenuation])
    kz = ExactOneWay().axial_wavenumber(k, jnp.asarray([4663.0 * np.sin(angle)]))
    np.testing.assert_allclose(kz[0, 0].imag, -attenuation / np.cos(angle), rtol=1e-5)
    kz = Parabolic().axial_wavenumber(k, jnp.asarray([4663.0 * np.sin(angle)]))
    np.testing.assert_allclose(kz[0, 0].imag, -attenuation, rtol=1e-12)


def test_the_parabola_agrees_at_small_angles_to_fourth_order():
    k = jnp.asarray([4663.0 + 0j])
    for sine in (0.05, 0.1):
        kappa = jnp.asarray([4663.0 * sine])
        difference = Parabolic().axial_wavenumber(k, kappa) - ExactOneWay().axial_wavenumber(k, kappa)
        np.testing.assert_allclose(difference.real, 4663.0 * sine**4 / 8.0, rtol=0.01)


@pytest.mark.parametrize("diffraction", [ExactOneWay(), Parabolic()])
def test_gradients_are_finite_without_loss_even_at_grazing(diffraction):
    kappa = jnp.asarray([0.0, 4663.0, 5000.0])

    def functional(parameters):
        k = (parameters[0] - 1j * parameters[1])[None]
        return jnp.sum(jnp.abs(jnp.exp(-1e-3j * diffraction.axial_wavenumber(k, kappa))))

    assert np.all(np.isfinite(jax.grad(functional)(jnp.asarray([4663.0, 0.0]))))
