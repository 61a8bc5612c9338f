"""The explicit path: exact solutions, orders, its estimate of its own error, invariants, derivatives, types."""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.elements.mesh import Mesh, Wall, Walls
from arfjax.mechanics.explicit.energy import EnergyBalance, energy_balance
from arfjax.mechanics.explicit.grid import (
    DampingLayer,
    Layout,
    cell_positions,
    coarsened,
    node_positions,
)
from arfjax.mechanics.explicit.result import ExplicitResult, extrapolated
from arfjax.mechanics.explicit.settings import ExplicitSettings, explicit_settings, longest_stable_step
from arfjax.mechanics.explicit.solver import assemble_push, capped_bulk_modulus, solve_push_explicitly
from arfjax.mechanics.explicit.stencil import at_rest, internal_force, solid_of, strain_of
from arfjax.mechanics.material.viscoelastic import (
    Prony,
    ShearModulus,
    ViscoelasticField,
    prony_of_kelvin_voigt,
    viscoelastic_field,
)
from arfjax.mechanics.transient.push import PushSettings, solve_push
from arfjax.media import KelvinVoigt
from tests.checks import assert_gradient_of_each_leaf, assert_order
from tests.mechanics.problems import Reference

FREE = Walls(Wall.FREE, Wall.FREE, Wall.FREE)
MIXED = Walls(Wall.SLIDING, Wall.FIXED, Wall.FREE)
LAYER = DampingLayer(2e-3, 4e4)


def sizes(finest: float, *, growth: float, end: float) -> np.ndarray:
    """Positions of pairs of cells of one size, so that every other of them is a graded grid too."""
    spacings = [finest]
    while 4.0 * sum(spacings) < end:
        spacings.append(spacings[-1] * growth)
    return np.concatenate([[0.0], np.cumsum(np.repeat(spacings, 4))])


@functools.cache
def beam_grid() -> AxisymmetricGrid:
    """80 x 88 cells, 0.05 x 0.2 mm at the focus; walls beyond what the pressure wave reaches and returns from."""
    r, z = sizes(0.05e-3, growth=1.22, end=12e-3), sizes(0.2e-3, growth=1.22, end=14e-3)
    return AxisymmetricGrid(r, np.concatenate([-z[:0:-1], z]))


def beam_force(grid: AxisymmetricGrid) -> np.ndarray:
    r, z = node_positions(grid)
    return 1e5 * np.exp(-((r / 0.5945e-3) ** 2) - (z / 3.822e-3) ** 2)


def reference_material(kind: str, grid: AxisymmetricGrid) -> ViscoelasticField:
    reference = Reference(kind)
    c, prony = reference.constants, reference.prony()
    if kind == "elastic":
        prony = Prony(jnp.asarray(c["G0"]), jnp.zeros(0), jnp.zeros(0))
    return viscoelastic_field(
        prony, grid.shape, density=c["rho"], bulk_modulus=c["K"], reading=ShearModulus(), poisson_ratio=0.5
    )


def reference_run(kind: str, grid: AxisymmetricGrid, **options) -> ExplicitResult:
    material, points = reference_material(kind, grid), Reference(kind).points
    settings = explicit_settings(grid, material, end=5e-4, push_duration=5e-4, **options)
    run = jax.jit(lambda m, f: solve_push_explicitly(grid, m, f, settings=settings, points=points))
    return run(material, beam_force(grid))


def error_at_end(kind: str, result: ExplicitResult) -> float:
    reference = Reference(kind)
    stored = reference.displacement[4]
    assert reference.times[4] == 5e-4
    difference = np.asarray(result.displacement_at_points)[-1, :, 1] - stored
    return float(np.max(np.abs(difference)) / np.max(np.abs(stored)))


@functools.cache
def coarse_run(kind: str) -> ExplicitResult:
    return reference_run(kind, coarsened(beam_grid()))


@pytest.mark.parametrize("kind", ["elastic", "zener", "fzener"])
def test_infinite_medium_and_the_estimate_of_the_error(kind):
    result = coarse_run(kind)
    error, estimated = error_at_end(kind, result), float(result.convergence.error)
    left = error_at_end(kind, extrapolated(result))
    print(f"{kind}: error {error:.3e}, estimated {estimated:.3e}, extrapolated {left:.3e}")
    assert estimated < 0.02
    assert 0.7 * error < estimated < 1.4 * error
    assert left < 0.3 * estimated
    assert result.convergence.shortcoming(0.02) == ""
    assert "halve" in result.convergence.shortcoming(0.002)


@pytest.mark.slow
def test_second_order_in_space_and_time_and_fourth_when_extrapolated():
    grids = [coarsened(coarsened(beam_grid())), coarsened(beam_grid()), beam_grid()]
    results = [reference_run("elastic", grid, courant_number=0.8) for grid in grids]
    errors = [error_at_end("elastic", result) for result in results]
    print("errors", errors, "extrapolated", [error_at_end("elastic", extrapolated(result)) for result in results])
    assert_order([4.0, 2.0, 1.0], errors, order=2.0)
    assert error_at_end("elastic", extrapolated(results[-1])) < 1.5e-4


@functools.cache
def small_grid() -> AxisymmetricGrid:
    """Uneven, so that no symmetry hides a mistake."""
    r = np.array([0.0, 0.7, 1.5, 2.2, 3.1, 4.2, 5.0])
    z = np.array([-3.0, -2.2, -1.5, -0.9, -0.1, 0.7, 1.2, 2.0, 2.9])
    return AxisymmetricGrid(1e-3 * r, 1e-3 * z)


def uneven_material(grid: AxisymmetricGrid, *, bulk_modulus: float = 5e5, n_branches: int = 2) -> ViscoelasticField:
    r, z = (jnp.asarray(1e3 * x) for x in cell_positions(grid))
    bump = 0.2 * jnp.sin(r + 0.5 * z)
    branches = jnp.arange(1.0, n_branches + 1.0)[:, None, None]
    return ViscoelasticField(
        density=1060.0 * (1.0 + 0.3 * bump),
        bulk_modulus=bulk_modulus * (1.0 - bump),
        relaxed_shear_modulus=2000.0 * (1.0 + bump),
        branch_shear_moduli=1500.0 * branches * (1.0 + 0.5 * bump)[None],
        relaxation_times=2e-4 * branches * (1.0 - bump)[None],
    )


def small_force(grid: AxisymmetricGrid, centre: float = -2e-4, width: float = 1e-3) -> np.ndarray:
    r, z = node_positions(grid)
    return 1e5 * np.exp(-((r / width) ** 2) - ((z - centre) / 1.5e-3) ** 2)


SMALL = ExplicitSettings(2e-5, 24, 3.1e-4, n_maps=2, steps_per_checkpoint=4)


@functools.cache
def compiled(settings: ExplicitSettings, walls: Walls, layer: DampingLayer | None) -> Callable:
    grid = small_grid()
    options = {"settings": settings, "walls": walls, "damping": layer, "estimate_error": False}
    return jax.jit(lambda m, a, r: solve_push_explicitly(grid, m, a, radial_force=r, **options))


def run(
    material: ViscoelasticField,
    axial_force: np.ndarray | jax.Array | None = None,
    radial_force: np.ndarray | jax.Array | None = None,
    *,
    settings: ExplicitSettings = SMALL,
    walls: Walls = MIXED,
    layer: DampingLayer | None = LAYER,
) -> ExplicitResult:
    axial = small_force(small_grid()) if axial_force is None else axial_force
    radial = np.zeros_like(axial) if radial_force is None else radial_force
    return compiled(settings, walls, layer)(material, axial, radial)


def test_uniform_strain_makes_no_force_inside():
    grid = small_grid()
    layout = Layout(grid)
    material = jax.tree.map(lambda leaf: jnp.full_like(leaf, leaf.ravel()[0]), uneven_material(grid))
    solid = solid_of(layout, material, 1e-5, FREE, None)
    r, z = node_positions(grid)
    margin = ((layout.row + 1, layout.row + 1),)
    displacement = tuple(jnp.pad(jnp.asarray(u + 0.0 * (r + z)).ravel(), margin) for u in (2e-3 * r, 1e-4 - 3e-3 * z))
    strain = strain_of(solid, displacement)
    np.testing.assert_allclose(layout.cells(jnp.full(grid.shape, 1e-3)), strain.dilatation * (solid.lame > 0.0))
    forces = [np.asarray(layout.nodes(f)) for f in internal_force(solid, strain, at_rest(solid).memory)]
    for component, force in enumerate(forces):
        largest = np.max(np.abs(force))
        inside = force[1:-1, 1:-1] if component == 0 else force[:-1, 1:-1]
        assert np.max(np.abs(inside)) < 1e-12 * largest
    # The axial force on the top is the stress times the area.
    total = float(np.sum(forces[1][:, -1]))
    lame, twice = (float(np.asarray(a)[layout.row + 1] / grid.volumes[0, 0]) for a in (solid.lame, solid.twice_shear))
    np.testing.assert_allclose(total, np.pi * grid.r_faces[-1] ** 2 * (lame * 1e-3 - twice * 3e-3), rtol=1e-11)


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
    result = jax.jit(
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


def test_a_free_body_moves_as_newton_says_at_every_step():
    grid, material = small_grid(), uneven_material(small_grid())
    solid, _, _ = assemble_push(grid, material, small_force(grid), settings=SMALL)
    volumes = Layout(grid).sum_at_nodes(jnp.asarray(grid.volumes))
    result = run(material, 30.0 * Layout(grid).nodes(solid.mass) / volumes, walls=FREE, layer=None)
    time, push = np.asarray(result.time), SMALL.push_duration
    exact = np.where(time < push, 15.0 * time**2, 15.0 * push**2 + 30.0 * push * (time - push))
    expected = np.broadcast_to(exact[:, None], result.axial_displacement_on_axis.shape)
    np.testing.assert_allclose(result.axial_displacement_on_axis, expected, rtol=1e-9)
    np.testing.assert_allclose(result.velocity[..., 1], 30.0 * push, rtol=1e-9)


def test_a_free_body_takes_up_the_impulse():
    grid, material = small_grid(), uneven_material(small_grid())
    solid, (_, force), _ = assemble_push(grid, material, small_force(grid), settings=SMALL)
    result = run(material, walls=FREE, layer=None)
    momentum = jnp.sum(solid.mass * result.velocity[..., 1].ravel())
    np.testing.assert_allclose(momentum, jnp.sum(force) * SMALL.push_duration, rtol=1e-10)
    np.testing.assert_allclose(jnp.sum(solid.mass), jnp.sum(material.density * grid.volumes), rtol=1e-13)


def test_a_course_in_time_is_linear_between_its_values():
    grid, material = small_grid(), uneven_material(small_grid())
    rigid = dataclasses.replace(material, density=jnp.full(grid.shape, 1e3))
    course = np.interp(SMALL.times, [0.0, 1e-4, 3e-4, 4.8e-4], [0.0, 2.0, -1.0, 0.5])
    push = jax.jit(
        lambda m, c: solve_push_explicitly(
            grid, m, np.full((7, 9), 2e4), settings=SMALL, course=c, walls=FREE, estimate_error=False
        )
    )
    result = push(rigid, course)
    fine = np.linspace(0.0, 4.8e-4, 24 * 400 + 1)
    speed = np.concatenate(
        [
            [0.0],
            np.cumsum(0.5 * np.diff(fine) * 20.0 * (lambda f: f[1:] + f[:-1])(np.interp(fine, SMALL.times, course))),
        ]
    )
    exact = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(fine) * (speed[1:] + speed[:-1]))])[::400]
    assert np.max(np.abs(np.asarray(result.axial_displacement_on_axis)[:, 3] - exact)) < 2e-6 * np.max(exact)
    np.testing.assert_allclose(result.velocity[..., 1], speed[-1], rtol=1e-6)
    held = push(material, np.ones(25)).axial_displacement_on_axis
    constant = dataclasses.replace(SMALL, push_duration=1.0)
    same = run(material, np.full((7, 9), 2e4), settings=constant, walls=FREE, layer=None).axial_displacement_on_axis
    np.testing.assert_allclose(held, same, rtol=1e-12)


@functools.cache
def balance(n_steps: int) -> EnergyBalance:
    settings = ExplicitSettings(4.8e-4 / n_steps, n_steps, 3.1e-4)
    audit = jax.jit(lambda m, f: energy_balance(small_grid(), m, f, settings=settings, walls=MIXED, damping=LAYER))
    material = uneven_material(small_grid())
    elastic = dataclasses.replace(material, branch_shear_moduli=jnp.zeros((2, *small_grid().shape)))
    force = small_force(small_grid())
    return jax.tree.map(lambda *pair: jnp.stack(pair), audit(elastic, force), audit(material, force))


def test_all_work_is_accounted_for_to_rounding():
    energies = balance(24)
    total = energies.kinetic + energies.taken_up + energies.damped
    atol = 1e-12 * float(jnp.max(energies.work))
    np.testing.assert_allclose(total, energies.work, rtol=0.0, atol=atol)
    np.testing.assert_allclose(energies.stored[0], energies.taken_up[0], rtol=0.0, atol=atol)
    for part in (energies.kinetic, energies.stored, energies.damped, energies.dissipated[1:]):
        assert float(jnp.max(part)) > 0.003 * float(jnp.max(energies.work))
    assert float(jnp.min(jnp.diff(energies.dissipated[1]))) > 0.0


def test_what_the_branches_take_is_stored_or_dissipated_to_second_order():
    gaps = []
    for n_steps in (24, 48, 96):
        energies = balance(n_steps)
        gap = energies.taken_up[1] - energies.stored[1] - energies.dissipated[1]
        gaps.append(float(jnp.max(jnp.abs(gap)) / jnp.max(energies.work)))
    assert gaps[0] < 1e-3
    assert_order([4.0, 2.0, 1.0], gaps, order=2.0)


def test_reciprocity():
    grid, material = small_grid(), uneven_material(small_grid())
    here, there = small_force(grid), small_force(grid, centre=5e-4, width=2e-3)
    volumes = Layout(grid).sum_at_nodes(jnp.asarray(grid.volumes))
    first, second = run(material, here, 0.3 * there).maps[-1], run(material, 0.5 * there, there).maps[-1]
    one = jnp.sum(volumes * (0.5 * there * first[..., 1] + there * first[..., 0]))
    other = jnp.sum(volumes * (here * second[..., 1] + 0.3 * there * second[..., 0]))
    np.testing.assert_allclose(one, other, rtol=1e-10)


def test_walls_hold_what_they_should():
    result = run(uneven_material(small_grid()), layer=None)
    radial, axial = (np.abs(np.asarray(result.maps)[-1, :, :, component]) for component in (0, 1))
    moved = 1e-4 * axial.max()
    assert np.all(radial[0] == 0.0) and np.all(axial[0, 1:] > moved)
    assert np.all(radial[-1] == 0.0) and np.all(axial[-1, 1:] > moved)
    assert np.all(radial[:, 0] == 0.0) and np.all(axial[:, 0] == 0.0)
    assert np.all(radial[1:-1, -1] > 0.0) and np.all(axial[:, -1] > moved)


def test_smooth_on_the_axis():
    result = coarse_run("elastic")
    end, r = np.asarray(result.maps)[-1, :, 22], np.asarray(result.r)
    assert np.all(np.isfinite(result.maps)) and np.all(end[0] == [0.0, end[0, 1]])
    # Axial displacement is even in r: the quadratic in r^2 through the first nodes meets the fourth.
    weights = np.polynomial.polynomial.polyfit(r[:3] ** 2, end[:3, 1], 2)
    np.testing.assert_allclose(np.polynomial.polynomial.polyval(r[3] ** 2, weights), end[3, 1], rtol=3e-3)


def test_a_damping_layer_keeps_waves_from_coming_back():
    """Layers of two wave lengths; the walls of the large grid are too far for anything to come back."""
    small = AxisymmetricGrid(np.linspace(0.0, 12e-3, 31), np.linspace(-12e-3, 12e-3, 61))
    large = AxisymmetricGrid(np.linspace(0.0, 24e-3, 61), np.linspace(-24e-3, 24e-3, 121))
    layer = DampingLayer.against(np.sqrt((4e3 + 4e3) / 1e3), width=6e-3)
    settings, histories = ExplicitSettings(8e-5, 150, 4e-4), []
    for grid, damping in ((large, None), (small, None), (small, layer)):
        one, none = jnp.ones(grid.shape), jnp.zeros((0, *grid.shape))
        material = ViscoelasticField(1e3 * one, 4e3 * one, 3e3 * one, none, none)
        r, z = node_positions(grid)
        force = 1e4 * np.exp(-((r**2 + z**2) / 1e-6))
        solve = jax.jit(
            functools.partial(solve_push_explicitly, grid, settings=settings, damping=damping, estimate_error=False)
        )
        middle = grid.shape[1] // 2
        histories.append(np.asarray(solve(material, force).axial_displacement_on_axis)[:, middle - 10 : middle + 11])
    reflected, absorbed = (np.max(np.abs(each - histories[0])) for each in histories[1:])
    print("peak", np.max(histories[0]), "reflected", reflected, "with a layer", absorbed)
    assert absorbed < 0.1 * reflected


def test_limits_of_the_relaxation_time():
    material = uneven_material(small_grid(), n_branches=1)
    shape = (1, *small_grid().shape)
    slow = dataclasses.replace(material, relaxation_times=jnp.full(shape, 1e6))
    fast = dataclasses.replace(material, relaxation_times=jnp.full(shape, 1e-12))
    soft = dataclasses.replace(material, branch_shear_moduli=jnp.zeros(shape))
    stiff = dataclasses.replace(
        soft, relaxed_shear_modulus=material.relaxed_shear_modulus + material.branch_shear_moduli[0]
    )
    for limit, elastic in ((slow, stiff), (fast, soft)):
        ours, expected = run(limit).maps, run(elastic).maps
        np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-6 * float(jnp.max(jnp.abs(expected))))
    assert float(jnp.max(jnp.abs(run(slow).maps - run(fast).maps))) > 1e-8


def test_second_order_in_time_with_branches_and_a_layer():
    material = uneven_material(small_grid(), bulk_modulus=2e4)
    maps = [run(material, settings=ExplicitSettings(4.8e-4 / n, n, 3.1e-4)).maps[-1] for n in (24, 48, 96)]
    changes = [float(jnp.linalg.norm((maps[i] - maps[i + 1]).ravel())) for i in (0, 1)]
    print("changes", changes, "of", float(jnp.linalg.norm(maps[2].ravel())))
    assert changes[1] < 1e-3 * float(jnp.linalg.norm(maps[2].ravel()))
    assert_order([2.0, 1.0], changes, order=2.0)


def test_maps_points_focus_and_checkpoints_tell_the_same():
    grid, material = small_grid(), uneven_material(small_grid())
    points = np.array([[0.0, -3.1e-4], [7e-4, 1.2e-3], [0.0, 2e-3]])
    solve = functools.partial(solve_push_explicitly, grid, points=points, walls=MIXED, damping=LAYER)
    result = jax.jit(functools.partial(solve, settings=SMALL, estimate_error=False))(material, small_force(grid))
    np.testing.assert_allclose(result.at_focus(-3.1e-4), result.displacement_at_points[:, 0, 1], rtol=1e-12)
    np.testing.assert_allclose(result.displacement_at_points[-1, 1], result.maps[-1, 1, 6], rtol=1e-12)
    np.testing.assert_allclose(result.axial_displacement_on_axis[12::12], result.maps[:, 0, :, 1], rtol=1e-13)
    np.testing.assert_allclose(result.map_time, result.time[12::12], rtol=1e-14)
    assert result.time[0] == 0.0 and float(jnp.max(jnp.abs(result.displacement_at_points[0]))) == 0.0
    assert np.isnan(result.convergence.error) and result.convergence.shortcoming(1.0) != ""
    plain = run(material, settings=ExplicitSettings(2e-5, 24, 3.1e-4))
    np.testing.assert_allclose(plain.maps[-1], result.maps[-1], rtol=1e-11, atol=1e-18)


def test_gradients():
    grid = small_grid()
    settings = ExplicitSettings(2e-5, 12, 1.5e-4, n_maps=2, steps_per_checkpoint=3)
    start = {"material": uneven_material(grid), "axial": small_force(grid), "course": 1.0 + 1e3 * settings.times}

    def displacement(x):
        result = solve_push_explicitly(
            grid, x["material"], x["axial"], settings=settings, course=x["course"], walls=MIXED, damping=LAYER
        )
        return 1e6 * (result.at_focus(-2e-4)[11] + result.convergence.error * 1e-6 + result.velocity[2, 3, 1] * 1e-4)

    assert_gradient_of_each_leaf(displacement, start)


def test_a_batch_of_materials_equals_a_loop():
    materials = [uneven_material(small_grid(), bulk_modulus=bulk) for bulk in (1e5, 3e5, 5e5)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *materials)
    force = small_force(small_grid())
    batch = jax.vmap(lambda m: compiled(SMALL, MIXED, LAYER)(m, force, 0.0 * force).maps)(stacked)
    for ours, material in zip(batch, materials, strict=True):
        expected = run(material).maps
        np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-12 * float(jnp.max(jnp.abs(expected))))


def test_single_precision():
    material = uneven_material(small_grid())
    single = run(jax.tree.map(lambda leaf: leaf.astype(jnp.float32), material), np.float32(small_force(small_grid())))
    double = run(material)
    assert {leaf.dtype for leaf in jax.tree.leaves(single)} == {np.dtype(np.float32)}
    np.testing.assert_allclose(single.maps, double.maps, rtol=0.0, atol=2e-6 * float(jnp.max(jnp.abs(double.maps))))


@pytest.mark.parametrize(("bulk_modulus", "slack"), [(5e6, 1.15), (5e3, 1.6)])
def test_the_longest_step_is_safe_and_not_much_too_short(bulk_modulus, slack):
    grid, material = small_grid(), uneven_material(small_grid(), bulk_modulus=bulk_modulus, n_branches=0)
    solid = solid_of(Layout(grid), material, 1e-5, FREE, None)
    n = solid.mass.shape[0]

    def accelerate(u):
        padded = tuple(jnp.pad(part, (solid.row + 1, solid.row + 1)) for part in (u[:n], u[n:]))
        forces = internal_force(solid, strain_of(solid, padded), at_rest(solid).memory)
        return jnp.concatenate([free * f / solid.mass for free, f in zip(solid.free, forces, strict=True)])

    matrix = jax.jit(jax.vmap(accelerate))(jnp.eye(2 * n))
    longest = 2.0 / np.sqrt(np.max(np.linalg.eigvals(np.asarray(matrix)).real))
    ours = float(longest_stable_step(grid, material))
    assert longest / slack < ours <= longest * (1.0 + 1e-12)


def test_a_kelvin_voigt_push_agrees_with_the_implicit_solver():
    """To the discretisation error that the run itself estimates; without the viscosity it is far off."""
    z_nodes = np.linspace(-6.4e-3, 6.4e-3, 33)
    grid = AxisymmetricGrid(np.linspace(0.0, 4e-3, 21), z_nodes)
    mesh = Mesh(np.linspace(0.0, 4e-3, 11), z_nodes[::2])
    viscous, elastic = (
        prony_of_kelvin_voigt(KelvinVoigt(2e3, viscosity), shortest_time=2e-5) for viscosity in (0.5, 0.0)
    )
    constants = {"density": 1e3, "bulk_modulus": 2e4, "reading": ShearModulus(), "poisson_ratio": 0.5}
    solid = viscoelastic_field(viscous, grid.shape, **constants)
    assert float(jnp.min(solid.branch_shear_moduli)) < 0.0
    unrelaxed = solid.relaxed_shear_modulus + jnp.sum(solid.branch_shear_moduli, axis=0)
    stiff = dataclasses.replace(
        solid, relaxed_shear_modulus=unrelaxed, branch_shear_moduli=0.0 * solid.relaxation_times
    )
    longest = float(longest_stable_step(grid, solid))
    np.testing.assert_allclose(longest, longest_stable_step(grid, stiff), rtol=1e-12)

    def shape(r, z):
        return 1e5 * np.exp(-((r / 0.8e-3) ** 2) - (z / 2e-3) ** 2)

    settings = explicit_settings(grid, solid, end=5e-4, push_duration=5e-4)
    push = jax.jit(functools.partial(solve_push_explicitly, grid, settings=settings))
    results = [
        push(viscoelastic_field(prony, grid.shape, **constants), shape(*node_positions(grid)))
        for prony in (viscous, elastic)
    ]
    found = solve_push(
        mesh,
        viscoelastic_field(viscous, (len(mesh.gauss_r), len(mesh.gauss_z)), **constants),
        shape(mesh.gauss_r[:, None], mesh.gauss_z[None, :]),
        settings=PushSettings(1e-5, 50),
    )
    expected = np.asarray(found.axial_displacement_on_axis)[-1]
    ours, without = (
        np.max(np.abs(np.asarray(result.axial_displacement_on_axis)[-1] - expected)) / np.max(expected)
        for result in results
    )
    estimated = float(results[0].convergence.error)
    print(f"Kelvin-Voigt: {settings.n_steps} steps, {ours:.2e}, estimated {estimated:.2e}, elastic {without:.2e}")
    assert ours < 1.4 * estimated < 0.05
    assert without > 5.0 * ours


def test_unstable_steps_are_refused_or_flagged():
    grid, material, force = small_grid(), uneven_material(small_grid()), small_force(small_grid())
    long = ExplicitSettings(8e-5, 24, 3e-4)
    with pytest.raises(InputError, match="let `explicit_settings` choose it"):
        solve_push_explicitly(grid, material, force, settings=long)
    flagged = jax.jit(lambda m: solve_push_explicitly(grid, m, force, settings=long).convergence)(material)
    assert float(flagged.courant_number) > 1.0 and "unstable" in flagged.shortcoming(1e9)
    with pytest.raises(InputError, match="traced"):
        jax.jit(lambda m: explicit_settings(grid, m, end=1e-3, push_duration=5e-4).time_step)(material)
    chosen = explicit_settings(grid, material, end=1e-3, push_duration=5e-4, n_maps=3)
    assert 0.8 < chosen.time_step / float(longest_stable_step(grid, material)) <= 0.9
    assert chosen.doubled.n_steps * 2 == chosen.n_steps and len(chosen.map_times) == 3


def test_a_capped_bulk_modulus_changes_a_push_as_little_as_documented():
    grid = coarsened(beam_grid())
    material, force = reference_material("zener", grid), beam_force(grid)
    settings = explicit_settings(grid, material, end=5e-4, push_duration=5e-4)
    push = jax.jit(functools.partial(solve_push_explicitly, grid, settings=settings, estimate_error=False))
    full, capped = (push(m, force).at_focus(0.0)[-1] for m in (material, capped_bulk_modulus(material, 1.25e5)))
    assert 0.005 < float(capped / full - 1.0) < 0.012
    fewer = explicit_settings(grid, capped_bulk_modulus(material, 1.25e5), end=5e-4, push_duration=5e-4)
    assert fewer.n_steps < 0.56 * settings.n_steps


def test_nonsense_is_refused():
    grid, material, force = small_grid(), uneven_material(small_grid()), small_force(small_grid())
    solve = functools.partial(solve_push_explicitly, settings=SMALL)
    odd = AxisymmetricGrid(grid.r_faces[:-1], grid.z_faces)
    with pytest.raises(InputError, match="even numbers of cells"):
        solve(odd, jax.tree.map(lambda leaf: leaf[..., :-1, :], material), force[:-1])
    with pytest.raises(InputError, match="at the nodes"):
        solve(grid, material, force[:-1])
    with pytest.raises(InputError, match="centres of the cells"):
        solve(odd, material, force)
    with pytest.raises(InputError, match="25 times"):
        solve(grid, material, force, course=np.ones(24))
    with pytest.raises(InputError, match="multiple of twice"):
        solve(grid, material, force, settings=ExplicitSettings(1e-5, 25, 1e-4))
    with pytest.raises(InputError, match="must be positive"):
        ExplicitSettings(0.0, 4, 1e-4)
    with pytest.raises(InputError, match="steps_per_checkpoint"):
        ExplicitSettings(1e-5, 10, 1e-4, n_maps=2, steps_per_checkpoint=3)
    with pytest.raises(InputError, match="courant_number"):
        explicit_settings(grid, material, end=1e-3, push_duration=5e-4, courant_number=1.5)
    with pytest.raises(InputError, match="check moduli"):
        explicit_settings(grid, dataclasses.replace(material, density=-material.density), end=1e-3, push_duration=5e-4)
    with pytest.raises(InputError, match="width"):
        DampingLayer(0.0, 1.0)
    with pytest.raises(InputError, match="reflection"):
        DampingLayer.against(10.0, width=1e-3, reflection=2.0)
