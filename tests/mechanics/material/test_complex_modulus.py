"""Complex modulus of the Zener solids against the paper's equations, at every corner of the domain."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.mechanics.material.complex_modulus import (
    complex_modulus,
    complex_shear_field,
    loss_modulus,
    modulus_magnitude,
    storage_modulus,
)
from arfjax.mechanics.material.viscoelastic import YoungModulus
from arfjax.media import Elastic, FractionalKelvinVoigt, FractionalZener, KelvinVoigt, Prony, Zener
from tests.checks import assert_gradient

ROUNDING = 64.0 * np.finfo(float).eps
"""A few dozen roundings of numbers of order one, with the error of the exponent alpha log(omega tau) included."""


def literal(relaxed, unrelaxed, time, order, omega):
    """The paper's two equations, term by term."""
    d, w = unrelaxed / relaxed, (omega * time) ** order
    c, s = np.cos(order * np.pi / 2.0), np.sin(order * np.pi / 2.0)
    below = 1.0 + 2.0 * c * w + w**2
    return relaxed * (1.0 + (d + 1.0) * c * w + d * w**2) / below + 1j * relaxed * (d - 1.0) * s * w / below


@pytest.mark.parametrize("order", [0.01, 0.3, 0.77, 1.0])
@pytest.mark.parametrize(("relaxed", "unrelaxed"), [(855.2, 3.0e3), (8.0, 1.5e4), (1.0, 1.0), (1e-3, 1e9)])
def test_paper_formula(order, relaxed, unrelaxed):
    omega = np.geomspace(1e-12, 1e12, 97)
    solid = FractionalZener(relaxed, unrelaxed, 0.46, order)
    expected = literal(relaxed, unrelaxed, 0.46, order, omega)
    actual = np.asarray(complex_modulus(solid, omega))
    np.testing.assert_allclose(actual.real, expected.real, rtol=ROUNDING)
    np.testing.assert_allclose(actual.imag, expected.imag, rtol=ROUNDING, atol=ROUNDING * relaxed)


def test_order_one_is_the_conventional_solid():
    omega = np.geomspace(1e-6, 1e6, 61)
    conventional = complex_modulus(Zener(8.0, 15e3, 0.462), omega)
    np.testing.assert_allclose(complex_modulus(FractionalZener(8.0, 15e3, 0.462, 1.0), omega), conventional, rtol=1e-13)
    np.testing.assert_allclose(conventional, literal(8.0, 15e3, 0.462, 1.0, omega), rtol=1e-12)


@pytest.mark.parametrize(
    ("solid", "hertz", "stated"),
    [
        (FractionalZener(855.2, 3.0e3, 1.23e-2, 0.40), 200.0, 2.4e3),
        (FractionalZener(8.1, 20.2e3, 2.24e-1, 0.55), 200.0, 19e3),
        (FractionalZener(8.1, 171.2e3, 9.99e-2, 0.32), 200.0, 140e3),
        (FractionalZener(8.1, 335.5e3, 5.20e-3, 0.19), 200.0, 200e3),
        (Zener(8.1, 99.1e3, 6.74e-1), 0.1, 40e3),
        (Zener(8.1, 138.0e3, 9.32e-1), 0.1, 70e3),
    ],
)
def test_magnitudes_stated_in_the_paper(solid, hertz, stated):
    """Curves of the paper's table against its text, which rounds to one or two digits (within 6 %)."""
    np.testing.assert_allclose(modulus_magnitude(solid, 2.0 * np.pi * hertz), stated, rtol=0.06)


CORNERS = list(
    itertools.product([0.0, 8.0], [0.0, 15e3], [0.0, 1e-300, 0.46, 1e300], [0.0, 0.5, 1.0], [0.0, 1e-300, 1.0, 1e300])
)


def test_corners_are_finite_with_finite_gradients():
    def parts(x):
        solid = FractionalZener(x[0], x[0] + x[1], x[2], x[3])
        modulus = complex_modulus(solid, x[4])
        return jnp.stack([modulus.real, modulus.imag, modulus_magnitude(solid, x[4])])

    def conventional(x):
        solid = Zener(x[0], x[0] + x[1], x[2])
        return jnp.stack([storage_modulus(solid, x[4]), loss_modulus(solid, x[4]), modulus_magnitude(solid, x[4])])

    points = jnp.asarray(CORNERS)
    fractional = [jax.vmap(f)(points) for f in (parts, jax.jacfwd(parts), jax.jacrev(parts))]
    for values in fractional:
        bad = np.flatnonzero(~np.all(np.isfinite(np.asarray(values)).reshape(len(points), -1), axis=1))
        assert not len(bad), [CORNERS[index] for index in bad[:5]]
    for values in (jax.vmap(conventional)(points), jax.vmap(jax.jacrev(conventional))(points)):
        bad = np.flatnonzero(~np.all(np.isfinite(np.asarray(values)).reshape(len(points), -1), axis=1))
        assert not len(bad), [CORNERS[index] for index in bad[:5]]


@pytest.mark.parametrize("omega", [0.0, 1e-9, 1.0 / 0.46, 30.0, 1e9])
@pytest.mark.parametrize("order", [0.2, 0.999])
def test_gradient_in_the_constants(omega, order):
    def combined(x):
        modulus = complex_modulus(FractionalZener(x["m0"], x["m0"] + x["e"], x["tau"], x["alpha"]), omega)
        return modulus.real / 8.0 + modulus.imag / 7.0 + jnp.abs(modulus) / 9.0

    assert_gradient(combined, {"m0": 5.0, "e": 40.0, "tau": 0.46, "alpha": order})


@pytest.mark.parametrize("omega", [1e-6, 1.0, 3.0, 1e6])
def test_gradient_in_frequency(omega):
    for solid in (FractionalZener(5.0, 40.0, 0.5, 0.3), Zener(5.0, 40.0, 0.5)):
        assert_gradient(lambda w, solid=solid: loss_modulus(solid, w), omega)


@pytest.mark.parametrize("order", [0.1, 0.5, 1.0])
def test_invariants(order):
    omega = np.geomspace(1e-6, 1e6, 400)
    solid = FractionalZener(2.0, 9.0, 0.1, order)
    storage, loss = np.asarray(storage_modulus(solid, omega)), np.asarray(loss_modulus(solid, omega))
    assert np.all(np.diff(storage) >= 0.0)
    assert np.all(loss >= 0.0)
    np.testing.assert_allclose(modulus_magnitude(solid, omega), np.hypot(storage, loss), rtol=1e-14)
    assert float(storage_modulus(solid, 0.0)) == 2.0
    assert float(loss_modulus(solid, 0.0)) == 0.0
    far = 1e300 if order < 0.5 else 1e60
    np.testing.assert_allclose(float(storage_modulus(solid, far)), 9.0, rtol=1e-12)


def test_loss_peaks_at_the_relaxation_frequency():
    solid = FractionalZener(2.0, 9.0, 0.1, 0.6)
    slope = jax.grad(lambda logarithm: loss_modulus(solid, jnp.exp(logarithm)))
    assert abs(float(slope(jnp.log(10.0)))) < 1e-12


def test_single_precision_and_batches():
    omega = np.geomspace(1e-3, 1e3, 7)
    orders = jnp.linspace(0.0, 1.0, 5)
    batched = jax.vmap(lambda order: complex_modulus(FractionalZener(2.0, 9.0, 0.1, order), omega))(orders)
    for order, row in zip(orders, batched, strict=True):
        np.testing.assert_allclose(
            row, complex_modulus(FractionalZener(2.0, 9.0, 0.1, float(order)), omega), rtol=1e-14
        )


def test_kelvin_voigt_and_spring_pots():
    omega = np.array([0.0, 3.0, 200.0])
    np.testing.assert_allclose(complex_modulus(KelvinVoigt(5.0, 0.1), omega), 5.0 + 0.1j * omega)
    np.testing.assert_allclose(complex_modulus(FractionalKelvinVoigt(5.0, 0.1, 1.0), omega), 5.0 + 0.1j * omega)
    np.testing.assert_allclose(
        complex_modulus(FractionalKelvinVoigt(5.0, 2.0, 0.3), omega), 5.0 + 2.0 * (1j * omega) ** 0.3, rtol=1e-14
    )
    np.testing.assert_allclose(complex_modulus(Elastic(5.0), omega), np.full(3, 5.0))


def test_gradient_in_the_constants_of_the_other_solids():
    def combined(x):
        solids = [Elastic(x["elastic"]), KelvinVoigt(*x["viscous"]), FractionalKelvinVoigt(*x["spring-pot"])]
        moduli = [complex_modulus(each, 7.0) for each in [*solids, Prony(*x["prony"])]]
        return sum(modulus.real / 3.0 + modulus.imag / 2.0 for modulus in moduli)

    branches = (2.0, jnp.array([1.0, 5.0]), jnp.array([0.1, 0.4]))
    assert_gradient(combined, {"elastic": 3.0, "viscous": (2.0, 0.3), "spring-pot": (2.0, 0.3, 0.6), "prony": branches})
    still = jax.grad(lambda order: complex_modulus(FractionalKelvinVoigt(1.0, 2.0, order), 0.0).real)(0.5)
    assert float(still) == 0.0


def test_complex_shear_modulus_of_fields():
    relaxed = jnp.array([[1e3, 2e3, 3e3], [4e3, 5e3, 6e3]])
    solids = [
        FractionalZener(relaxed, 3.0 * relaxed, 1e-6 * relaxed, 0.4),
        KelvinVoigt(relaxed, 1.0),
        Prony(relaxed, jnp.stack([relaxed, 2.0 * relaxed]), jnp.stack([1e-6 * relaxed, 1e-7 * relaxed])),
        Prony(2e3, jnp.array([1e3]), jnp.array([1e-3])),
        Elastic(2e3),
    ]
    for solid in solids:
        field = complex_shear_field(solid, (2, 3), 300.0, reading=YoungModulus(), poisson_ratio=0.4)
        one = jax.tree.map(lambda leaf: leaf[..., 0, 1] if jnp.ndim(leaf) > 1 else leaf, solid)
        np.testing.assert_allclose(field[0, 1], complex_modulus(one, 300.0) / 2.8, rtol=1e-13)
