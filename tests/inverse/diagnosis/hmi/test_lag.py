"""A thermocouple that follows late, against the exact solution of its equation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from inverse.diagnosis.hmi.causes.thermocouple_lag import not_followed
from inverse.diagnosis.hmi.courses import _AGES

SPACING = 8.0 / (len(_AGES) - 1)
"""Of the ages' logarithm, nearly."""
TIME = np.array([0.05, 0.4, 3.0, 20.0, 60.0])
SLOWNESS = 9.0
"""Of the tissue, whose temperature rises by 1 - exp(-t / slowness) [s]."""


def warmer(time_constant):
    """What the tissue is warmer than the wire, whose s dT/dt = tissue - T begins with both at 0."""
    rising, wire = np.exp(-TIME / SLOWNESS), np.exp(-TIME / time_constant)
    return time_constant / (SLOWNESS - time_constant) * (rising - wire)


def computed(time_constant):
    age = TIME[:, None] * _AGES
    rate = np.exp(-(TIME[:, None] - age) / SLOWNESS) / SLOWNESS
    return not_followed(jnp.asarray(age), jnp.asarray(rate), time_constant)


@pytest.mark.parametrize("time_constant", [1e-4, 0.03, 0.3, 2.0, 8.0])
def test_it_is_the_solution_of_the_wires_equation(time_constant):
    """But for the bend of the rate between ages, an eighth of its second derivative by the square of the steps."""

    def bend(age, time):
        step = np.expm1(SPACING) * (age + time / np.expm1(8.0))
        rate = np.exp(-(time - age) / SLOWNESS) / SLOWNESS**3
        return step**2 / 8.0 * rate * np.exp(-age / time_constant)

    bound = np.array([quad(bend, 0.0, time, args=(time,))[0] for time in TIME])
    assert np.all(np.abs(computed(time_constant) - warmer(time_constant)) <= bound + 1e-9)


def test_without_a_time_constant_it_is_nothing_and_grows_with_the_present_rate():
    at_zero, slope = jax.jvp(computed, (jnp.asarray(0.0),), (jnp.asarray(1.0),))
    np.testing.assert_array_equal(at_zero, 0.0)
    np.testing.assert_allclose(slope, np.exp(-TIME / SLOWNESS) / SLOWNESS, rtol=1e-12)


def test_reverse_and_forward_derivatives_are_one_and_central_differences():
    one, h = 0.7, 1e-4
    forward = jax.jacfwd(computed)(one)
    np.testing.assert_allclose(jax.jacrev(computed)(one), forward, rtol=1e-10)
    np.testing.assert_allclose(forward, (computed(one + h) - computed(one - h)) / (2.0 * h), rtol=1e-6)


def test_at_the_start_of_the_sonication_nothing_is_late():
    nothing = jnp.zeros((1, len(_AGES)))
    np.testing.assert_array_equal(not_followed(nothing, nothing + 6.0, 0.5), 0.0)
