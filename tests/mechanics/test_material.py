"""The lesion in the liver: where it is, and what the material is there."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.mechanics.material import ellipsoid_depth, liver_with_lesion
from arfjax.mechanics.viscoelastic import ShearModulus, YoungModulus
from arfjax.media import FractionalZener, Zener
from tests.checks import assert_gradient

LIVER, LESION = Zener(1100.0, 2000.0, 0.3), Zener(8.0, 52600.0, 0.7)
R, Z = np.asarray([0.1e-3, 0.45e-3, 2e-3]), np.asarray([60e-3, 62.6e-3, 64e-3])
OTHERS = {"density": 1060.0, "poisson_ratio": 0.499}


def test_depth_is_one_at_the_centre_and_zero_from_the_edge_on():
    depth = ellipsoid_depth(np.asarray([0.0, 0.3e-3, 0.6e-3, 1e-3]), Z, length=5e-3, diameter=1.2e-3, centre=62.6e-3)
    np.testing.assert_allclose(depth[:, 1], [1.0, 0.5, 0.0, 0.0], atol=1e-14)
    assert float(depth[0, 0]) == 0.0  # 2.6 mm from the centre, beyond the tip at 2.5 mm
    assert float(depth[0, 2]) == pytest.approx(1.0 - 1.4 / 2.5)


def test_no_lesion_leaves_liver_alone():
    depth = ellipsoid_depth(R, Z, length=0.0, diameter=0.0, centre=62.6e-3)
    material = liver_with_lesion(LIVER, LESION, depth, reading=ShearModulus(), **OTHERS)
    np.testing.assert_allclose(material.relaxed_shear_modulus, 1100.0)
    np.testing.assert_allclose(material.branch_shear_moduli, 900.0)
    np.testing.assert_allclose(material.relaxation_times, 0.3)


def test_readings_of_the_modulus():
    depth = jnp.ones((3, 3))
    as_shear = liver_with_lesion(LIVER, LESION, depth, reading=ShearModulus(), **OTHERS)
    as_young = liver_with_lesion(LIVER, LESION, depth, reading=YoungModulus(), **OTHERS)
    np.testing.assert_allclose(as_shear.relaxed_shear_modulus, 8.0)
    np.testing.assert_allclose(as_young.branch_shear_moduli, 52592.0 / 2.998)
    np.testing.assert_allclose(as_young.bulk_modulus, 52600.0 / (3.0 * 0.002))


def test_fractional_order_one_is_the_conventional_solid():
    depth = ellipsoid_depth(R, Z, length=5e-3, diameter=1.2e-3, centre=62.6e-3)
    fractional = liver_with_lesion(
        FractionalZener(1100.0, 2000.0, 0.3, 1.0),
        FractionalZener(8.0, 52600.0, 0.7, 1.0),
        depth,
        reading=YoungModulus(),
        **OTHERS,
    )
    conventional = liver_with_lesion(LIVER, LESION, depth, reading=YoungModulus(), **OTHERS)
    np.testing.assert_allclose(fractional.branch_shear_moduli.sum(0), conventional.branch_shear_moduli[0], rtol=1e-12)
    np.testing.assert_allclose(fractional.relaxed_shear_modulus, conventional.relaxed_shear_modulus, rtol=1e-12)


@pytest.mark.parametrize("order", [0.19, 0.4, 0.55, 0.7])
def test_fractional_solid_in_a_push_follows_the_mittag_leffler_function(order):
    """At times from 1e-5 to 0.1 relaxation times, against its spectral integral by a fine trapezoidal rule."""
    solid = FractionalZener(0.0, 1.0, 1.0, order)
    material = liver_with_lesion(solid, solid, jnp.zeros((1, 1)), reading=ShearModulus(), **OTHERS)
    log_rate = np.linspace(-150.0, 60.0, 210_001)
    density = np.sin(order * np.pi) / (np.cosh(order * log_rate) + np.cos(order * np.pi))
    for time in np.geomspace(1e-5, 0.1, 9):
        exact = np.sum(density * np.exp(-np.exp(log_rate) * time)) / np.sum(density)
        branches = material.branch_shear_moduli[:, 0, 0] * np.exp(-time / material.relaxation_times[:, 0, 0])
        assert float(branches.sum()) == pytest.approx(exact, abs=5e-5)


def test_two_kinds_of_solid_are_refused():
    with pytest.raises(InputError, match="same kind"):
        liver_with_lesion(
            LIVER, FractionalZener(8.0, 52600.0, 0.7, 0.5), jnp.zeros((1, 1)), reading=YoungModulus(), **OTHERS
        )


def test_gradient_in_size_and_place():
    def stiffness(size):
        depth = ellipsoid_depth(R, Z, length=size[0], diameter=size[1], centre=size[2])
        material = liver_with_lesion(LIVER, LESION, depth, reading=YoungModulus(), **OTHERS)
        return jnp.sum(material.branch_shear_moduli)

    assert_gradient(stiffness, jnp.asarray([5e-3, 1.2e-3, 62.5e-3]))
