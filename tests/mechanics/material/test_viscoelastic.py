"""Relaxation moduli against the Mittag-Leffler function, its limits and the complex modulus; modulus readings."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erfcx, gamma

from arfjax.errors import InputError
from arfjax.mechanics.material.complex_modulus import complex_modulus
from arfjax.mechanics.material.relaxation_spectrum import branches_for, kernel_error
from arfjax.mechanics.material.viscoelastic import (
    ConstrainedModulus,
    ShearModulus,
    YoungModulus,
    prony_of,
    prony_of_fractional_kelvin_voigt,
    prony_of_fractional_zener,
    prony_of_kelvin_voigt,
    prony_of_zener,
    viscoelastic_field,
)
from arfjax.media import Elastic, FractionalKelvinVoigt, FractionalZener, KelvinVoigt, Prony, Zener
from tests.checks import assert_gradient_of_each_leaf

WINDOW = (1e-2, 1e2)
PEAK = [-1.0, -0.1, -0.01, 0.0, 0.01, 0.1, 1.0]  # of the spectral density, where it is narrow near order 1
TIMES = np.geomspace(*WINDOW, 40)  # those at which `kernel_error` looks


def mittag_leffler(order: float, time: float) -> float:
    """E_order(-time^order) by adaptive integration of its spectral density in the logarithm of the rate."""

    def density(x: float) -> float:
        return np.sin(order * np.pi) / (np.cosh(order * x) + np.cos(order * np.pi)) / (2.0 * np.pi)

    value, _ = quad(
        lambda x: density(x) * np.exp(-np.exp(x) * time), -60.0 / order, 12.0, points=PEAK, limit=500, epsabs=1e-10
    )
    return value


def measured_error(order: float, n_branches: int) -> float:
    prony = prony_of_fractional_zener(FractionalZener(0.0, 1.0, 1.0, order), n_branches=n_branches)
    ours = np.array([float(prony.relaxation_modulus(time)) for time in TIMES])
    return float(np.max(np.abs(ours - [mittag_leffler(order, time) for time in TIMES])))


def test_the_reference_is_right_at_order_one_half():
    exact = erfcx(np.sqrt(TIMES))
    np.testing.assert_allclose([mittag_leffler(0.5, time) for time in TIMES], exact, atol=1e-8)


@pytest.mark.parametrize(
    ("n_branches", "claimed"), [(12, 1e-3), (16, 1.2e-4), (20, 3e-5), (24, 4e-6)]
)  # the table of `prony_of_fractional_zener`
def test_kernel_error_is_as_documented(n_branches, claimed):
    orders = [0.3, 0.6, 0.7, 0.8, 0.95, 0.99]
    errors = [kernel_error(order, n_branches, WINDOW) for order in orders]
    assert 0.2 * claimed < max(errors) < claimed
    worst = orders[int(np.argmax(errors))]
    np.testing.assert_allclose(measured_error(worst, n_branches), max(errors), atol=1e-9)  # of both references


@pytest.mark.parametrize("order", [0.15, 0.5, 0.9, 0.99])
def test_the_stated_error_is_the_measured_one(order):
    np.testing.assert_allclose(kernel_error(order, 18, WINDOW), measured_error(order, 18), atol=1e-9)


@pytest.mark.parametrize("window", [WINDOW, (1e-5, 1.0), (0.1, 3.0)])
def test_branches_follow_from_the_tolerance(window):
    """Enough also between the orders at which the number is chosen; one fewer is too few at one of these."""
    for tolerance in (1e-3, 3e-5):
        n_branches = branches_for(tolerance, window)
        between = [0.12, 0.35, 0.67, 0.77, 0.87, 0.93, 0.97, 0.995]
        assert max(kernel_error(order, n_branches, window) for order in between) < tolerance
        chosen_at = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98, 0.99, 0.999]
        assert max(kernel_error(order, n_branches, window) for order in chosen_at) <= tolerance
        assert max(kernel_error(order, n_branches - 1, window) for order in chosen_at) > tolerance
    assert branches_for(1e-4, WINDOW) <= 18


def test_a_tolerance_out_of_reach_is_refused():
    with pytest.raises(InputError, match="exponentials"):
        branches_for(1e-14, WINDOW)


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
            fractional.relaxation_modulus(time), conventional.relaxation_modulus(time), rtol=1e-8
        )


def test_derivatives_in_the_constants():
    def modulus(each):
        solids = [FractionalZener(*each["zener"]), FractionalZener(*each["near one"])]
        solids.append(FractionalKelvinVoigt(*each["spring-pot"]))
        viscous = KelvinVoigt(*each["viscous"])
        total = sum(prony_of(solid).relaxation_modulus(7e-4) for solid in solids)
        return total + prony_of_kelvin_voigt(viscous, shortest_time=3e-4).relaxation_modulus(7e-4)

    constants = {
        "zener": (1e3, 1e4, 1e-3, 0.6),
        "near one": (1e3, 1e4, 1e-3, 0.93),
        "spring-pot": (1e3, 40.0, 0.4),
        "viscous": (1e3, 1.5),
    }
    assert_gradient_of_each_leaf(modulus, constants)


def test_derivative_in_the_order_at_one_is_the_one_sided_one():
    def modulus(order):
        return prony_of_fractional_zener(FractionalZener(0.0, 1.0, 1.0, order), n_branches=24).relaxation_modulus(0.5)

    exact = (mittag_leffler(1.0 - 2e-3, 0.5) - mittag_leffler(1.0 - 1e-3, 0.5)) / -1e-3
    assert np.isfinite(jax.grad(modulus)(jnp.asarray(1.0)))
    assert float(jax.grad(modulus)(jnp.asarray(1.0 - 1.5e-3))) == pytest.approx(exact, rel=1e-3)


def test_derivative_of_a_spring_pot_in_its_order_is_that_of_its_closed_form():
    """Up to order 1, a dashpot: from below alone, since there is none above."""

    def loss(order, branches):
        solid = FractionalKelvinVoigt(100.0, 1.0, order)
        return complex_modulus(prony_of(solid) if branches else solid, jnp.asarray(300.0)).imag

    slope = jax.jit(jax.grad(loss), static_argnums=1)
    for order in (0.999, 0.99901, 1.0 - 1e-6, 1.0):
        assert float(slope(order, True)) == pytest.approx(float(slope(order, False)), rel=1e-3)
    # By its series and by what it is the series of, on both sides of where one takes over.
    assert float(slope(0.999 - 1e-10, True)) == pytest.approx(float(slope(0.999 + 1e-10, True)), rel=1e-8)


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
    constrained = bulk + 4.0 * shear / 3.0
    np.testing.assert_allclose(ConstrainedModulus().shear_modulus(constrained, poisson_ratio), shear, rtol=1e-10)
    np.testing.assert_allclose(ConstrainedModulus().bulk_modulus(constrained, poisson_ratio), bulk, rtol=1e-10)


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
    with pytest.raises(InputError, match="n_branches"):
        prony_of_fractional_kelvin_voigt(FractionalKelvinVoigt(0.0, 1.0, 0.5), n_branches=4)
    with pytest.raises(InputError, match="shortest_time"):
        prony_of_kelvin_voigt(KelvinVoigt(1.0, 1.0), shortest_time=0.0)


def test_a_viscosity_in_two_branches_is_second_order_and_never_makes_energy():
    solid, time = KelvinVoigt(2e3, 1.5), 2e-5
    branches = prony_of_kelvin_voigt(solid, shortest_time=time)
    omega = np.geomspace(10.0, 1e8, 200)
    assert np.all(np.asarray(complex_modulus(branches, omega)).imag > 0.0)
    low = omega[omega * time < 0.3]
    viscous = np.abs(np.asarray(complex_modulus(branches, low) - complex_modulus(solid, low))) / (1.5 * low)
    assert np.all(viscous < 2.0 * (low * time) ** 2 * 1.001)
    np.testing.assert_allclose(viscous[-1], 2.0 * (low[-1] * time) ** 2, rtol=0.3)
    # Its stress a long time after a step of strain, and the impulse of that stress: eta.
    np.testing.assert_allclose(branches.relaxation_modulus(40 * time), 2e3, rtol=1e-6)
    np.testing.assert_allclose(jnp.sum(branches.branch_moduli * branches.relaxation_times), 1.5, rtol=1e-13)


@pytest.mark.parametrize("order", [0.1, 0.3, 0.5, 0.8, 0.95, 1.0])
def test_spring_pot_as_documented(order):
    solid, (shortest, longest) = FractionalKelvinVoigt(0.0, 7.0, order), (1e-5, 1e-2)
    branches = prony_of_fractional_kelvin_voigt(solid, times=(shortest, longest))
    omega = np.geomspace(1.0 / longest, 0.1 / shortest, 60)
    exact = 7.0 * (1j * omega) ** order
    error = np.abs(np.asarray(complex_modulus(branches, omega)) - exact) / np.abs(exact)
    assert np.all(error < 1e-4 + 2.0 * order * (omega * shortest) ** 2)
    assert np.max(error) > 5e-5
    assert np.all(np.asarray(complex_modulus(branches, np.geomspace(1.0, 1e8, 99))).imag > 0.0)
    if order <= 0.5:  # the kernel itself; beyond, it is the fast viscosity more and more
        for time in (1e-3, 5e-3):
            exact = 7.0 * time**-order / gamma(1.0 - order)
            assert float(branches.relaxation_modulus(time)) == pytest.approx(exact, rel=1e-3)


def test_order_one_of_the_spring_pot_is_the_dashpot():
    dashpot = prony_of_kelvin_voigt(KelvinVoigt(3.0, 7.0), shortest_time=1e-5)
    branches = prony_of_fractional_kelvin_voigt(FractionalKelvinVoigt(3.0, 7.0, 1.0), times=(1e-5, 1e-2))
    np.testing.assert_allclose(branches.branch_moduli[-2:], dashpot.branch_moduli, rtol=1e-8)
    np.testing.assert_allclose(branches.branch_moduli[:-2], 0.0, atol=1e-9 * float(dashpot.branch_moduli[0]))


def test_every_solid_has_the_complex_modulus_of_its_branches():
    omega = 2.0 * np.pi * np.geomspace(20.0, 500.0, 7)
    prony = Prony(1e3, np.array([300.0, 2e3]), np.array([1e-2, 3e-4]))
    phase = 1j * omega[:, None] * prony.relaxation_times
    by_hand = 1e3 + np.sum(prony.branch_moduli * phase / (1.0 + phase), axis=1)
    np.testing.assert_allclose(complex_modulus(prony, omega), by_hand, rtol=1e-13)
    solids = [
        Elastic(2e3),
        Zener(1e3, 3e3, 1e-3),
        KelvinVoigt(1e3, 1.0),
        FractionalKelvinVoigt(1e3, 30.0, 0.4),
        FractionalZener(1e3, 9e3, 1e-1, 0.6),
    ]
    for solid in solids:
        branches = prony_of(solid, times=(1e-6, 0.1))
        np.testing.assert_allclose(complex_modulus(solid, omega), complex_modulus(branches, omega), rtol=2e-4)
    np.testing.assert_array_equal(prony_of(prony).branch_moduli, prony.branch_moduli)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Elastic(-1.0), "`modulus` must lie in 0 to 1e"),
        (lambda: Elastic(3e15), "Is its unit right"),
        (lambda: Zener(1.0, -2.0, 0.1), "unrelaxed_modulus"),
        # Of fields the first such point, not the smallest of one and the largest of another one.
        (lambda: Zener(jnp.array([1.0, 9.0, 5.0, 8.0]), jnp.array([2.0, 9.5, 4.0, 3.0]), 0.1), "got 4 and 5 Pa"),
        (lambda: Zener(5.0, jnp.array([6.0, 4.0, 3.0]), 0.1), "got 4 and 5 Pa"),
        (lambda: Zener(1.0, 2.0, -0.1), "`relaxation_time` must be finite and not negative"),
        (lambda: FractionalZener(1.0, 2.0, 0.1, 1.2), "fractional_order"),
        (lambda: KelvinVoigt(1.0, float("nan")), "viscosity"),
        (lambda: FractionalKelvinVoigt(1.0, jnp.array([1.0, -1.0]), 0.5), "viscosity"),
        (lambda: Prony(1.0, np.array([-2.0]), np.array([1.0])), "plus `branch_moduli`"),
        (lambda: Prony(1.0, np.array([2.0]), np.array([1.0, 2.0])), "1 branches"),
    ],
)
def test_constants_that_no_tissue_has_are_refused(make, told):
    with pytest.raises(InputError, match=told):
        make()


def test_slope_of_the_kernel_in_the_order_at_one():
    def kernel(order):
        return prony_of_fractional_zener(FractionalZener(0.0, 1.0, 1.0, order)).relaxation_modulus(0.5)

    def exact_slope(order, step=5e-4):
        relaxing = [mittag_leffler(order + side * step, 0.5) for side in (-1.0, 1.0)]
        return (relaxing[1] - relaxing[0]) / (2.0 * step)

    np.testing.assert_allclose(jax.grad(kernel)(0.999), exact_slope(0.999), rtol=5e-3)
    assert 0.4 < jax.grad(kernel)(1.0) / exact_slope(0.9995, 2e-4) < 2.5  # "about twice", says the docstring
