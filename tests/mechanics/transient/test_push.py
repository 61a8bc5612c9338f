"""The transient solver: exact solutions, orders, invariants, derivatives."""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse.linalg

from arfjax.errors import InputError
from arfjax.mechanics.elements import gauss_points
from arfjax.mechanics.elements.axisymmetric import kinetic_energy, load, strain_energy
from arfjax.mechanics.elements.mesh import Walls
from arfjax.mechanics.material.inclusion import Inclusion, material_at
from arfjax.mechanics.material.lesion import Ellipsoid, EllipsoidalLesion
from arfjax.mechanics.material.viscoelastic import ViscoelasticField, YoungModulus
from arfjax.mechanics.transient.march import Scheme, prepare
from arfjax.mechanics.transient.push import PushResult, PushSettings, solve_push
from arfjax.media import FractionalZener
from arfjax.numerics.sparse_direct import release_factors
from tests.checks import assert_gradient_of_each_leaf, assert_order
from tests.mechanics.problems import Reference, gaussian_force, reference_mesh, small_force, small_mesh, uneven_material

SMALL = PushSettings(time_step=5e-5, n_steps=12, push_duration=4e-4)


@functools.cache
def compiled(settings: PushSettings, fixed: bool) -> Callable:
    mesh = small_mesh(Walls(fixed, fixed, fixed))
    return jax.jit(lambda m, f: solve_push(mesh, m, settings=settings, **f))


def run(material: ViscoelasticField, settings: PushSettings = SMALL, *, fixed: bool = True, **forces) -> PushResult:
    """The response of the small mesh, compiled once for all tests."""
    forces = {"axial_force": small_force(small_mesh()), "radial_force": np.zeros((12, 15)), **forces}
    return compiled(settings, fixed)(material, forces)


@pytest.mark.parametrize(("spectral_radius", "n_steps"), [(0.8, 48), pytest.param(0.0, 192, marks=pytest.mark.slow)])
def test_second_order_in_time_across_the_jumps_of_the_force(spectral_radius, n_steps):
    mesh = small_mesh()
    material = uneven_material(mesh, bulk_modulus=2e4)

    def displacement(n_steps: int) -> np.ndarray:
        settings = PushSettings(6e-4 / n_steps, n_steps, 4e-4, spectral_radius)
        return np.asarray(run(material, settings).displacement)

    coarse, middle, fine = displacement(n_steps), displacement(2 * n_steps), displacement(4 * n_steps)
    changes = [float(np.linalg.norm(coarse - middle)), float(np.linalg.norm(middle - fine))]
    assert changes[1] < 1e-3 * float(np.linalg.norm(fine))
    assert_order([2.0, 1.0], changes, order=2.0, slack=0.1)


def test_a_free_body_under_uniform_force_moves_as_newton_says():
    material = uneven_material(small_mesh())
    result = run(material, fixed=False, axial_force=30.0 * material.density)
    time, push = np.asarray(result.time), SMALL.push_duration
    exact = np.where(time < push, 15.0 * time**2, 15.0 * push**2 + 30.0 * push * (time - push))
    expected = np.broadcast_to(exact[:, None], result.axial_displacement_on_axis.shape)
    np.testing.assert_allclose(result.axial_displacement_on_axis, expected, rtol=1e-9)
    np.testing.assert_allclose(result.velocity[..., 1], 30.0 * push, rtol=1e-9)


def test_energy_is_conserved_without_damping():
    mesh = small_mesh()
    material = dataclasses.replace(uneven_material(mesh), branch_shear_moduli=jnp.zeros((2, 12, 15)))
    result = run(material, PushSettings(5e-5, 20, 1.0, spectral_radius=1.0))
    force = load(mesh, mesh.element_values(small_force(mesh)), mesh.element_values(0.0 * small_force(mesh)))
    work = jnp.sum(force.transpose(1, 0, 2) * result.displacement)
    stored = strain_energy(mesh, material.relaxed_shear_modulus, material.bulk_modulus, result.displacement)
    moving = kinetic_energy(mesh, material.density, result.velocity)
    assert min(float(stored), float(moving)) > 0.01 * float(work)
    np.testing.assert_allclose(stored + moving, work, rtol=1e-11)


def test_viscosity_only_takes_energy():
    mesh = small_mesh()
    material = uneven_material(mesh)
    result = run(material, PushSettings(5e-5, 20, 1.0, spectral_radius=1.0))
    force = load(mesh, mesh.element_values(small_force(mesh)), mesh.element_values(0.0 * small_force(mesh)))
    work = jnp.sum(force.transpose(1, 0, 2) * result.displacement)
    stored = strain_energy(mesh, material.relaxed_shear_modulus, material.bulk_modulus, result.displacement)
    assert stored + kinetic_energy(mesh, material.density, result.velocity) < 0.99 * work


def test_reciprocity():
    mesh, material = small_mesh(), uneven_material(small_mesh())
    here, there = small_force(mesh), gaussian_force(mesh, 2e4, 2e-3, 1e-3, centre=5e-4)
    first = run(material, axial_force=here, radial_force=0.3 * there)
    second = run(material, axial_force=0.5 * there, radial_force=there)
    load_first = load(mesh, mesh.element_values(here), mesh.element_values(0.3 * there)).transpose(1, 0, 2)
    load_second = load(mesh, mesh.element_values(0.5 * there), mesh.element_values(there)).transpose(1, 0, 2)
    np.testing.assert_allclose(
        jnp.sum(load_second * first.displacement), jnp.sum(load_first * second.displacement), rtol=1e-10
    )


def test_no_force_no_motion():
    mesh = small_mesh()
    result = run(uneven_material(mesh), axial_force=np.zeros((12, 15)))
    assert float(jnp.max(jnp.abs(result.displacement))) == 0.0


def test_limits_of_the_relaxation_time():
    mesh = small_mesh()
    material = uneven_material(mesh, n_branches=1)
    slow = dataclasses.replace(material, relaxation_times=jnp.full((1, 12, 15), 1e6))
    fast = dataclasses.replace(material, relaxation_times=jnp.full((1, 12, 15), 1e-12))
    no_branch = dataclasses.replace(
        material, branch_shear_moduli=jnp.zeros((0, 12, 15)), relaxation_times=jnp.zeros((0, 12, 15))
    )
    stiff = dataclasses.replace(
        no_branch, relaxed_shear_modulus=material.relaxed_shear_modulus + material.branch_shear_moduli[0]
    )
    for limit, elastic in ((slow, stiff), (fast, no_branch)):
        ours, expected = run(limit).displacement, run(elastic).displacement
        np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-7 * float(jnp.max(jnp.abs(expected))))
    assert float(jnp.max(jnp.abs(run(slow).displacement - run(fast).displacement))) > 1e-8


def test_regular_on_the_axis():
    reference = Reference("elastic")
    mesh = reference_mesh(0.3e-3, 1.5e-3)
    result = reference.solve(mesh, time_step=5e-5, end=5e-4)
    assert np.all(np.isfinite(result.displacement)) and np.all(np.asarray(result.displacement)[0, :, 0] == 0.0)
    middle = len(mesh.node_z) // 2
    start, half, whole = np.asarray(result.displacement)[:3, middle, 1]
    slope = (4.0 * half - whole - 3.0 * start) / mesh.r_edges[1]
    assert abs(slope) < 0.02 * start / reference.constants["a"]


def test_points_and_focus_interpolate_the_same_field():
    mesh = small_mesh()
    points = np.array([[0.0, -3.1e-4], [7e-4, 1e-3], [0.0, 2.2e-3]])
    force = small_force(mesh)
    result = jax.jit(lambda m: solve_push(mesh, m, force, settings=SMALL, points=points))(uneven_material(mesh))
    np.testing.assert_allclose(result.at_focus(-3.1e-4), result.displacement_at_points[:, 0, 1], rtol=1e-13)
    np.testing.assert_allclose(result.displacement_at_points[-1, 1], result.displacement[2, 8], rtol=1e-13)
    np.testing.assert_allclose(result.axial_displacement_on_axis[-1], result.displacement[0, :, 1], rtol=1e-13)
    assert result.time[0] == 0.0 and float(jnp.max(jnp.abs(result.displacement_at_points[0]))) == 0.0


def test_gradient_of_the_displacement_at_the_focus():
    mesh = small_mesh()
    settings = PushSettings(time_step=1e-4, n_steps=7)  # in segments of 3, 3 and 1
    start = {
        "material": uneven_material(mesh),
        "axial_force": jnp.asarray(small_force(mesh)),
        "radial_force": 0.3 * jnp.asarray(small_force(mesh)),
        "amplitude": jnp.asarray(np.random.default_rng(0).uniform(0.5, 1.0, (7, 2))),
    }

    def displacement(x):
        result = solve_push(mesh, settings=settings, **x)
        return 1e6 * result.at_focus(-2e-4)[6] + 1e3 * result.velocity[2, 3, 0]

    # One field at a time, since the largest derivative would hide an error of the others; compiled once for all.
    value, reverse = jax.jit(displacement), jax.jit(jax.grad(displacement))(start)
    forward = jax.jit(lambda direction: jax.jvp(displacement, (start,), (direction,))[1])
    leaves, structure = jax.tree.flatten(start)
    for i, slope in enumerate(jax.tree.leaves(reverse)):
        rng = np.random.default_rng(i)
        direction = structure.unflatten(
            [leaf * rng.uniform(0.5, 1.0, leaf.shape) if i == k else 0.0 * leaf for k, leaf in enumerate(leaves)]
        )

        def along(length: float, direction=direction) -> float:
            return float(value(jax.tree.map(lambda a, b: a + length * b, start, direction)))

        product, step = jnp.sum(slope * jax.tree.leaves(direction)[i]), 3e-3
        central = (8.0 * (along(step) - along(-step)) - (along(2.0 * step) - along(-2.0 * step))) / (12.0 * step)
        np.testing.assert_allclose(product, forward(direction), rtol=1e-10)
        np.testing.assert_allclose(product, central, rtol=1e-6)


def test_gradient_of_the_motion_beside_nodes_that_are_held():
    """Of all nodes with weights of their own, those at the walls and on the axis among them, which never move."""
    mesh = small_mesh(Walls(True, True, True))
    material, settings = uneven_material(mesh, n_branches=1), PushSettings(1e-4, 5)
    rows, columns, _ = mesh.free.shape
    weights = jnp.asarray(np.random.default_rng(3).standard_normal((2, columns, rows, 2)))

    def motion(x):
        scaled = dataclasses.replace(
            material,
            relaxed_shear_modulus=x["modulus"] * material.relaxed_shear_modulus,
            density=x["density"] * material.density,
        )
        result = solve_push(mesh, scaled, small_force(mesh), settings=settings)
        return jnp.sum(weights[0] * 1e6 * result.displacement) + jnp.sum(weights[1] * 1e3 * result.velocity)

    start = {"modulus": jnp.asarray(1.1), "density": jnp.asarray(0.9)}
    assert_gradient_of_each_leaf(motion, start, step=1e-3)
    twice = jax.jit(jax.jacrev(jax.grad(motion)))(start)
    mixed = jax.jit(jax.jacfwd(jax.grad(motion)))(start)
    for one, other in zip(jax.tree.leaves(twice), jax.tree.leaves(mixed), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)


@pytest.mark.slow
def test_gradient_to_the_order_the_relaxation_and_the_lesion():
    """From the constants that people fit to the motion, through the spectrum, the mixture and the march."""
    mesh = small_mesh()
    force, settings = small_force(mesh), PushSettings(1e-4, 6)

    def displacement(x):
        lesion = EllipsoidalLesion(Ellipsoid.of_length_and_diameter(x["length"], x["diameter"], centre=-2e-4))
        liver = FractionalZener(1e3, 6e3, x["time"], x["order"])
        coagulated = FractionalZener(4e3, x["modulus"], 2e-3, 0.8)
        material = material_at(
            mesh, Inclusion(liver, coagulated, lesion), density=x["density"], reading=YoungModulus(), poisson_ratio=0.49
        )
        return 1e6 * solve_push(mesh, material, force, settings=settings).at_focus(-2e-4)[-1]

    start = {"length": 3.4e-3, "diameter": 2.9e-3, "time": 1e-3, "order": 0.6, "modulus": 3e4, "density": 1060.0}
    assert_gradient_of_each_leaf(displacement, jax.tree.map(jnp.asarray, start), step=1e-4)


@pytest.mark.slow
def test_second_derivatives():
    # The derivative rule holds for itself: no part of it is taken as constant.
    mesh = small_mesh()
    material, settings = uneven_material(mesh, n_branches=1), PushSettings(1e-4, 5)

    def displacement(scales):
        scaled = dataclasses.replace(
            material,
            relaxed_shear_modulus=scales[0] * material.relaxed_shear_modulus,
            relaxation_times=scales[1] * material.relaxation_times,
            density=scales[2] * material.density,
        )
        return 1e6 * solve_push(mesh, scaled, scales[0] * small_force(mesh), settings=settings).at_focus(0.0)[-1]

    gradient, start = jax.jit(jax.grad(displacement)), jnp.array([1.0, 1.1, 0.9])
    hessian = jax.jit(jax.jacfwd(jax.grad(displacement)))(start)
    step = 1e-3
    steps = step * np.eye(3)
    change = [
        8.0 * (gradient(start + d) - gradient(start - d)) - (gradient(start + 2.0 * d) - gradient(start - 2.0 * d))
        for d in steps
    ]
    np.testing.assert_allclose(hessian, hessian.T, rtol=1e-9, atol=1e-11 * float(jnp.max(jnp.abs(hessian))))
    np.testing.assert_allclose(hessian, jnp.stack(change) / (12.0 * step), rtol=1e-6)


@pytest.mark.slow
def test_value_and_gradient_take_one_factorisation_and_little_memory(monkeypatch):
    mesh, material = small_mesh(), uneven_material(small_mesh(), n_branches=8)
    calls, splu = [], scipy.sparse.linalg.splu
    monkeypatch.setattr(scipy.sparse.linalg, "splu", lambda *a, **k: calls.append(None) or splu(*a, **k))
    release_factors()

    def memory(n_steps: int) -> int:
        def displacement(m):
            return solve_push(mesh, m, small_force(mesh), settings=PushSettings(5e-5, n_steps)).at_focus(0.0)[-1]

        program = jax.jit(jax.value_and_grad(displacement)).lower(material).compile()
        jax.block_until_ready(program(material))
        return program.memory_analysis().temp_size_in_bytes

    few, many = memory(16), memory(144)
    assert len(calls) == 1
    history = 8 * mesh.n_unknowns * (144 - 16)
    state = 8 * (4 * 9 + (8 + 1) * 3 * 9 + 3) * mesh.shape[0] * mesh.shape[1]
    assert many - few < 6 * history + 2 * (12 - 4) * state
    assert 6 * history + 2 * (12 - 4) * state < 0.4 * (144 - 16) * state


@pytest.mark.slow
def test_amplitude_shapes_the_push():
    mesh, material = small_mesh(), uneven_material(small_mesh())
    settings, n_steps = PushSettings(5e-5, 12), 12
    ends = np.random.default_rng(0).normal(size=(2, n_steps, 2))
    solve = jax.jit(lambda a: solve_push(mesh, material, small_force(mesh), settings=settings, amplitude=a))
    on = np.repeat(np.arange(n_steps)[:, None] < 8, 2, axis=1).astype(float)
    np.testing.assert_allclose(solve(on).displacement, run(material).displacement, rtol=1e-12, atol=1e-20)
    np.testing.assert_allclose(solve(on).velocity, run(material).velocity, rtol=1e-12, atol=1e-16)
    both, parts = solve(ends[0] - 2.0 * ends[1]), [solve(each) for each in ends]
    for field in ("displacement", "velocity", "axial_displacement_on_axis"):
        ours, (first, second) = getattr(both, field), (getattr(part, field) for part in parts)
        size = float(jnp.max(jnp.abs(first)))
        np.testing.assert_allclose(ours, first - 2.0 * second, rtol=0.0, atol=1e-11 * size)
    values = np.sin(1e3 * settings.times)
    pairs = np.stack([values[:-1], values[1:]], axis=1)
    by_function = solve_push(
        mesh, material, small_force(mesh), settings=settings, amplitude=lambda time: jnp.sin(1e3 * time)
    )
    np.testing.assert_allclose(solve(pairs).displacement, by_function.displacement, rtol=1e-11, atol=1e-20)
    with pytest.raises(InputError, match="13 times"):
        solve_push(mesh, material, small_force(mesh), settings=settings, amplitude=np.ones(12))


@pytest.mark.slow
def test_second_order_in_time_for_a_smooth_and_a_broken_amplitude():
    # A free body under a uniform force: Newton's law integrated twice by hand.
    mesh = small_mesh(Walls(False, False, False))
    material, end = uneven_material(mesh), 6e-4
    cases = [
        (lambda t: jnp.sin(np.pi * t / end), end**2 / np.pi),
        (lambda t: jnp.maximum(t / end - 1.0 / 3.0, 0.0), end**2 * (2.0 / 3.0) ** 3 / 6.0),
    ]
    for amplitude, exact in cases:
        errors = []
        for n_steps in (12, 24, 48):
            result = jax.jit(
                lambda m, n=n_steps, a=amplitude: (
                    solve_push(
                        mesh, m, 30.0 * m.density, settings=PushSettings(end / n, n), amplitude=a
                    ).axial_displacement_on_axis
                )
            )(material)
            errors.append(abs(float(result[-1, 3]) / (30.0 * exact) - 1.0))
        assert errors[-1] < 2e-3
        assert_order([4.0, 2.0, 1.0], errors, order=2.0)


def test_work_is_stored_moves_or_is_dissipated():
    # Dissipation from the stored history: twice the energy of each branch over its relaxation time.
    mesh, material = small_mesh(), uneven_material(small_mesh())
    settings = PushSettings(5e-6, 160, spectral_radius=1.0)
    scheme = Scheme(settings.time_step, 1.0)
    r, z = np.meshgrid(mesh.node_r, mesh.node_z)
    points = np.stack([r.ravel(), z.ravel()], axis=1)
    result = jax.jit(lambda m: solve_push(mesh, m, small_force(mesh), settings=settings, points=points))(material)
    nodal = result.displacement_at_points.transpose(0, 2, 1).reshape(-1, 2, *r.shape)
    solid = prepare(mesh, material, scheme.time_step)
    shear = gauss_points.volumes(mesh)[None] * jax.vmap(lambda g: gauss_points.at_points(mesh, g))(
        material.branch_shear_moduli
    )
    times = jax.vmap(lambda t: gauss_points.at_points(mesh, t))(material.relaxation_times)

    def step(remembered, change):
        shape = gauss_points.kinematics(mesh, change).shape
        new = solid.decay[:, None] * remembered + solid.gain[:, None] * shape[None]
        middle = 0.5 * (new + remembered) / (2.0 * shear[:, None])
        work = jax.vmap(gauss_points.deviatoric_stress)(2.0 * shear[:, None] * middle) * middle
        return new, settings.time_step * jnp.sum(work / times[:, None])

    start = jnp.zeros((2, 3, *solid.inertia.shape))
    stress, losses = jax.jit(lambda n: jax.lax.scan(step, start, n))(jnp.diff(nodal, axis=0))
    held = jax.vmap(gauss_points.deviatoric_stress)(stress) * stress / (2.0 * shear[:, None])
    in_branches = 0.5 * jnp.sum(held)
    force = load(mesh, mesh.element_values(small_force(mesh)), mesh.element_values(0.0 * small_force(mesh)))
    work = jnp.sum(force.transpose(1, 0, 2) * result.displacement)
    stored = strain_energy(mesh, material.relaxed_shear_modulus, material.bulk_modulus, result.displacement)
    moving = kinetic_energy(mesh, material.density, result.velocity)
    parts = np.array([float(stored), float(moving), float(in_branches), float(jnp.sum(losses))])
    assert np.all(parts > 0.01 * float(work)), parts / float(work)
    np.testing.assert_allclose(np.sum(parts), work, rtol=2e-3)


@pytest.mark.parametrize("field", ["density", "relaxation_times", "bulk_modulus", "branch_shear_moduli"])
def test_an_unstable_solid_gives_nan(field):
    material = uneven_material(small_mesh())
    bad = dataclasses.replace(material, **{field: getattr(material, field).at[..., 3, 4].set(-1.0)})
    assert np.all(np.isnan(run(bad).displacement[1:-1, 1:-1]))


def test_a_batch_of_materials_equals_a_loop():
    mesh = small_mesh()
    materials = [uneven_material(mesh, bulk_modulus=bulk) for bulk in (1e5, 5e5, 2e6)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *materials)
    batch = jax.jit(jax.vmap(lambda m: solve_push(mesh, m, small_force(mesh), settings=SMALL).displacement))(stacked)
    for ours, material in zip(batch, materials, strict=True):
        expected = run(material).displacement
        np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-10 * float(jnp.max(jnp.abs(expected))))


def test_nonsense_settings_are_refused():
    with pytest.raises(ValueError, match="must fall on a step"):
        PushSettings(time_step=3e-5, n_steps=40, push_duration=5e-4)
    with pytest.raises(ValueError, match="must fall on a step"):
        PushSettings(time_step=1e-4, n_steps=10, push_duration=9.6e-4)
    with pytest.raises(InputError, match="outside the mesh"):
        solve_push(
            small_mesh(),
            uneven_material(small_mesh()),
            small_force(small_mesh()),
            settings=SMALL,
            points=np.ones((1, 2)),
        )
    with pytest.raises(ValueError, match="spectral_radius"):
        PushSettings(time_step=1e-5, n_steps=4, push_duration=5e-4, spectral_radius=1.5)
    with pytest.raises(InputError, match="must be positive"):
        PushSettings(float("nan"), 10)
    with pytest.raises(ValueError, match="must be positive"):
        PushSettings(time_step=0.0, n_steps=4, push_duration=5e-4)
