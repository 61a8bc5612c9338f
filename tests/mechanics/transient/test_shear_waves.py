"""Arrivals, speed and strain of displacements that are known in closed form."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.mechanics.transient.shear_waves import (
    arrival_times,
    of_one_front,
    shear_wave_speed,
    strain_on_grid,
)
from tests.checks import assert_gradient, assert_order

R = np.linspace(2e-3, 8e-3, 13)
SPEED = 1.3


def passing(time, r=R, width=0.8e-3):
    """A bell that runs out at SPEED and falls as it goes."""
    return jnp.exp(-(((time[:, None] - r[None] / SPEED) / width) ** 2)) / jnp.sqrt(jnp.asarray(r))[None]


def times(n):
    return jnp.linspace(0.0, 8e-3, n)


def test_a_wave_arrives_when_its_crest_does_to_second_order_or_better():
    counts, errors = (41, 81, 161), []
    for n in counts:
        arrival = arrival_times(times(n), passing(times(n)))
        errors.append(np.abs(np.asarray(arrival) - R / SPEED).max())
    assert_order([1.0 / (n - 1) for n in counts], errors, order=2)
    assert errors[0] < 0.1 * 8e-3 / 40


def test_times_may_be_uneven():
    """Frames that are rounded to steps: 8.5 ms in 80 are five and six steps apart. A parabola's vertex is exact."""
    uneven = jnp.asarray(np.unique(np.round(np.linspace(0, 425, 81))) * 2e-5)
    assert np.ptp(np.diff(uneven)) > 1e-5
    bells = 1.0 - ((uneven[:, None] - R[None] / SPEED) / 8e-3) ** 2
    np.testing.assert_allclose(arrival_times(uneven, bells), R / SPEED, rtol=1e-10)
    np.testing.assert_allclose(shear_wave_speed(R, arrival_times(uneven, passing(uneven))), SPEED, rtol=2e-3)


def test_speed_is_the_slope_of_the_arrivals():
    arrival = jnp.asarray(1e-3 + R / SPEED)
    np.testing.assert_allclose(shear_wave_speed(R, arrival), SPEED, rtol=1e-12)
    some = arrival.at[jnp.asarray([0, 5, 12])].set(jnp.nan)
    np.testing.assert_allclose(shear_wave_speed(R, some), SPEED, rtol=1e-12)
    assert np.isnan(shear_wave_speed(R, arrival.at[2:].set(jnp.nan)))


def test_a_wave_that_has_not_passed_has_no_arrival():
    early = jnp.linspace(0.0, 4e-3, 81)
    arrival = arrival_times(early, passing(early))
    passed = R / SPEED < 4e-3 - 2 * 0.05e-3
    np.testing.assert_array_equal(np.isfinite(arrival), passed)
    assert np.all(np.isnan(arrival_times(early, jnp.zeros((81, 3)))))


def test_only_one_front_is_kept():
    arrival = jnp.asarray([jnp.nan, jnp.nan, 3.0, 4.0, 5.0, 1.0, 6.0, jnp.nan])
    np.testing.assert_array_equal(of_one_front(arrival), [np.nan, np.nan, 3.0, 4.0, 5.0, np.nan, np.nan, np.nan])
    broken = jnp.asarray([2.0, jnp.nan, 3.0])
    np.testing.assert_array_equal(of_one_front(broken), [2.0, np.nan, np.nan])


def test_gradient_of_arrival_and_speed():
    time = times(81)

    def value(parts):
        arrival = arrival_times(time, passing(time, width=parts["width"]) + parts["slope"] * 1e2 * time[:, None])
        return shear_wave_speed(R, of_one_front(arrival)) + 1e3 * jnp.sum(arrival)

    assert_gradient(value, {"width": 0.8e-3, "slope": 0.3}, step=1e-4)


def test_too_few_samples_are_refused():
    with pytest.raises(InputError, match="at least five samples"):
        arrival_times(jnp.linspace(0.0, 1.0, 4), jnp.zeros((4, 2)))


def test_strain_on_a_grid_is_exact_for_quadratic_motion_and_of_second_order():
    def strains(n: int) -> tuple[np.ndarray, np.ndarray]:
        r, z = np.linspace(0.0, 1.0, n) ** 1.2, np.linspace(-1.0, 1.5, n) + 0.1 * np.sin(np.linspace(0.0, 3.0, n))
        radii, heights = np.meshgrid(r, z, indexing="ij")
        wave = np.sin(2.0 * heights)
        motion = np.stack([radii * (1.0 + radii) * wave, np.cos(2.0 * radii) * heights**2], axis=-1)
        exact = np.stack(
            [
                (1.0 + 2.0 * radii) * wave,
                2.0 * np.cos(2.0 * radii) * heights,
                (1.0 + radii) * wave,
                2.0 * radii * (1.0 + radii) * np.cos(2.0 * heights) - 2.0 * np.sin(2.0 * radii) * heights**2,
            ],
            axis=-1,
        )
        return np.asarray(strain_on_grid(r, z, jnp.asarray(motion)[None]))[0], exact

    errors = []
    for n in (21, 41, 81):
        ours, exact = strains(n)
        np.testing.assert_allclose(ours[..., (0, 2)], exact[..., (0, 2)], atol=1e-12)  # quadratic along r
        errors.append(float(np.max(np.abs(ours - exact))))
    assert_order([4.0, 2.0, 1.0], errors, order=2.0, slack=0.3)
    with pytest.raises(InputError, match="from the axis"):
        strain_on_grid(np.array([0.1, 0.2, 0.3]), np.arange(3.0), jnp.zeros((3, 3, 2)))
