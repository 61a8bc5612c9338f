"""What the lesion's edge, the walls and the outer layer make of the material, the force and the push."""

import dataclasses
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import (
    DoseSize,
    Heating,
    InputError,
    Lesion,
    LesionSize,
    LinearEdge,
    OuterLayer,
    SharpEdge,
    Wall,
    discretise,
    tabulated_size,
)
from arfjax.mechanics.elements.mesh import Walls
from arfjax.mechanics.force import total_force
from arfjax.mechanics.material.lesion import Ellipsoid, EllipsoidalLesion
from arfjax.model import DamageEdge
from arfjax.protocols.heated_tissue import heated_solid
from arfjax.protocols.shear_wave import WatchSettings, watch_mesh
from arfjax.protocols.stepwise import force_at, lesion_share, push
from tests.protocols.test_vibration import MODEL, PROTOCOL, SETTINGS

MESH, FOCUS = SETTINGS.mesh, SETTINGS.focus
SIZE = LesionSize(jnp.asarray(8e-3), jnp.asarray(3e-3), jnp.asarray(0.0), jnp.asarray(FOCUS))


def heating_with(dose):
    """A sonication that goes from no dose to `dose` while the focus goes from 35 to 70 degC."""
    zero = jnp.zeros_like(dose)
    temperature = jnp.asarray([35.0, 70.0])
    return Heating(
        jnp.asarray([0.0, 60.0]), temperature, jnp.stack([zero, zero]), jnp.stack([zero, dose]), 1.0 * zero[0, 0]
    )


def dose_like(size, settings=SETTINGS):
    """A dose that is lethal within the ellipsoid, and falls by a factor of e^8 per relative radius."""
    grid = settings.heat_grid
    relative = jnp.hypot(grid.r[:, None] / (size.diameter / 2), (grid.z[None, :] - FOCUS) / (size.length / 2))
    return 240.0 * jnp.exp(8.0 * (1.0 - relative))


def share_with(edge, size=SIZE, dose=None, settings=SETTINGS):
    model = dataclasses.replace(MODEL, lesion=dataclasses.replace(MODEL.lesion, edge=edge))
    heating = heating_with(dose_like(size, settings) if dose is None else dose)
    return np.asarray(lesion_share(model, heating, 70.0, size, settings, settings.mesh))


def test_linear_edge_is_the_papers_depth():
    lesion = EllipsoidalLesion(Ellipsoid.of_length_and_diameter(8e-3, 3e-3, centre=FOCUS))
    np.testing.assert_array_equal(share_with(LinearEdge()), lesion(MESH.gauss_r[:, None], MESH.gauss_z[None, :]))


@pytest.mark.parametrize(
    ("edge", "part"),
    [
        (LinearEdge(), 0.25),
        # 1 + 3 <(x - 1)^2>, a step being the sum of sharp ones: a twentieth of the width squared, times the inverse of
        # the squared radius, (2 / a^2 + 1 / c^2) / 3 in the mean over directions.
        (SharpEdge(0.5e-3), 1.0 + 0.15 * 0.5**2 * (2.0 / 1.5**2 + 1.0 / 4.0**2) / 3.0),
        # Fermi's integral, of 1 / (1 + exp(8 (x - 1) / width)).
        (DamageEdge(0.25), 1.0 + np.pi**2 * (0.25 / 8.0) ** 2),
    ],
    ids=["linear", "sharp", "dose"],
)
def test_every_edge_holds_its_part_of_the_ellipsoids_volume(edge, part):
    """On a ray from the centre an edge goes with the relative radius x alone: its part is its integral over d(x^3).

    Straight lines between centres of cells, which are h apart, take (h_z / c)^2 / 6 and (h_r / a)^2 / 12 from the
    dose's: 4e-3 and 1.5e-3 at most here. Of the others Gauss's rule errs at kinks, to either side.
    """
    fine = discretise(MODEL, refinement=1.6)
    share = share_with(edge, settings=fine)
    assert np.all((share >= 0.0) & (share <= 1.0)) and (share.max() > 0.99 or part < 1.0)
    np.testing.assert_allclose(total_force(fine.mesh, share), part * np.pi / 6.0 * 8e-3 * 3e-3**2, rtol=6e-3)


def test_no_lesion_has_no_share():
    """A step half a millimetre wide about a surface without size would else be a lesion of its own."""
    none = LesionSize(*(jnp.asarray(0.0),) * 3, jnp.asarray(FOCUS))
    for edge in (LinearEdge(), SharpEdge(0.5e-3), DamageEdge()):
        np.testing.assert_allclose(share_with(edge, none, jnp.zeros(SETTINGS.heat_grid.shape)), 0.0, atol=1e-12)
    tiny = LesionSize(*(jnp.asarray(0.2e-3),) * 2, jnp.asarray(0.0), jnp.asarray(FOCUS))
    assert total_force(MESH, share_with(SharpEdge(0.5e-3), tiny)) < 3.0 * np.pi / 6.0 * 0.2e-3**3


def test_an_edge_by_dose_needs_a_dose():
    with pytest.raises(InputError, match="tabulated size"):
        Lesion(MODEL.lesion.viscoelasticity, tabulated_size(), DamageEdge())
    assert isinstance(Lesion(MODEL.lesion.viscoelasticity, DoseSize()).edge, LinearEdge)
    for wrong in (lambda: DamageEdge(-0.25), lambda: DoseSize(-240.0)):
        with pytest.raises(InputError, match="of coagulation must be positive"):
            wrong()


@pytest.mark.parametrize("by_point", [False, True])
def test_cold_liver_without_a_lesion_does_not_ask_the_lesion_s_laws(by_point):
    """Whose relaxation time is below zero at 15 degC; as traced, where nothing is looked at."""
    share = jnp.zeros((2, 3))
    hot = jnp.full((2, 3), 15.0) if by_point else 15.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solid = heated_solid(MODEL, 15.0, share, hot)
    traced = jax.jit(lambda share, hot: heated_solid(MODEL, 15.0, share, hot))(share, jnp.asarray(hot))
    for got, expected in zip(jax.tree.leaves(solid), jax.tree.leaves(traced), strict=True):
        np.testing.assert_allclose(np.broadcast_to(got, share.shape), expected, rtol=1e-15)
    with pytest.raises(InputError, match="relaxation_time"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        heated_solid(MODEL, 15.0, share + 0.5, hot)


def test_semi_axes_are_twice_as_large():
    plain, doubled = tabulated_size(), tabulated_size(semi_axes=True)
    np.testing.assert_allclose(doubled.length(60.0), 2.0 * plain.length(60.0))
    np.testing.assert_allclose([plain.diameter(60.0), doubled.diameter(60.0)], [0.6e-3, 1.2e-3])


@pytest.fixture(scope="module")
def wide():
    """The model with five millimetres of outer layer and free walls, and its discretisation."""
    model = dataclasses.replace(MODEL, outer_layer=OuterLayer(5e-3), walls=Walls(Wall.FREE, Wall.SLIDING, Wall.FREE))
    return model, discretise(model, refinement=0.4)


def test_the_outer_layer_is_around_the_liver(wide):
    model, settings = wide
    n, mesh = model.outer_layer.n_elements, settings.mesh
    np.testing.assert_array_equal(mesh.r_edges[:-n], MESH.r_edges)
    np.testing.assert_array_equal(mesh.z_edges[n:-n], MESH.z_edges)
    assert settings.liver == SETTINGS.liver == pytest.approx((42.6e-3, 82.6e-3))
    assert mesh.z_edges[0] == pytest.approx(42.6e-3 - 5.0) and mesh.walls == model.walls
    followed = watch_mesh(settings, WatchSettings())
    assert followed.z_edges[0] == pytest.approx(42.6e-3 - 5.0) and followed.walls == model.walls


@pytest.mark.slow
def test_force_ends_with_the_liver_and_the_push_does_not_feel_what_is_beyond(wide):
    """No wave has come back from a wall after 0.5 ms."""

    def run(model, settings):
        force = force_at(model, 40.0, PROTOCOL, settings)
        none = jnp.zeros(force.shape)
        return force, push(model, jnp.asarray(40.0), none, force, PROTOCOL, settings).at_focus(FOCUS)[-1]

    force, moved = eqx.filter_jit(lambda model: run(model, SETTINGS))(MODEL)
    outer, beyond = eqx.filter_jit(lambda model: run(model, wide[1]))(wide[0])
    inside = np.s_[: force.shape[0], 3 * 8 : 3 * 8 + force.shape[1]]
    np.testing.assert_allclose(outer[inside], force, rtol=1e-10)
    np.testing.assert_allclose(total_force(wide[1].mesh, outer), total_force(MESH, force), rtol=1e-10)
    np.testing.assert_allclose(beyond, moved, rtol=1e-4)
    assert beyond != moved
