"""Axial wavenumbers: dispersion relation, decay, small angles, gradients at grazing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.diffraction import ExactOneWay, Pade11, Pade12, Parabolic
from tests.checks import assert_order

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


def test_absorption_along_the_axis_and_dispersion_of_the_exact_one():
    k = jnp.asarray([4663.0 - 5j, 9326.0 - 11j])
    along_axis = np.asarray(ExactOneWay(absorption_along_ray=False).axial_wavenumber(k, KAPPA))
    lossless = np.asarray(ExactOneWay().axial_wavenumber(k.real + 0j, KAPPA))
    np.testing.assert_allclose(along_axis.real, lossless.real, rtol=1e-14)
    np.testing.assert_allclose(along_axis.imag, lossless.imag + np.asarray(k.imag)[:, None], rtol=1e-14)
    on_axis = np.asarray(k)[:, None] * np.ones(1)
    np.testing.assert_allclose(along_axis[:, :1], on_axis, rtol=1e-11)


@pytest.mark.parametrize(
    ("diffraction", "order", "coefficient"), [(Parabolic(), 2, 1 / 8), (Pade11(), 3, 1 / 32), (Pade12(), 4, 1 / 128)]
)
def test_the_approximations_agree_at_small_angles_to_their_order(diffraction, order, coefficient):
    s = np.array([0.05, 0.1, 0.2])
    k, kappa = jnp.asarray([4663.0 - 5j]), jnp.asarray(4663.0 * np.sqrt(s))
    kz = np.asarray(diffraction.axial_wavenumber(k, kappa))[0]
    np.testing.assert_allclose(kz.imag, -5.0, rtol=1e-12)  # absorption along the axis
    error = kz.real / 4663.0 - np.sqrt(1.0 - s)
    assert_order(s, error, order=order)
    # The next terms of the series grow like the square root's own, by at most 5 / 2 s.
    np.testing.assert_allclose(error[:2], coefficient * s[:2] ** order, rtol=0.2)
    assert np.all(error[:2] > coefficient * s[:2] ** order)


@pytest.mark.parametrize("diffraction", [Pade11(), Pade12()])
def test_rational_operators_are_continuous_and_never_grow(diffraction):
    k = 4663.0
    s = np.linspace(0.0, 40.0, 40_001)  # over every zero and pole
    kz = np.asarray(diffraction.axial_wavenumber(jnp.asarray([k + 0j]), jnp.asarray(k * np.sqrt(s))))[0]
    assert np.all(kz.imag <= 0.0)
    assert np.all(kz.imag[s <= 1.0] == 0.0)
    assert np.all(kz.imag[s > 1.5] < -0.1 * k)
    assert np.all(np.abs(np.diff(kz)) < 3e-3 * k)  # a slope of at most 3


@pytest.mark.parametrize(
    "diffraction", [ExactOneWay(), ExactOneWay(absorption_along_ray=False), Parabolic(), Pade11(), Pade12()]
)
def test_gradients_are_finite_without_loss_even_at_grazing(diffraction):
    # The last are where a ratio is zero (s = 4/3 and 4 - sqrt 8) or infinite (s = 4 and 2).
    kappa = jnp.asarray([0.0, 4663.0, 5000.0, *(4663.0 * np.sqrt([4.0 / 3.0, 4.0 - np.sqrt(8.0), 4.0, 2.0]))])

    def functional(parameters):
        k = (parameters[0] - 1j * parameters[1])[None]
        return jnp.sum(jnp.abs(jnp.exp(-1e-3j * diffraction.axial_wavenumber(k, kappa))))

    assert np.all(np.isfinite(jax.grad(functional)(jnp.asarray([4663.0, 0.0]))))
