"""The explicit path under derivatives, batches and single precision; steps, checkpoints, and what is refused."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.explicit.grid import (
    DampingLayer,
    Layout,
    coarsened,
)
from arfjax.mechanics.explicit.settings import ExplicitSettings, explicit_settings, longest_stable_step
from arfjax.mechanics.explicit.solver import solve_push_explicitly
from arfjax.mechanics.explicit.stencil import at_rest, internal_force, solid_of, strain_of
from tests.checks import assert_gradient, assert_gradient_of_each_leaf
from tests.mechanics.explicit.cases import (
    FREE,
    LAYER,
    MIXED,
    SMALL,
    compiled,
    elongated_grid,
    quick_jit,
    run,
    small_force,
    small_grid,
    uneven_material,
)


def test_maps_points_focus_and_checkpoints_tell_the_same():
    grid, material = small_grid(), uneven_material(small_grid())
    points = np.array([[0.0, -3.1e-4], [7e-4, 1.2e-3], [0.0, 2e-3]])
    solve = functools.partial(solve_push_explicitly, grid, points=points, walls=MIXED, damping=LAYER)
    result = quick_jit(functools.partial(solve, settings=SMALL, estimate_error=False))(material, small_force(grid))
    np.testing.assert_allclose(result.at_focus(-3.1e-4), result.displacement_at_points[:, 0, 1], rtol=1e-12)
    ends = [result.at_focus(z)[-1] for z in (result.z[0], result.z[-1])]
    np.testing.assert_allclose(ends, result.axial_displacement_on_axis[-1, [0, -1]], rtol=1e-9, atol=1e-18)
    outside = [result.at_focus(z) for z in (result.z[0] - 1e-5, result.z[-1] + 1e-5)]
    assert np.all(np.isnan(outside))
    np.testing.assert_allclose(result.displacement_at_points[-1, 1], result.maps[-1, 1, 6], rtol=1e-12)
    np.testing.assert_allclose(result.axial_displacement_on_axis[12::12], result.maps[:, 0, :, 1], rtol=1e-13)
    np.testing.assert_allclose(result.map_time, result.time[12::12], rtol=1e-14)
    assert result.time[0] == 0.0 and float(jnp.max(jnp.abs(result.displacement_at_points[0]))) == 0.0
    assert np.isnan(result.convergence.error) and "was not estimated" in result.convergence.shortcoming(1.0)
    plain = run(material, settings=ExplicitSettings(2e-5, 24, 3.1e-4))
    np.testing.assert_allclose(plain.maps[-1], result.maps[-1], rtol=1e-11, atol=1e-18)


def test_gradients():
    """In every constant of the material, both forces and the amplitude."""
    grid = coarsened(small_grid())
    settings = ExplicitSettings(2e-5, 12, 1.5e-4, n_maps=2, steps_per_checkpoint=3)
    force = small_force(grid)
    forces = {"axial": force, "radial": 0.4 * force}
    start = {"material": uneven_material(grid), "amplitude": 1.0 + 1e3 * settings.times, **forces}
    solve = functools.partial(solve_push_explicitly, grid, settings=settings, walls=MIXED, damping=LAYER)

    def displacement(x):
        options = {"radial_force": x["radial"], "amplitude": x["amplitude"], "estimate_error": False}
        result = solve(x["material"], x["axial"], **options)
        return 1e6 * (result.at_focus(-2e-4)[11] + result.velocity[2, 3, 1] * 1e-4)

    assert_gradient_of_each_leaf(displacement, start)


@pytest.mark.slow
def test_the_estimate_has_a_derivative():
    grid, material = coarsened(small_grid()), uneven_material(coarsened(small_grid()))
    grid = AxisymmetricGrid(grid.r_faces[:3], grid.z_faces)
    material = jax.tree.map(lambda leaf: leaf[..., :2, :], material)
    settings = ExplicitSettings(2e-5, 4, 1.0)

    def error(scale):
        stiffer = dataclasses.replace(material, relaxed_shear_modulus=scale * material.relaxed_shear_modulus)
        return 1e3 * solve_push_explicitly(grid, stiffer, small_force(grid), settings=settings).convergence.error

    assert_gradient(error, jnp.asarray(1.0), step=1e-3)


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


@pytest.mark.parametrize(
    ("grid", "bulk_modulus", "slack"),
    [(elongated_grid(), 5e6, 1.11), (elongated_grid(), 5e3, 1.11), (small_grid(), 5e6, 1.3), (small_grid(), 5e3, 1.3)],
    ids=["elongated-stiff", "elongated-soft", "square-stiff", "square-soft"],
)
def test_the_longest_step_is_safe_and_not_much_too_short(grid, bulk_modulus, slack):
    """Against the largest eigenvalue, with all walls free: that of any other walls is below."""
    material = uneven_material(grid, bulk_modulus=bulk_modulus, n_branches=0)
    solid = solid_of(Layout(grid), material, 1e-5, FREE, None)
    n = solid.mass.shape[0]

    def accelerate(u):
        padded = tuple(jnp.pad(part, (solid.row + 1, solid.row + 1)) for part in (u[:n], u[n:]))
        forces = internal_force(solid, strain_of(solid, padded), at_rest(solid).memory)
        return jnp.concatenate([free * f / solid.mass for free, f in zip(solid.free, forces, strict=True)])

    matrix = quick_jit(jax.vmap(accelerate))(jnp.eye(2 * n))
    longest = 2.0 / np.sqrt(np.max(np.linalg.eigvals(np.asarray(matrix)).real))
    ours = float(longest_stable_step(grid, material))
    assert longest / slack < ours <= longest


@pytest.mark.slow
def test_a_step_just_below_the_limit_is_stable_and_one_above_is_not():
    """With branches, over 4000 steps, and with the fixed walls of the default."""
    grid, material = coarsened(small_grid()), uneven_material(coarsened(small_grid()))
    longest = float(longest_stable_step(grid, material))
    peaks = []
    for factor in (1.0, 2.5):
        settings = ExplicitSettings(factor * longest, 4000, 3e-4)
        push = functools.partial(solve_push_explicitly, grid, settings=settings, estimate_error=False)
        result = quick_jit(push)(material, small_force(grid))
        peaks.append(float(jnp.max(jnp.abs(result.axial_displacement_on_axis))))
    assert peaks[0] < 1e-4
    assert not peaks[1] < 1.0


def test_the_longest_step_of_a_batch_and_of_a_viscous_pair():
    grid = small_grid()
    materials = [uneven_material(grid, bulk_modulus=bulk) for bulk in (1e5, 5e5)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *materials)
    alone = [float(longest_stable_step(grid, material)) for material in materials]
    np.testing.assert_allclose(longest_stable_step(grid, stacked), alone, rtol=1e-12)
    chosen = [explicit_settings(grid, m, end=1e-3, push_duration=5e-4) for m in (stacked, materials[1])]
    assert chosen[0] == chosen[1]
    moduli = materials[0].branch_shear_moduli * jnp.array([2.0, -0.5])[:, None, None]
    pair = dataclasses.replace(materials[0], branch_shear_moduli=moduli)
    stiff = dataclasses.replace(
        pair,
        relaxed_shear_modulus=pair.relaxed_shear_modulus + jnp.sum(pair.branch_shear_moduli, axis=0),
        branch_shear_moduli=0.0 * pair.branch_shear_moduli,
    )
    np.testing.assert_allclose(longest_stable_step(grid, pair), longest_stable_step(grid, stiff), rtol=1e-12)


def test_unstable_steps_are_refused_or_flagged():
    grid, material, force = small_grid(), uneven_material(small_grid()), small_force(small_grid())
    long = ExplicitSettings(8e-5, 24, 3e-4)
    with pytest.raises(InputError, match="let `explicit_settings` choose it"):
        solve_push_explicitly(grid, material, force, settings=long)
    flagged = quick_jit(lambda m: solve_push_explicitly(grid, m, force, settings=long).convergence)(material)
    assert float(flagged.courant_number) > 1.0 and "unstable" in flagged.shortcoming(1e9)
    with pytest.raises(InputError, match="traced"):
        jax.jit(lambda m: explicit_settings(grid, m, end=1e-3, push_duration=5e-4).time_step)(material)
    chosen = explicit_settings(grid, material, end=1e-3, push_duration=5e-4, n_maps=3)
    assert 0.8 < chosen.time_step / float(longest_stable_step(grid, material)) <= 0.9
    assert chosen.doubled.n_steps * 2 == chosen.n_steps and len(chosen.map_times) == 3


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
        solve(grid, material, force, amplitude=np.ones(24))
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
