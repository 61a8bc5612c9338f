"""A push in a few shapes of motion against the full solid."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import InputError, Mesh, PushSettings, SineIntensity, Zener, solve_push
from arfjax.mechanics.material.inclusion import material_of, mixed
from arfjax.mechanics.material.viscoelastic import YoungModulus
from arfjax.mechanics.reduced.basis import Sample, principal_shapes, push_snapshots, reduced_force, with_points
from arfjax.mechanics.reduced.solid import _march, reduced_push
from tests.checks import assert_gradient

MESH = Mesh(np.linspace(0.0, 3e-3, 4), np.linspace(0.0, 6e-3, 7))
FOCUS = 3e-3
STEPS = PushSettings(time_step=5e-5, n_steps=10)
MOMENTS = np.arange(1, STEPS.n_steps + 1)
LIVER, LESION = Zener(1100.0, 2000.0, 3e-3), Zener(8.0, 2e4, 1e-3)
SHAPE = (len(MESH.gauss_r), len(MESH.gauss_z))


def force(width=1e-3):
    r, z = jnp.asarray(MESH.gauss_r)[:, None], jnp.asarray(MESH.gauss_z)[None, :]
    return 1e4 * jnp.exp(-((r / width) ** 2) - ((z - FOCUS) / (2.0 * width)) ** 2)


def elements_within():
    """One in the four elements about the focus next to the axis, so that no element is mixed."""
    inside = (MESH.gauss_r < 1e-3)[:, None] & (np.abs(MESH.gauss_z - FOCUS) < 1e-3)[None, :]
    return jnp.asarray(inside, float)


def material(share, stiffness=1.0):
    lesion = Zener(LESION.relaxed_modulus, stiffness * LESION.unrelaxed_modulus, LESION.relaxation_time)
    solid = mixed(LIVER, lesion, share)
    return material_of(solid, share.shape, density=1060.0, reading=YoungModulus(), poisson_ratio=0.499)


@jax.jit
def full(solid, push):
    return solve_push(MESH, solid, push, settings=STEPS).at_focus(FOCUS)[-1]


@jax.jit
def snapshots(solid):
    return push_snapshots(MESH, solid, force(), STEPS, MOMENTS)


def reduced(*solids, n_modes, tolerance):
    """Shapes and points from pushes of these solids."""
    around = material(jnp.zeros((1, 1)))
    seen = [snapshots(solid) for solid in solids]
    shapes = principal_shapes(
        MESH,
        np.concatenate([np.asarray(each) for each in seen]),
        shear_modulus=700.0,
        bulk_modulus=3e5,
        inertia=1060.0 / 1e-4**2,
        n_modes=n_modes,
        focus=FOCUS,
    )
    samples = []
    for solid, motions in zip(solids, seen, strict=True):
        excess = [
            np.asarray(each + np.sum(branch, axis=0) - other[0, 0] - np.sum(rest))
            for each, branch, other, rest in (
                (
                    solid.relaxed_shear_modulus,
                    solid.branch_shear_moduli,
                    around.relaxed_shear_modulus,
                    around.branch_shear_moduli,
                ),
                (solid.bulk_modulus, np.zeros((1, 1, 1)), around.bulk_modulus, 0.0),
            )
        ]
        samples += [Sample(np.asarray(motion), *excess) for motion in motions]
    return with_points(MESH, shapes, samples, tolerance=tolerance), reduced_force(MESH, shapes, force())


def inside_of(solid, field):
    """A solid's fields at the points."""
    r = np.argmin(np.abs(MESH.gauss_r[:, None] - np.asarray(solid.r)), axis=0)
    z = np.argmin(np.abs(MESH.gauss_z[:, None] - np.asarray(solid.z)), axis=0)
    return jax.tree.map(lambda each: each[..., r, z][..., None], field)


@jax.jit
def reduced_at(solid, around, inside, work):
    return reduced_push(solid, around, inside, work, STEPS)


@pytest.mark.parametrize(
    ("steps", "n_modes"), [(STEPS, 10), (PushSettings(5e-5, 10, 4e-4, modulation=SineIntensity()), 9)]
)
def test_a_motion_that_was_seen_is_given_back(steps, n_modes, monkeypatch):
    """By as many shapes as its moments span to rounding: the tenth of the modulated push has 1e-16 of the energy."""
    inclusion = material(elements_within())
    monkeypatch.setattr(f"{__name__}.snapshots", lambda solid: push_snapshots(MESH, solid, force(), steps, MOMENTS))
    solid, work = reduced(inclusion, n_modes=n_modes, tolerance=1e-9)
    value = reduced_push(solid, material(jnp.zeros((1, 1))), inside_of(solid, inclusion), work, steps)
    expected = solve_push(MESH, inclusion, force(), settings=steps).at_focus(FOCUS)[-1]
    np.testing.assert_allclose(value, expected, rtol=1e-6)


def test_more_shapes_than_motions_span_are_refused():
    motions = np.asarray(snapshots(material(jnp.zeros(SHAPE))))
    with pytest.raises(InputError, match="3 shapes .* the 4 displacements span 2: .*fewer"):
        principal_shapes(
            MESH,
            np.concatenate([motions[:2], motions[:2]]),
            shear_modulus=700.0,
            bulk_modulus=3e5,
            inertia=1060.0 / 1e-4**2,
            n_modes=3,
            focus=FOCUS,
        )


def test_without_an_inclusion_points_do_nothing():
    liver, inclusion = material(jnp.zeros(SHAPE)), material(elements_within())
    solid, work = reduced(liver, inclusion, n_modes=18, tolerance=1e-2)
    around = material(jnp.zeros((1, 1)))
    value = reduced_at(solid, around, inside_of(solid, liver), work)
    np.testing.assert_allclose(value, full(liver, force()), rtol=1e-5)


def test_what_was_not_seen_is_near_and_fewer_shapes_are_worse():
    solid, work = reduced(
        *(material(elements_within(), stiffness) for stiffness in (0.5, 1.0, 2.0)), n_modes=16, tolerance=1e-4
    )
    unseen = material(elements_within(), 1.4)
    exact = full(unseen, force())

    def error(n_modes):
        fewer = solid.leading(n_modes)
        value = reduced_at(fewer, material(jnp.zeros((1, 1))), inside_of(fewer, unseen), work[:n_modes])
        return abs(float(value / exact) - 1.0)

    assert error(16) < 5e-3
    assert error(4) > 3.0 * error(16)


def test_gradient():
    inclusion = material(elements_within())
    solid, work = reduced(inclusion, n_modes=8, tolerance=1e-3)

    def displacement(numbers):
        around, inside, force = numbers
        return reduced_push(solid, around, inside, force, STEPS)

    assert_gradient(displacement, (material(jnp.zeros((1, 1))), inside_of(solid, inclusion), work))


def test_many_directions_have_the_slopes_of_going_through_the_steps():
    inclusion = material(elements_within())
    solid, work = reduced(inclusion, n_modes=8, tolerance=1e-3)
    around, inside = material(jnp.zeros((1, 1))), inside_of(solid, inclusion)
    forces = jnp.asarray(np.random.default_rng(0).normal(size=(5, len(work))) * np.abs(np.asarray(work)))

    def slopes(push):
        def along(force):
            # Stiffness, too, so that several arguments move at once, and one does not.
            change = jax.tree.map(lambda each: 0.1 * each, inside)
            return jax.jvp(lambda i, f: push(solid, around, i, f, STEPS), (inside, work), (change, force))[1]

        return jax.jit(jax.vmap(along))(forces)

    np.testing.assert_allclose(slopes(reduced_push), slopes(_march), rtol=1e-10)


def test_points_need_an_inclusion():
    with pytest.raises(InputError, match="no draw has a lesion"):
        reduced(material(jnp.zeros(SHAPE)), n_modes=5, tolerance=1e-3)
