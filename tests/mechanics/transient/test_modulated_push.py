"""Pushes whose force has a course: Newton's law, superposition, order, and the same of the reduced solid's march."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

from arfjax.errors import InputError
from arfjax.mechanics.elements.mesh import Walls
from arfjax.mechanics.modulation import SineIntensity, SinePressure, Square
from arfjax.mechanics.transient.push import PushSettings, solve_push
from tests.checks import assert_gradient, assert_order
from tests.mechanics.problems import small_force, small_mesh, uneven_material

PUSH, STEPS = 6e-4, 12
COURSES = (SineIntensity(), SineIntensity(0.4), SinePressure(), Square(), Square(0.25))


def moved(settings, *, fixed=True, force=small_force):
    """Displacement of a node on the axis over time."""
    mesh = small_mesh(Walls(fixed, fixed, fixed))
    material = uneven_material(mesh)
    run = jax.jit(lambda m: solve_push(mesh, m, force(mesh), settings=settings).axial_displacement_on_axis)
    return np.asarray(run(material))[:, 3]


def share_at(course, time):
    """From the definition of the modulation: its period is the push, whose middle is the strongest moment."""
    return np.asarray(course.force(jnp.asarray(2.0 * np.pi * (time / PUSH - 0.5))))


@pytest.mark.parametrize("course", COURSES)
def test_impulse_is_the_integral_of_the_force(course):
    time = PUSH * np.array([0.0, 0.1, 0.31, 0.45, 0.5, 0.62, 0.8, 1.0])
    for start, end in zip(time[:-1], time[1:], strict=True):
        between = np.linspace(start, end, 20_001)
        force = share_at(course, 0.5 * (between[1:] + between[:-1]))
        first, last = (float(course.impulse(jnp.asarray(2.0 * np.pi * (at / PUSH - 0.5)))) for at in (start, end))
        np.testing.assert_allclose(last - first, 2.0 * np.pi * (end - start) / PUSH * np.mean(force), atol=2e-4)


@pytest.mark.parametrize("course", COURSES)
def test_steps_have_the_mean_of_their_time_and_none_after_the_push(course):
    settings = PushSettings(PUSH / STEPS, 2 * STEPS, PUSH, modulation=course)
    time = (np.arange(STEPS * 2000) + 0.5) * PUSH / (STEPS * 2000)
    mean = share_at(course, time).reshape(STEPS, 2000).mean(axis=1)
    # Of 2000 midpoints, one may lie on the other side of a jump.
    np.testing.assert_allclose(settings.course[:STEPS], mean, atol=1.0 / 2000.0)
    np.testing.assert_array_equal(settings.course[STEPS:], 0.0)
    np.testing.assert_allclose(np.cumsum(settings.jumps), settings.course, atol=1e-15)
    np.testing.assert_allclose(np.mean(settings.course[:STEPS]), course.coefficients(0)[0].real, rtol=1e-12)


def test_a_push_that_is_on_in_its_middle_is_the_difference_of_two_that_go_on():
    on = moved(PushSettings(PUSH / STEPS, STEPS))
    middle = moved(PushSettings(PUSH / STEPS, STEPS, modulation=Square()))
    quarter = STEPS // 4
    np.testing.assert_allclose(middle[-1], on[3 * quarter] - on[quarter], rtol=1e-10)
    np.testing.assert_array_equal(middle[: quarter + 1], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("course", [SineIntensity(), SinePressure(), Square()])
def test_a_free_body_obeys_newtons_law_to_second_order(course):
    """Exactly at the end: courses are symmetric, and impulses right. A square one begins and ends within steps."""
    end, errors = 1.5 * PUSH, []
    mesh = small_mesh(Walls(False, False, False))
    material = uneven_material(mesh)

    def exact(at):
        breaks = [0.25 * PUSH, 0.75 * PUSH]
        force = scipy.integrate.quad(
            lambda t: (at - t) * float(share_at(course, t)), 0.0, min(at, PUSH), points=breaks, epsabs=0.0
        )
        return 30.0 * force[0]

    for n_steps in (9, 27, 81):
        settings = PushSettings(end / n_steps, n_steps, PUSH, modulation=course)
        path = jax.jit(
            lambda m, s=settings: solve_push(mesh, m, 30.0 * m.density, settings=s).axial_displacement_on_axis[:, 3]
        )(material)
        np.testing.assert_allclose(path[-1], exact(end), rtol=1e-9)
        errors.append(abs(float(path[n_steps // 3]) / exact(0.5 * PUSH) - 1.0))
    assert errors[-1] < 1e-2
    assert_order([9.0, 3.0, 1.0], errors, order=2.0)


def test_what_would_have_two_courses_or_half_of_one_is_refused():
    with pytest.raises(ValueError, match="modulated push of 0.0006 s takes more than 4 steps"):
        PushSettings(1e-4, 4, PUSH, modulation=Square())
    mesh = small_mesh()
    with pytest.raises(InputError, match="give one"):
        solve_push(mesh, uneven_material(mesh), small_force(mesh), amplitude=np.ones(13),
                   settings=PushSettings(PUSH / STEPS, STEPS, modulation=Square()))  # fmt: skip


@pytest.mark.slow
def test_gradient_of_a_modulated_push():
    mesh = small_mesh()
    settings = PushSettings(PUSH / STEPS, STEPS, modulation=SineIntensity())

    def displacement(numbers):
        material, force = numbers
        return 1e6 * solve_push(mesh, material, force, settings=settings).at_focus(jnp.asarray(0.0))[-1]

    assert_gradient(displacement, (uneven_material(mesh), jnp.asarray(small_force(mesh))))
