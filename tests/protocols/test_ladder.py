"""States of tissue at given temperatures of the focus, between output times and at both ends."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.protocols.ladder import states_when
from arfjax.protocols.sonication import SonicationResult
from arfjax.thermal.feedback import Effort
from arfjax.thermal.lesion import LesionSize


def heated(focal):
    """A sonication of one cell, whose dose is ten times the number of the output time."""
    focal = jnp.asarray(focal)
    time = jnp.arange(float(len(focal)))
    cell = focal[:, None, None]
    size = LesionSize(time, time, time, time)
    effort = Effort(jnp.asarray(1), jnp.asarray(0), jnp.asarray(0.0), jnp.asarray(True))
    dose = 10.0 * time[:, None, None]
    return SonicationResult(time, focal, cell, dose, dose, size, cell[1:], jnp.asarray(0), jnp.asarray(jnp.nan), effort)


@pytest.mark.parametrize("rounding", [-1e-13, 0.0, 1e-13])
def test_both_ends_are_reached_but_for_rounding(rounding):
    """The focal temperature of uniform tissue is an interpolation, and 1e-14 above or below it."""
    course = heated([37.0 + rounding, 47.0, 67.0 + rounding])
    states = states_when(course, jnp.asarray([37.0, 42.0, 47.0, 57.0, 67.0]))
    np.testing.assert_allclose(states.dose[:, 0, 0], [0.0, 5.0, 10.0, 15.0, 20.0], atol=1e-12)
    np.testing.assert_allclose(states.focal, [37.0, 42.0, 47.0, 57.0, 67.0], rtol=1e-14)
    assert np.all(np.isnan(states_when(course, jnp.asarray([36.9, 67.1])).dose))


def test_the_highest_of_a_course_that_cools_again_is_reached():
    states = states_when(heated([37.0, 47.0, 67.0 - 1e-13, 57.0]), jnp.asarray([42.0, 64.0, 67.0, 67.1]))
    np.testing.assert_allclose(states.dose[:, 0, 0], [5.0, 18.5, 20.0, np.nan], atol=1e-12)


def test_derivative_at_the_start_is_that_of_the_rise():
    course = heated([37.0, 47.0, 67.0])
    slope = jax.vmap(jax.grad(lambda t: states_when(course, t[None]).dose[0, 0, 0]))(jnp.asarray([37.0, 42.0, 57.0]))
    np.testing.assert_allclose(slope, [1.0, 1.0, 0.5], rtol=1e-14)
