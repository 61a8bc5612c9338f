"""Relaxation moduli against the Mittag-Leffler function, its limits and the complex modulus; modulus readings."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erfcx

from arfjax.mechanics.viscoelastic import (
    ShearModulus,
    YoungModulus,
    prony_of_fractional_zener,
    prony_of_zener,
    viscoelastic_field,
)
from arfjax.media import FractionalZener, Zener
from tests.checks import assert_gradient

TIMES = np.geomspace(1e-2, 1e2, 25)


def mittag_leffler(order: float, time: float) -> float:
    """E_order(-time^order) by adaptive integration of its spectral density in the logarithm of the rate."""

    def density(x: float) -> float:
        return np.sin(order * np.pi) / (np.cosh(order * x) + np.cos(order * np.pi)) / (2.0 * np.pi)

    value, _ = quad(lambda x: density(x) * np.exp(-np.exp(x) * time), -60.0 / order, 12.0, limit=500, epsabs=1e-10)
    return value


def kernel_error(order: float, n_branches: int) -> float:
    prony = prony_of_fractional_zener(FractionalZener(0.0, 1.0, 1.0, order), n_branches=n_branches)
    ours = np.array([float(prony.relaxation_modulus(time)) for time in TIMES])
    return float(np.max(np.abs(ours - [mittag_leffler(order, time) for time in TIMES])))


def test_the_reference_is_right_at_order_one_half():
    exact = erfcx(np.sqrt(TIMES))
    np.testing.assert_allclose([mittag_leffler(0.5, time) for time in TIMES], exact, atol=1e-8)


@pytest.mark.parametrize(
    ("order", "n_branches", "claimed"),
    [
        (0.3, 16, 4e-4),
        (0.5, 16, 8e-5),
        (0.6, 16, 4e-5),
        (0.8, 16, 3e-3),
        (0.6, 12, 5e-4),
        (0.5, 24, 3e-5),
        (0.8, 24, 2e-4),
    ],
)
def test_kernel_error_is_as_documented(order, n_branches, claimed):
    assert 0.2 * claimed < kernel_error(order, n_branches) < claimed


def test_complex_modulus_of_the_branches_is_the_fractional_one():
    order, time = 0.6, 1e-3
    prony = prony_of_fractional_zener(FractionalZener(1e3, 1e4, time, order))
    omega = 2.0 * np.pi * np.geomspace(20.0, 2000.0, 9)
    phase = 1j * omega[None, :] * np.asarray(prony.relaxation_times)[:, None]
    ours = 1e3 + np.sum(np.asarray(prony.branch_moduli)[:, None] * phase / (1.0 + phase), axis=0)
    exact = 1e3 + 9e3 * (1j * omega * time) ** order / (1.0 + (1j * omega * time) ** order)
    np.testing.assert_allclose(ours, exact, rtol=3e-4)


@pytest.mark.parametrize("order", [0.05, 0.5, 0.999, 1.0])
def test_weights_are_positive_and_sum_to_the_relaxing_part(order):
    prony = prony_of_fractional_zener(FractionalZener(100.0, 350.0, 2e-3, order))
    assert np.all(np.asarray(prony.branch_moduli) >= 0.0) and np.all(np.asarray(prony.relaxation_times) > 0.0)
    np.testing.assert_allclose(prony.relaxation_modulus(0.0), 350.0, rtol=1e-13)


def test_order_one_is_the_conventional_zener_solid():
    conventional = prony_of_zener(Zener(100.0, 350.0, 2e-3))
    fractional = prony_of_fractional_zener(FractionalZener(100.0, 350.0, 2e-3, 1.0))
    for time in (0.0, 1e-3, 5e-3):
        np.testing.assert_allclose(
            fractional.relaxation_modulus(time), conventional.relaxation_modulus(time), rtol=1e-13
        )


def test_derivatives_in_the_constants():
    def modulus(constants):
        solid = FractionalZener(constants["relaxed"], constants["unrelaxed"], constants["time"], constants["order"])
        return prony_of_fractional_zener(solid).relaxation_modulus(7e-4)

    assert_gradient(modulus, {"relaxed": 1e3, "unrelaxed": 1e4, "time": 1e-3, "order": 0.6})
    assert_gradient(modulus, {"relaxed": 1e3, "unrelaxed": 1e4, "time": 1e-3, "order": 0.93})


def test_derivative_in_the_order_is_finite_at_one():
    slope = jax.grad(
        lambda order: prony_of_fractional_zener(FractionalZener(0.0, 1.0, 1.0, order)).relaxation_modulus(0.5)
    )(jnp.asarray(1.0))
    assert np.isfinite(slope)


def test_fields_of_constants_equal_point_by_point():
    relaxed = jnp.array([[1e3, 2e3, 3e3]])
    solid = jax.vmap(jax.vmap(lambda m: FractionalZener(m, 4.0 * m, 1e-6 * m, 0.5 + 1e-4 * m)))(relaxed)
    field = prony_of_fractional_zener(solid)
    point = prony_of_fractional_zener(FractionalZener(2e3, 8e3, 2e-3, 0.7))
    np.testing.assert_allclose(field.branch_moduli[:, 0, 1], point.branch_moduli, rtol=1e-12)
    np.testing.assert_allclose(field.relaxation_times[:, 0, 1], point.relaxation_times, rtol=1e-12)


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.49999])
def test_readings_agree_on_one_solid(poisson_ratio):
    shear = 1234.0
    young = 2.0 * shear * (1.0 + poisson_ratio)
    np.testing.assert_allclose(YoungModulus().shear_modulus(young, poisson_ratio), shear, rtol=1e-14)
    bulk = YoungModulus().bulk_modulus(young, poisson_ratio)
    np.testing.assert_allclose(ShearModulus().bulk_modulus(shear, poisson_ratio), bulk, rtol=1e-10)
    np.testing.assert_allclose(young, 9.0 * bulk * shear / (3.0 * bulk + shear), rtol=1e-10)


def test_a_young_modulus_gives_a_third_of_it_in_shear():
    prony = prony_of_zener(Zener(3e3, 9e3, 1e-3))
    field = viscoelastic_field(
        prony, (2, 3), density=1e3, bulk_modulus=jnp.full((2, 3), 5e5), reading=YoungModulus(), poisson_ratio=0.5
    )
    np.testing.assert_allclose(field.relaxed_shear_modulus, np.full((2, 3), 1e3))
    np.testing.assert_allclose(field.branch_shear_moduli, np.full((1, 2, 3), 2e3))


def test_nonsense_settings_are_refused():
    with pytest.raises(ValueError, match="n_branches"):
        prony_of_fractional_zener(FractionalZener(0.0, 1.0, 1.0, 0.5), n_branches=2)
