"""What holds whatever the numbers: rigid motion, uniform strain, energy, reciprocity, the axis, walls and layers."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.elements.mesh import Wall, Walls
from arfjax.mechanics.explicit.energy import EnergyBalance, energy_balance
from arfjax.mechanics.explicit.grid import (
    DampingLayer,
    Layout,
    coarsened,
    coarsened_cells,
    node_positions,
)
from arfjax.mechanics.explicit.settings import ExplicitSettings
from arfjax.mechanics.explicit.solver import assemble_push, solve_push_explicitly
from arfjax.mechanics.explicit.stencil import advance, at_rest, internal_force, solid_of, strain_of
from arfjax.mechanics.material.viscoelastic import (
    ViscoelasticField,
)
from tests.checks import assert_order
from tests.mechanics.explicit.cases import (
    FREE,
    LAYER,
    MIXED,
    SMALL,
    coarse_run,
    quick_jit,
    run,
    small_force,
    small_grid,
    uneven_material,
)


def test_uniform_strain_makes_no_force_inside():
    grid = small_grid()
    layout = Layout(grid)
    material = jax.tree.map(lambda leaf: jnp.full_like(leaf, leaf.ravel()[0]), uneven_material(grid))
    solid = solid_of(layout, material, 1e-5, FREE, None)
    memory = at_rest(solid).memory
    r, z = node_positions(grid)
    margin = ((layout.row + 1, layout.row + 1),)
    displacement = tuple(jnp.pad(jnp.asarray(u + 0.0 * (r + z)).ravel(), margin) for u in (2e-3 * r, 1e-4 - 3e-3 * z))
    strain, internal = quick_jit(lambda u: (strain_of(solid, u), internal_force(solid, strain_of(solid, u), memory)))(
        displacement
    )
    np.testing.assert_allclose(layout.cells(jnp.full(grid.shape, 1e-3)), strain.dilatation * (solid.lame > 0.0))
    forces = [np.asarray(layout.nodes(f)) for f in internal]
    for component, force in enumerate(forces):
        largest = np.max(np.abs(force))
        inside = force[1:-1, 1:-1] if component == 0 else force[:-1, 1:-1]
        assert np.max(np.abs(inside)) < 1e-12 * largest
    # The axial force on the top is the stress times the area.
    total = float(np.sum(forces[1][:, -1]))
    lame, twice = (float(np.asarray(a)[layout.row + 1] / grid.volumes[0, 0]) for a in (solid.lame, solid.twice_shear))
    np.testing.assert_allclose(total, np.pi * grid.r_faces[-1] ** 2 * (lame * 1e-3 - twice * 3e-3), rtol=1e-11)


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


@pytest.mark.parametrize("within", [0.02, 0.5, 0.95])
def test_a_free_body_is_as_fast_as_newton_says_wherever_in_the_last_step_the_push_ends(within):
    grid, material = small_grid(), uneven_material(small_grid())
    settings = dataclasses.replace(SMALL, push_duration=(SMALL.n_steps - 1 + within) * SMALL.time_step)
    solid, _, _ = assemble_push(grid, material, small_force(grid), settings=settings)
    volumes = Layout(grid).sum_at_nodes(jnp.asarray(grid.volumes))
    force = 30.0 * Layout(grid).nodes(solid.mass) / volumes
    result = run(material, force, settings=settings, walls=FREE, layer=None)
    np.testing.assert_allclose(result.velocity[..., 1], 30.0 * settings.push_duration, rtol=1e-9)


def test_energies_are_of_the_same_run_whichever_way_its_course_is_given():
    """As a function of time, or as that function's values."""

    def course(time):
        return jnp.sin(3e3 * time)

    grid, material = small_grid(), uneven_material(small_grid())
    found = [
        energy_balance(grid, material, jnp.asarray(small_force(grid)), settings=SMALL, amplitude=each)
        for each in (course, course(jnp.asarray(SMALL.times)))
    ]
    jax.tree.map(lambda one, other: np.testing.assert_allclose(one, other, rtol=1e-12), *found)
    assert float(jnp.sum(found[0].work)) > 0.0


def test_a_free_body_in_a_layer_slows_down_exponentially_to_second_order():
    """A layer so wide that its rate is the same everywhere, against a push for the first half of the run."""
    grid, material, rate, end = small_grid(), uneven_material(small_grid(), bulk_modulus=2e4), 4e3, 4.8e-4
    solid, _, _ = assemble_push(grid, material, small_force(grid), settings=SMALL)
    force = 30.0 * Layout(grid).nodes(solid.mass) / Layout(grid).sum_at_nodes(jnp.asarray(grid.volumes))
    exact, errors = 30.0 / rate * (1.0 - np.exp(-0.5 * rate * end)) * np.exp(-0.5 * rate * end), []
    for n_steps in (24, 48):
        settings = ExplicitSettings(end / n_steps, n_steps, 0.5 * end)
        result = run(material, force, settings=settings, walls=FREE, layer=DampingLayer(1e6, rate))
        velocity = np.asarray(result.velocity[..., 1])
        assert np.ptp(velocity) < 1e-6 * exact
        errors.append(abs(velocity.mean() - exact))
    assert errors[1] < 1e-3 * exact
    assert_order([2.0, 1.0], errors, order=2.0)


def test_coarser_cells_hold_as_much_as_the_fine_ones():
    grid = small_grid()
    fields = jnp.asarray(np.random.default_rng(2).uniform(1.0, 3.0, (2, *grid.shape)))
    coarse = coarsened_cells(grid, fields)
    held = jnp.sum(coarse * coarsened(grid).volumes[None], axis=(1, 2))
    np.testing.assert_allclose(held, jnp.sum(fields * grid.volumes[None], axis=(1, 2)), rtol=1e-13)
    np.testing.assert_allclose(coarsened_cells(grid, jnp.full(grid.shape, 7.0)), 7.0, rtol=1e-14)


def test_a_free_body_takes_up_the_impulse():
    grid, material = small_grid(), uneven_material(small_grid())
    solid, (_, force), _ = assemble_push(grid, material, small_force(grid), settings=SMALL)
    result = run(material, walls=FREE, layer=None)
    momentum = jnp.sum(solid.mass * result.velocity[..., 1].ravel())
    np.testing.assert_allclose(momentum, jnp.sum(force) * SMALL.push_duration, rtol=1e-10)
    np.testing.assert_allclose(jnp.sum(solid.mass), jnp.sum(material.density * grid.volumes), rtol=1e-13)


@functools.cache
def balance(n_steps: int) -> EnergyBalance:
    settings = ExplicitSettings(4.8e-4 / n_steps, n_steps, 3.1e-4)
    audit = quick_jit(lambda m, f: energy_balance(small_grid(), m, f, settings=settings, walls=MIXED, damping=LAYER))
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
    result = coarse_run("zener")
    end, r = np.asarray(result.maps)[-1, :, 22], np.asarray(result.r)
    assert np.all(np.isfinite(result.maps)) and np.all(end[0] == [0.0, end[0, 1]])
    # Axial displacement is even in r: the quadratic in r^2 through the first nodes meets the fourth.
    weights = np.polynomial.polynomial.polyfit(r[:3] ** 2, end[:3, 1], 2)
    np.testing.assert_allclose(np.polynomial.polynomial.polyval(r[3] ** 2, weights), end[3, 1], rtol=3e-3)


def share_that_comes_back(width_over_length: float, rate: float) -> float:
    """Reflection of a plane wave by a layer, exact: its equation solved from the wall to the start of the layer.

    Lengths in units of the layer's width, `rate` over speed and width: u'' + (k^2 - i k rate s^2) u = 0, u(1) = 0.
    """
    number = 2.0 * np.pi * width_over_length
    solution = solve_ivp(
        lambda s, u: [u[1], -(number**2 - 1j * number * rate * s**2) * u[0]],
        [1.0, 0.0],
        np.array([0.0, 1.0 + 0.0j]),
        rtol=1e-10,
        atol=1e-14,
    )
    value, slope = solution.y[:, -1]
    return float(abs((value + slope / (1j * number)) / (value - slope / (1j * number))))


def test_a_damping_layer_sends_back_what_the_wave_equation_says():
    """A pulse in a column, along whose sliding walls there is no layer: spectra of what goes by and what comes back.

    From 16 mm to the layer at 24 to 26 mm at 10 m/s; between them, at 20 mm, the observer. Both pulses are past it, and
    nothing has come from the far end, when the run ends.
    """
    grid = AxisymmetricGrid(np.array([0.0, 0.4e-3, 0.8e-3]), np.linspace(0.0, 26e-3, 521))
    one, none = jnp.ones(grid.shape), jnp.zeros((0, *grid.shape))
    material = ViscoelasticField(1e3 * one, 9.6e4 * one, 3e3 * one, none, none)
    layer, walls = DampingLayer.against(10.0, width=2e-3), Walls(Wall.SLIDING, Wall.SLIDING, Wall.FIXED)
    settings = ExplicitSettings(3.2e-3 / 1024, 1024, 5e-5)
    r, z = node_positions(grid)
    force = 1e4 * np.exp(-(((z - 16e-3) / 0.3e-3) ** 2)) + 0.0 * r
    push = functools.partial(solve_push_explicitly, grid, settings=settings, damping=layer, walls=walls)
    result = quick_jit(functools.partial(push, estimate_error=False))(material, force)
    velocity = np.diff(result.axial_displacement_on_axis[:, 400])
    lengths = 2e-3 * np.array([4.0, 2.0, 4.0 / 3.0, 1.0, 2.0 / 3.0])
    waves = np.exp(-2j * np.pi * 10.0 / lengths[:, None] * settings.times[None, :-1])
    gone, back = (np.abs(np.sum(waves[:, part] * velocity[None, part], axis=1)) for part in np.s_[:256, 256:])
    exact = [share_that_comes_back(2e-3 / length, layer.rate * layer.width / 10.0) for length in lengths]
    np.testing.assert_allclose(back / gone, exact, rtol=0.0, atol=2e-3)
    np.testing.assert_allclose(exact, [0.378, 0.160, 0.082, 0.022, 0.013], rtol=0.0, atol=5e-4)


def test_limits_of_the_relaxation_time():
    """A branch that never relaxes is a spring, one that relaxes at once is none (the hourglass does not relax)."""
    grid, material = small_grid(), uneven_material(small_grid(), n_branches=1)
    shape = (1, *grid.shape)
    slow = dataclasses.replace(material, relaxation_times=jnp.full(shape, 1e6))
    fast = dataclasses.replace(material, relaxation_times=jnp.full(shape, 1e-12))
    soft = dataclasses.replace(material, branch_shear_moduli=jnp.zeros(shape))
    unrelaxed = material.relaxed_shear_modulus + material.branch_shear_moduli[0]
    stiff = dataclasses.replace(soft, relaxed_shear_modulus=unrelaxed)

    @quick_jit
    def end(material, hourglass):
        solid, force, weights = assemble_push(grid, material, small_force(grid), settings=SMALL, walls=MIXED)
        solid = dataclasses.replace(solid, hourglass=hourglass)
        state, _ = jax.lax.scan(
            lambda state, weight: (advance(solid, state, (weight * force[0], weight * force[1])), None),
            at_rest(solid),
            weights,
        )
        return state.nodal_displacement(solid.row)

    hourglass = solid_of(Layout(grid), stiff, SMALL.time_step, MIXED, None).hourglass
    as_spring, as_nothing, spring, nothing = (end(each, hourglass) for each in (slow, fast, stiff, soft))
    atol = 1e-6 * float(jnp.max(jnp.abs(spring)))
    np.testing.assert_allclose(as_spring, spring, rtol=0.0, atol=atol)
    np.testing.assert_allclose(as_nothing, nothing, rtol=0.0, atol=atol)
    assert float(jnp.max(jnp.abs(spring - nothing))) > 1e3 * atol
