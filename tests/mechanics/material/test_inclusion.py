"""The lesion in the liver: where it is, and what the material is there."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.elements.refinement import focused_mesh
from arfjax.mechanics.force import total_force
from arfjax.mechanics.material.inclusion import (
    Inclusion,
    material_at,
    material_of,
    mixed,
)
from arfjax.mechanics.material.lesion import (
    Edge,
    Ellipsoid,
    EllipsoidalLesion,
    LinearEdge,
    SharpEdge,
    coagulated_share,
)
from arfjax.mechanics.material.viscoelastic import ShearModulus, YoungModulus
from arfjax.media import Elastic, FractionalKelvinVoigt, FractionalZener, KelvinVoigt, Prony, Zener
from tests.checks import assert_gradient, assert_order

LIVER, LESION = Zener(1100.0, 2000.0, 0.3), Zener(8.0, 52600.0, 0.7)
R, Z = np.asarray([0.1e-3, 0.45e-3, 2e-3]), np.asarray([60e-3, 62.6e-3, 64e-3])
OTHERS = {"density": 1060.0, "poisson_ratio": 0.499}


def ellipsoid_depth(r, z, *, length, diameter, centre):
    lesion = EllipsoidalLesion(Ellipsoid.of_length_and_diameter(length, diameter, centre=centre))
    return lesion(r[:, None], z[None, :])


def liver_with_lesion(liver, lesion, depth, *, reading):
    return material_of(mixed(liver, lesion, depth), depth.shape, reading=reading, **OTHERS)


def test_depth_is_one_at_the_centre_and_zero_from_the_edge_on():
    depth = ellipsoid_depth(np.asarray([0.0, 0.3e-3, 0.6e-3, 1e-3]), Z, length=5e-3, diameter=1.2e-3, centre=62.6e-3)
    np.testing.assert_allclose(depth[:, 1], [1.0, 0.5, 0.0, 0.0], atol=1e-14)
    assert float(depth[0, 0]) == 0.0  # 2.6 mm from the centre, beyond the tip at 2.5 mm
    assert float(depth[0, 2]) == pytest.approx(1.0 - 1.4 / 2.5)


def test_no_lesion_leaves_liver_alone():
    depth = ellipsoid_depth(R, Z, length=0.0, diameter=0.0, centre=62.6e-3)
    material = liver_with_lesion(LIVER, LESION, depth, reading=ShearModulus())
    np.testing.assert_allclose(material.relaxed_shear_modulus, 1100.0)
    np.testing.assert_allclose(material.branch_shear_moduli, 900.0)
    np.testing.assert_allclose(material.relaxation_times, 0.3)


def test_readings_of_the_modulus():
    depth = jnp.ones((3, 3))
    as_shear = liver_with_lesion(LIVER, LESION, depth, reading=ShearModulus())
    as_young = liver_with_lesion(LIVER, LESION, depth, reading=YoungModulus())
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
    )
    conventional = liver_with_lesion(LIVER, LESION, depth, reading=YoungModulus())
    np.testing.assert_allclose(fractional.branch_shear_moduli.sum(0), conventional.branch_shear_moduli[0], rtol=1e-12)
    np.testing.assert_allclose(fractional.relaxed_shear_modulus, conventional.relaxed_shear_modulus, rtol=1e-12)


@pytest.mark.parametrize("order", [0.19, 0.4, 0.55, 0.7])
def test_fractional_solid_in_a_push_follows_the_mittag_leffler_function(order):
    """At times from 1e-5 to 0.1 relaxation times, against its spectral integral by a fine trapezoidal rule."""
    solid = FractionalZener(0.0, 1.0, 1.0, order)
    material = liver_with_lesion(solid, solid, jnp.zeros((1, 1)), reading=ShearModulus())
    log_rate = np.linspace(-150.0, 60.0, 210_001)
    density = np.sin(order * np.pi) / (np.cosh(order * log_rate) + np.cos(order * np.pi))
    for time in np.geomspace(1e-5, 0.1, 9):
        exact = np.sum(density * np.exp(-np.exp(log_rate) * time)) / np.sum(density)
        branches = material.branch_shear_moduli[:, 0, 0] * np.exp(-time / material.relaxation_times[:, 0, 0])
        assert float(branches.sum()) == pytest.approx(exact, abs=5e-5)


def test_two_kinds_of_solid_are_refused():
    with pytest.raises(InputError, match="same kind"):
        liver_with_lesion(LIVER, FractionalZener(8.0, 52600.0, 0.7, 0.5), jnp.zeros((1, 1)), reading=YoungModulus())


def test_gradient_in_size_and_place():
    def stiffness(size):
        depth = ellipsoid_depth(R, Z, length=size[0], diameter=size[1], centre=size[2])
        material = liver_with_lesion(LIVER, LESION, depth, reading=YoungModulus())
        return jnp.sum(material.branch_shear_moduli)

    assert_gradient(stiffness, jnp.asarray([5e-3, 1.2e-3, 62.5e-3]))


MESH = focused_mesh(
    focus=0.0, radius=4e-3, front=-5e-3, back=5e-3, finest_r=0.1e-3, finest_z=0.2e-3, fine_radius=2e-3, fine_length=6e-3
)
GRID = AxisymmetricGrid(np.linspace(0.0, 5e-3, 61), np.linspace(-6e-3, 6e-3, 91))


def ellipsoid_share(axial, radial, edge, mesh=MESH):
    lesion = EllipsoidalLesion(Ellipsoid.of_semi_axes(axial, radial, centre=0.2e-3), edge)
    return lesion(jnp.asarray(mesh.gauss_r)[:, None], jnp.asarray(mesh.gauss_z)[None, :])


def test_length_and_diameter_are_twice_the_semi_axes():
    as_table = Ellipsoid.of_length_and_diameter(5e-3, 1.2e-3, centre=1e-3)
    assert as_table == Ellipsoid.of_semi_axes(2.5e-3, 0.6e-3, centre=1e-3)
    assert float(as_table.relative_radius(np.asarray(0.6e-3), np.asarray(1e-3))) == pytest.approx(1.0)
    assert float(as_table.relative_radius(np.asarray(0.0), np.asarray(3.5e-3))) == pytest.approx(1.0)


def test_distance_from_a_sphere_is_exact_and_from_an_ellipsoid_of_first_order():
    r, z = np.array([0.3e-3, 1.1e-3, 2.0e-3]), np.array([0.9e-3, -0.2e-3, 1.0e-3])
    sphere = Ellipsoid.of_semi_axes(1e-3, 1e-3, centre=0.0)
    np.testing.assert_allclose(sphere.distance(r, z), np.hypot(r, z) - 1e-3, atol=1e-15)
    angle, away = np.linspace(0.2, 1.3, 5), 1e-6
    normal = np.stack([np.cos(angle) / 0.6, np.sin(angle) / 2.5])
    outside = np.stack([0.6e-3 * np.cos(angle), 2.5e-3 * np.sin(angle)]) + away * normal / np.linalg.norm(
        normal, axis=0
    )
    lesion = Ellipsoid.of_semi_axes(2.5e-3, 0.6e-3, centre=0.0)
    np.testing.assert_allclose(lesion.distance(*outside), away, rtol=1e-2)


@pytest.mark.parametrize(("axial", "radial"), [(2.5e-3, 0.6e-3), (0.6e-3, 2.5e-3)])
def test_the_centre_is_as_deep_as_the_shorter_axis_and_all_lesion_under_the_widest_step(axial, radial):
    lesion = Ellipsoid.of_semi_axes(axial, radial, centre=0.0)
    away = 1e-9 * np.array([[0.0, 0.0], [radial < axial, axial < radial]])  # the centre, and a step along that axis
    np.testing.assert_allclose(lesion.distance(*away.T), [-0.6e-3, -0.6e-3 + 1e-9], rtol=1e-12)
    for width in (0.3e-3, 1.2e-3, 1.0):  # the last is narrowed to both sides of the centre
        np.testing.assert_allclose(SharpEdge(width).share(lesion, *away.T), 1.0, rtol=1e-10)


def exact_volume(axial: float, radial: float, edge: Edge) -> tuple[float, np.ndarray]:
    r"""Volume under the share, and its derivatives in the logarithms of both semi-axes.

    A cone of height 1 has a quarter of the ellipsoid's volume. The smooth step is a mean over ellipsoids whose distance
    d from the surface spreads with the variance $w^2 / 20$; d is proportional to the relative radius less 1 along each
    ray, so that their mean volume is $4 \pi / 3 (a^2 b + w^2 / 20 (2 b + a^2 / b))$, with radial a and axial b.
    """
    bulk = 4.0 / 3.0 * np.pi * radial**2 * axial
    if isinstance(edge, LinearEdge):
        return 0.25 * bulk, 0.25 * bulk * np.array([1.0, 2.0])
    variance = float(edge.width) ** 2 / 20.0
    sides, tips = 4.0 / 3.0 * np.pi * variance * np.array([2.0 * axial, radial**2 / axial])
    return bulk + sides + tips, np.array([bulk + sides - tips, 2.0 * bulk + 2.0 * tips])


@pytest.mark.parametrize(
    ("edge", "of_volume", "of_slopes"),
    [(LinearEdge(), 1e-4, 1e-2), (SharpEdge(0.8e-3), 1e-5, 2e-4), (SharpEdge(0.4e-3), 2e-5, 2e-4)],
)
def test_volume_and_shape_derivatives(edge, of_volume, of_slopes):
    """On elements of 0.1 x 0.2 mm, whose Gauss quadrature is all that is left.

    The cone's slope in size jumps at the surface: a third of each of some fifty cut elements falls on the wrong side
    with random sign, 5e-3 of the whole here and 5e-4 with half the size. A step over four elements or more is smooth.
    """
    axes = jnp.array([2.5e-3, 1e-3])
    volume, slopes = exact_volume(2.5e-3, 1e-3, edge)
    ours, gradient = jax.value_and_grad(lambda axes: total_force(MESH, ellipsoid_share(axes[0], axes[1], edge)))(axes)
    np.testing.assert_allclose(ours, volume, rtol=of_volume)
    np.testing.assert_allclose(gradient * axes, slopes, rtol=of_slopes)


@pytest.mark.parametrize("edge", [LinearEdge(), SharpEdge(0.3e-3)])
def test_gradient_of_a_weighted_share(edge):
    weight = jnp.asarray(np.exp(-((MESH.gauss_r[:, None] / 1e-3) ** 2) - (MESH.gauss_z[None, :] / 3e-3) ** 2))

    def weighted(axes):
        return 1e9 * total_force(MESH, weight * ellipsoid_share(axes[0], axes[1], edge))

    # Central differences over a relative step of 1e-6: kinks of the share that pass a Gauss point in it make 1e-4.
    assert_gradient(weighted, jnp.array([2.5e-3, 1e-3]), step=1e-6, rtol=1e-4)


def test_no_lesion_has_no_share_and_finite_derivatives():
    for edge in (LinearEdge(), SharpEdge(0.01e-3), SharpEdge(0.5e-3)):
        share = ellipsoid_share(0.0, 0.0, edge)
        assert float(jnp.max(share)) < 1e-6
        slope = jax.grad(lambda size, edge=edge: jnp.sum(ellipsoid_share(size, size, edge)))(0.0)
        assert np.isfinite(slope)


def test_the_centre_of_a_lesion_is_all_lesion_and_has_a_slope():
    for edge in (LinearEdge(), SharpEdge(0.3e-3)):

        def share(centre, edge=edge):
            return EllipsoidalLesion(Ellipsoid.of_semi_axes(2e-3, 1e-3, centre=centre), edge)(
                np.zeros(()), np.array(1e-2)
            )

        assert float(share(1e-2)) == 1.0
        assert float(jax.grad(share)(1e-2)) == 0.0


def test_branches_of_both_solids_are_as_many():
    two, one = Prony(1e3, np.array([1.0, 2.0]), np.array([0.1, 0.2])), Prony(1e3, np.array([1.0]), np.array([0.1]))
    with pytest.raises(InputError, match="1 branches and the lesion 2"):
        mixed(one, two, np.zeros((3, 4)))
    field = Prony(1e3, np.full((1, 3, 4), 5.0), np.full((1, 3, 4), 0.1))
    halfway = mixed(one, field, np.full((3, 4), 0.5))
    np.testing.assert_allclose(halfway.branch_moduli, np.full((1, 3, 4), 3.0))


def dose(grid: AxisymmetricGrid) -> np.ndarray:
    """Its logarithm over the threshold is 6 at the centre of an ellipsoid, 0 on the surface and quadratic in place."""
    return 240.0 * np.exp(6.0 * (1.0 - (grid.r[:, None] / 1e-3) ** 2 - (grid.z[None, :] / 2.5e-3) ** 2))


def test_share_from_a_dose():
    """Second order in the cells: a linear interpolant of the logarithm L lies $h^2 |L''| / 12$ below it in the mean.

    Where L is lower by d the ellipsoid has the volume $(1 - d / 6)^{3/2}$, so that the error is known beforehand.
    """
    width, errors, expected = 0.5, [], []
    volume = 4.0 / 3.0 * np.pi * 2.5e-3 * 1e-3**2
    sharp, _ = quad(lambda x: 3.0 * x**2 / (1.0 + np.exp(-6.0 * (1.0 - x**2) / width)), 0.0, 3.0)
    for n in (30, 60):
        grid = AxisymmetricGrid(np.linspace(0.0, 5e-3, n + 1), np.linspace(-6e-3, 6e-3, 3 * n // 2 + 1))
        share = coagulated_share(MESH, grid, dose(grid), width=width)
        errors.append(float(total_force(MESH, share)) / volume / sharp - 1.0)
        h_r, h_z = 5.0 / n, 8.0 / n
        expected.append(-1.5 / 6.0 * (h_r**2 * 12.0 / 12.0 + h_z**2 * 12.0 / 2.5**2 / 12.0))
    np.testing.assert_allclose(errors, expected, rtol=0.05)  # the quadrature of the mesh: 1e-4 of the volume
    assert_order([2.0, 1.0], np.abs(errors), order=2.0)


def test_share_from_a_dose_at_a_point():
    exact = 1.0 / (1.0 + np.exp(-6.0 * (1.0 - 1.3**2)))
    mesh = Mesh(np.array([0.0, 2.6e-3]), np.array([-1e-3, 1e-3]))  # a Gauss point at r = 1.3 mm, z = 0
    # A linear interpolant of L is at most h^2 |L''| / 8 below it: 0.0147 in both directions together.
    np.testing.assert_allclose(coagulated_share(mesh, GRID, dose(GRID), width=1.0)[1, 1], exact, rtol=0.015)
    assert float(jnp.max(coagulated_share(MESH, GRID, 0.0 * dose(GRID), width=0.5))) < 1e-20
    assert_gradient(
        lambda x: jnp.mean(coagulated_share(MESH, GRID, x["dose"] * dose(GRID), threshold=x["at"], width=x["width"])),
        {"dose": 1.0, "at": 240.0, "width": 0.4},
    )


def test_closures_on_the_mesh_equal_fields():
    lesion = EllipsoidalLesion(Ellipsoid.of_length_and_diameter(5e-3, 2e-3, centre=0.2e-3))
    by_closure = material_at(MESH, Inclusion(LIVER, LESION, lesion), reading=YoungModulus(), **OTHERS)
    depth = ellipsoid_depth(MESH.gauss_r, MESH.gauss_z, length=5e-3, diameter=2e-3, centre=0.2e-3)
    by_field = liver_with_lesion(LIVER, LESION, depth, reading=YoungModulus())
    for ours, theirs in zip(jax.tree.leaves(by_closure), jax.tree.leaves(by_field), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-14)


@pytest.mark.parametrize(
    ("outside", "inside"),
    [
        (Elastic(3e3), Elastic(9e3)),
        (KelvinVoigt(3e3, 1.0), KelvinVoigt(9e3, 2.0)),
        (FractionalKelvinVoigt(3e3, 20.0, 0.4), FractionalKelvinVoigt(9e3, 5.0, 0.6)),
        (
            Prony(3e3, np.array([1e3, 2e3]), np.array([1e-3, 1e-2])),
            Prony(9e3, np.array([3e3, 4e3]), np.array([3e-3, 1e-2])),
        ),
    ],
)
def test_every_solid_makes_a_field(outside, inside):
    share = jnp.array([[0.0, 0.5, 1.0]])
    field = liver_with_lesion(outside, inside, share, reading=ShearModulus())
    np.testing.assert_allclose(field.relaxed_shear_modulus, [[3e3, 6e3, 9e3]])
    for column, solid in ((0, outside), (2, inside)):
        alone = material_of(solid, (1, 1), reading=ShearModulus(), **OTHERS)
        np.testing.assert_allclose(field.branch_shear_moduli[:, 0, column], alone.branch_shear_moduli[:, 0, 0])
        np.testing.assert_allclose(field.relaxation_times[:, 0, column], alone.relaxation_times[:, 0, 0])
        np.testing.assert_allclose(field.bulk_modulus[0, column], alone.bulk_modulus[0, 0])
    if isinstance(outside, Prony):
        np.testing.assert_allclose(field.branch_shear_moduli[:, 0, 1], [2e3, 3e3])


def test_resistance_to_volume_is_that_of_the_spring_which_answers_first():
    """At once all branches are springs; dashpots, which would be rigid then, take no part."""
    solids = (
        Elastic(3e3),
        KelvinVoigt(3e3, 1.0),
        FractionalKelvinVoigt(3e3, 20.0, 0.4),
        Zener(1e3, 3e3, 0.3),
        FractionalZener(1e3, 3e3, 0.3, 0.4),
        Prony(1e3, np.array([1.5e3, 0.5e3]), np.array([1e-3, 1e-2])),
    )
    exact = 3e3 * 2.0 * 1.499 / (3.0 * (1.0 - 2.0 * 0.499))  # from shear modulus and Poisson's ratio
    for solid in solids:
        field = material_of(solid, (1, 1), reading=ShearModulus(), **OTHERS)
        np.testing.assert_allclose(field.bulk_modulus, exact, rtol=1e-12, err_msg=type(solid).__name__)


def test_nonsense_is_refused():
    with pytest.raises(InputError, match="Millimetres"):
        Ellipsoid.of_length_and_diameter(5.0, 1.2, centre=0.0)
    for width in (0.0, jnp.zeros(())):
        with pytest.raises(InputError, match="width"):
            SharpEdge(width)
    with pytest.raises(InputError, match="needs a modulus above 0"):
        material_of(FractionalKelvinVoigt(0.0, 5.0, 0.5), (1, 1), reading=ShearModulus(), **OTHERS)
    with pytest.raises(InputError, match="do not fit the grid"):
        coagulated_share(MESH, GRID, np.zeros((3, 3)), width=0.5)
