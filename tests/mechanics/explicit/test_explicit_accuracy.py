"""The explicit path against exact solutions and the implicit solver; its orders and its estimate of its error."""

import dataclasses
import functools

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.elements.mesh import Mesh, Wall, Walls
from arfjax.mechanics.explicit.grid import (
    coarsened,
    node_positions,
)
from arfjax.mechanics.explicit.result import extrapolated
from arfjax.mechanics.explicit.settings import ExplicitSettings, explicit_settings
from arfjax.mechanics.explicit.solver import capped_bulk_modulus, solve_push_explicitly
from arfjax.mechanics.material.viscoelastic import (
    ShearModulus,
    ViscoelasticField,
    prony_of_kelvin_voigt,
    viscoelastic_field,
)
from arfjax.mechanics.transient.push import PushSettings, solve_push
from arfjax.media import KelvinVoigt
from tests.checks import assert_order
from tests.mechanics.explicit.cases import (
    FREE,
    SMALL,
    beam_force,
    beam_grid,
    coarse_run,
    error_at_end,
    quick_jit,
    reference_material,
    reference_run,
    run,
    small_force,
    small_grid,
    uneven_material,
)


@pytest.mark.parametrize(
    "kind", ["zener", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("elastic", "fzener"))]
)
def test_infinite_medium_and_the_estimate_of_the_error(kind):
    """40 x 44 cells; the run of the estimate has 20 x 22."""
    result = coarse_run(kind)
    fine, estimated = error_at_end(kind, result.displacement_at_points), float(result.convergence.error)
    error = result.convergence.at_points
    coarse = error_at_end(kind, result.displacement_at_points[::2] + 3.0 * error)
    left = error_at_end(kind, result.displacement_at_points[::2] - error)
    assert estimated < 0.02
    assert 0.8 * fine < estimated < 1.25 * fine
    assert left < 0.2 * estimated
    assert_order([2.0, 1.0], [coarse, fine], order=2.0)
    assert result.convergence.shortcoming(0.02) == ""
    assert "halve" in result.convergence.shortcoming(0.002)


@pytest.mark.slow
def test_second_order_in_space_and_time():
    """Cells, their growth and the steps halved together, to 80 x 88 cells."""
    grids = [coarsened(coarsened(beam_grid())), coarsened(beam_grid()), beam_grid()]
    results = [reference_run("zener", grid) for grid in grids]
    errors = [error_at_end("zener", result.displacement_at_points) for result in results]
    assert_order([4.0, 2.0, 1.0], errors, order=2.0)
    assert errors[-1] < 5e-3
    assert error_at_end("zener", extrapolated(results[-1]).displacement_at_points) < 3e-4


def test_maps_are_extrapolated_as_the_axis_is():
    """Map and history hold the same numbers where both are on the axis at the end, and so do their errors."""
    settings = dataclasses.replace(SMALL, steps_per_checkpoint=2)
    result = quick_jit(functools.partial(solve_push_explicitly, small_grid(), settings=settings))(
        uneven_material(small_grid()), small_force(small_grid())
    )
    better = extrapolated(result)
    for maps, on_axis in (
        (result.convergence.maps, result.convergence.on_axis),
        (better.maps, better.axial_displacement_on_axis),
    ):
        np.testing.assert_allclose(maps[:, 0, :, 1], on_axis[6::6], rtol=1e-12, atol=1e-20)
    assert float(jnp.max(jnp.abs(result.convergence.maps))) > 1e-3 * float(jnp.max(jnp.abs(result.maps)))


def standing_wave(n_z: int) -> float:
    """Largest error of a standing pressure wave in a column between fixed ends and a sliding wall, of its peak."""
    grid = AxisymmetricGrid(np.array([0.0, 0.3e-3, 1e-3, 1.4e-3]), np.linspace(0.0, 8e-3, n_z + 1))
    one = jnp.ones(grid.shape)
    material = ViscoelasticField(
        1000.0 * one, 1e5 * one, 3e3 * one, jnp.zeros((0, *grid.shape)), jnp.zeros((0, *grid.shape))
    )
    settings = ExplicitSettings(4e-4 / (8 * n_z), 8 * n_z, 1.0)
    number, speed = np.pi / 8e-3, np.sqrt((1e5 + 4e3) / 1e3)
    force = 1e4 * np.sin(number * grid.z_faces)[None, :] + 0.0 * grid.r_faces[:, None]
    result = quick_jit(
        lambda m: solve_push_explicitly(
            grid, m, force, settings=settings, walls=Walls(outer=Wall.SLIDING), estimate_error=False
        )
    )(material)
    end = np.asarray(result.maps)[-1]
    exact = force / (1e3 * (number * speed) ** 2) * (1.0 - np.cos(number * speed * 4e-4))
    assert np.max(np.abs(end[..., 0])) < 1e-12 * np.max(exact)
    assert np.max(np.ptp(end[..., 1], axis=0)) < 1e-12 * np.max(exact)
    return float(np.max(np.abs(end[..., 1] - exact)) / np.max(exact))


def test_a_standing_wave_in_a_column():
    errors = [standing_wave(n) for n in (8, 16)]
    assert errors[1] < 5e-3
    assert_order([2.0, 1.0], errors, order=2.0)


def test_a_course_in_time_is_linear_between_its_values():
    grid, material = small_grid(), uneven_material(small_grid())
    rigid = dataclasses.replace(material, density=jnp.full(grid.shape, 1e3))
    amplitude = np.interp(SMALL.times, [0.0, 1e-4, 3e-4, 4.8e-4], [0.0, 2.0, -1.0, 0.5])
    push = quick_jit(
        lambda m, c: solve_push_explicitly(
            grid, m, np.full((7, 9), 2e4), settings=SMALL, amplitude=c, walls=FREE, estimate_error=False
        )
    )
    result = push(rigid, amplitude)
    fine = np.linspace(0.0, 4.8e-4, 24 * 400 + 1)
    speed = np.concatenate(
        [
            [0.0],
            np.cumsum(0.5 * np.diff(fine) * 20.0 * (lambda f: f[1:] + f[:-1])(np.interp(fine, SMALL.times, amplitude))),
        ]
    )
    exact = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(fine) * (speed[1:] + speed[:-1]))])[::400]
    assert np.max(np.abs(np.asarray(result.axial_displacement_on_axis)[:, 3] - exact)) < 2e-6 * np.max(exact)
    np.testing.assert_allclose(result.velocity[..., 1], speed[-1], rtol=1e-6)


def test_second_order_in_time_with_branches_and_a_layer():
    material = uneven_material(small_grid(), bulk_modulus=2e4)
    maps = [run(material, settings=ExplicitSettings(4.8e-4 / n, n, 3.1e-4)).maps[-1] for n in (24, 48, 96)]
    changes = [float(jnp.linalg.norm((maps[i] - maps[i + 1]).ravel())) for i in (0, 1)]

    assert changes[1] < 1e-3 * float(jnp.linalg.norm(maps[2].ravel()))
    assert_order([2.0, 1.0], changes, order=2.0)


def kelvin_voigt_lesion(r: np.ndarray, z: np.ndarray, *, viscous: float = 1.0) -> ViscoelasticField:
    """Five times as stiff in an ellipsoid as outside, with an edge of a few cells; all is viscous."""
    inside = 0.5 - 0.5 * jnp.tanh((jnp.hypot(r[:, None] / 1e-3, z[None, :] / 2e-3) - 1.0) / 0.4)
    prony = prony_of_kelvin_voigt(KelvinVoigt(2e3 * (1.0 + 4.0 * inside), 0.5 * (1.0 + inside)), shortest_time=2e-5)
    constants = {"density": 1e3, "bulk_modulus": 2e4, "reading": ShearModulus(), "poisson_ratio": 0.5}
    field = viscoelastic_field(prony, inside.shape, **constants)
    return dataclasses.replace(field, branch_shear_moduli=viscous * field.branch_shear_moduli)


@pytest.mark.slow
def test_a_kelvin_voigt_lesion_agrees_with_the_implicit_solver():
    """At every node to the discretisation error that the run itself estimates; without the viscosity it is far off."""
    z_nodes = np.linspace(-6.4e-3, 6.4e-3, 33)
    grid, mesh = AxisymmetricGrid(np.linspace(0.0, 4e-3, 21), z_nodes), Mesh(np.linspace(0.0, 4e-3, 11), z_nodes[::2])
    solid = kelvin_voigt_lesion(grid.r, grid.z)
    assert float(jnp.min(solid.branch_shear_moduli)) < 0.0

    def shape(r, z):
        return 1e5 * np.exp(-((r / 0.8e-3) ** 2) - (z / 2e-3) ** 2)

    settings = explicit_settings(grid, solid, end=5e-4, push_duration=5e-4)
    push = quick_jit(functools.partial(solve_push_explicitly, grid, settings=settings))
    ours, elastic = (
        push(kelvin_voigt_lesion(grid.r, grid.z, viscous=viscous), shape(*node_positions(grid)))
        for viscous in (1.0, 0.0)
    )
    implicit = solve_push(
        mesh,
        kelvin_voigt_lesion(mesh.gauss_r, mesh.gauss_z),
        shape(mesh.gauss_r[:, None], mesh.gauss_z[None, :]),
        settings=PushSettings(1e-5, 50),
    )
    expected = np.asarray(implicit.displacement)
    difference, without = (
        np.max(np.abs(np.asarray(result.maps)[-1] - expected)) / np.max(expected) for result in (ours, elastic)
    )
    estimated = float(jnp.max(jnp.abs(ours.convergence.maps)) / np.max(expected))
    assert difference < 1.4 * estimated < 0.05
    assert without > 5.0 * difference


@pytest.mark.slow
def test_a_capped_bulk_modulus_changes_a_push_as_little_as_documented():
    grid = coarsened(beam_grid())
    material = reference_material("zener", grid)
    capped = capped_bulk_modulus(material, 1.25e5)
    settings = explicit_settings(grid, capped, end=5e-4, push_duration=5e-4)
    assert settings.n_steps < 0.56 * coarse_run("zener").time.size
    push = quick_jit(functools.partial(solve_push_explicitly, grid, settings=settings, estimate_error=False))
    full, soft = (result.at_focus(0.0)[-1] for result in (coarse_run("zener"), push(capped, beam_force(grid))))
    assert 0.007 < float(soft / full - 1.0) < 0.011
