"""Speckle tracking against closed forms: Gaussian motion under a Gaussian beam, uniform and polynomial motion."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.instruments.delay_estimation import DelayEstimation
from arfjax.instruments.speckle_tracking import SpeckleTracker, single_element_tracker
from tests.checks import assert_gradient, assert_gradient_of_each_leaf, assert_order
from tests.instruments.problems import gaussian_mean

FOCUS = 0.0904
BEAM: dict[str, Any] = {"lateral_width": 0.28e-3, "pulse_length": 0.1e-3, "window_length": 1.5e-3}
PAPER: dict[str, Any] = {
    "aperture_diameter": 16.5e-3,
    "depth": 90e-3,
    "lowest_frequency": 5.84e6,
    "highest_frequency": 8.66e6,
}


def nodes(n):
    """Positions that widen away from axis and focus, like the nodes of a mesh."""
    xi, eta = np.linspace(0.0, 1.0, n + 1), np.linspace(-1.0, 1.0, 2 * n + 1)
    return 5e-3 * (0.5 * xi + 0.5 * xi**2), 0.09 + 6e-3 * (0.6 * eta + 0.4 * eta**3)


def motion(r, z, radius=0.7e-3, length=2.5e-3):
    return np.exp(-((r[:, None] / radius) ** 2) - ((z[None, :] - 0.09) / length) ** 2)


def exact(tracker, radius=0.7e-3, length=2.5e-3):
    """Gaussian motion under a Gaussian beam, and under the Gaussian pulse blurred over the window."""
    wide = radius**2 + 2.0 * tracker.lateral_width**2
    across = radius**2 / wide * np.exp(-(float(tracker.radial_offset) ** 2) / wide)
    long = np.sqrt(length**2 + 2.0 * tracker.pulse_length**2)
    place = FOCUS + float(tracker.axial_offset) - 0.09
    along = length / long * gaussian_mean(place, max(tracker.window_length, 1e-7), long)
    return across * along


@pytest.mark.parametrize("widths", [BEAM, {}])
def test_gaussian_motion_under_a_gaussian_beam_to_fourth_order(widths):
    """The largest error over many places, since the error at one depends on where in its cell it lies."""
    offsets, errors, spacings = np.linspace(-1.5e-3, 1.5e-3, 21), [], []
    truth = [exact(SpeckleTracker(**widths, radial_offset=x, axial_offset=x)) for x in offsets]
    for n in (20, 30, 45, 67):
        r, z = nodes(n)

        def at(offset, r=r, z=z):
            tracker = SpeckleTracker(**widths, radial_offset=offset, axial_offset=offset)
            return tracker(motion(r, z), r, z, z=FOCUS)

        errors.append(np.abs(np.asarray(jax.jit(jax.vmap(at))(jnp.asarray(offsets))) - truth).max())
        spacings.append(1.0 / n)
    assert errors[-1] < 1e-5
    assert_order(spacings, errors, order=4.0, slack=0.3)


@pytest.mark.parametrize("narrow", [0.5, 1.0 / 3.0])
def test_motion_narrower_than_the_beam_is_underestimated(narrow):
    """On a fine map the rule over the beam is left, and the map's fourth order at a thirtieth of the motion's width."""
    radius = narrow * np.sqrt(2.0) * BEAM["lateral_width"]
    r, z = np.concatenate([np.linspace(0.0, 1e-3, 240)[:-1], np.linspace(1e-3, 3e-3, 80)]), nodes(150)[1]
    got = float(SpeckleTracker(**BEAM)(motion(r, z, radius), r, z, z=FOCUS))
    along = exact(eqx.tree_at(lambda each: each.lateral_width, SpeckleTracker(**BEAM), 0.0))
    share = narrow**2 / (1.0 + narrow**2)
    np.testing.assert_allclose(got, share * along, rtol=1e-6)
    assert share <= 0.2


def test_perfect_tracker_reads_the_nodes():
    r, z = nodes(10)
    values = np.random.default_rng(1).normal(size=(3, len(r), len(z)))
    for index in (0, 7, 20):
        np.testing.assert_allclose(SpeckleTracker()(values, r, z, z=z[index]), values[:, 0, index], rtol=1e-12)


def test_uniform_motion_is_read_as_it_is():
    r, z = nodes(12)
    tracker = SpeckleTracker(**BEAM, radial_offset=0.6e-3)
    np.testing.assert_allclose(tracker(2.5 * np.ones((len(r), len(z))), r, z, z=FOCUS), 2.5, rtol=1e-12)
    np.testing.assert_allclose(
        SpeckleTracker(**BEAM, gain=0.9)(np.ones((len(r), len(z))), r, z, z=FOCUS), 0.9, rtol=1e-12
    )


def test_quadratic_motion_is_the_sum_of_variances():
    r, z = nodes(12)
    tracker = SpeckleTracker(**BEAM, radial_offset=0.6e-3, axial_offset=0.2e-3)
    field = 2e6 * r[:, None] ** 2 - 3e6 * (z[None, :] - FOCUS) ** 2
    across = 0.6e-3**2 + 2.0 * BEAM["lateral_width"] ** 2
    along = 0.2e-3**2 + BEAM["pulse_length"] ** 2 + BEAM["window_length"] ** 2 / 12.0
    # Cut at six standard deviations, the variance of a plane Gaussian lacks 18 exp(-18).
    np.testing.assert_allclose(tracker(field, r, z, z=FOCUS), 2e6 * across - 3e6 * along, rtol=2e-6)


def test_harmonic_amplitudes_and_histories_are_read_alike():
    r, z = nodes(15)
    tracker, shape = SpeckleTracker(**BEAM), motion(*nodes(15))
    factor = np.asarray([1.0 - 2.0j, 0.3j])
    read = tracker(factor[:, None, None] * shape, r, z, z=FOCUS)
    np.testing.assert_allclose(read, factor * float(tracker(shape, r, z, z=FOCUS)), rtol=1e-12)
    history = tracker(np.arange(4.0)[:, None, None] * shape, r, z, z=FOCUS)
    np.testing.assert_allclose(history, np.arange(4.0) * float(tracker(shape, r, z, z=FOCUS)), rtol=1e-12)


def test_single_element_has_the_width_of_its_airy_pattern():
    """Where the disc's squared pulse-echo response, 2 J1(v) / v to the fourth, is half: 1.5 % inside the Gaussian."""
    from scipy.optimize import brentq
    from scipy.special import j1

    tracker = single_element_tracker(**PAPER, window_length=2e-3)
    half = float(brentq(lambda v: (2.0 * j1(v) / v) ** 4 - 0.5, 0.5, 2.0))  # pyright: ignore[reportArgumentType]
    wave = 1540.0 / 7.25e6
    airy = half * wave * 90e-3 / (np.pi * 16.5e-3)
    gauss = np.sqrt(2.0 * np.log(2.0)) * tracker.lateral_width
    np.testing.assert_allclose(gauss / airy, 1.015, atol=2e-3)
    np.testing.assert_allclose(2.0 * gauss, 0.87e-3, rtol=5e-3)  # 0.75 lambda z / D
    depth = np.sqrt(2.0 * np.log(2.0)) * tracker.pulse_length
    np.testing.assert_allclose(np.sinc(2.0 * depth / 1540.0 * 2.82e6) ** 2, 0.5, rtol=1e-5)
    assert tracker.jitter_sd == 0.0


def test_noise_has_its_deviation_and_its_seed():
    r, z = nodes(8)
    tracker = single_element_tracker(**PAPER, window_length=2e-3, noise_to_signal=0.05)
    history = np.ones((4000, len(r), len(z)))
    noise = np.asarray(tracker(history, r, z, z=FOCUS, key=jax.random.key(3))) - 1.0
    # Four standard errors of a standard deviation of 4000 values.
    assert abs(noise.std() / float(tracker.jitter_sd) - 1.0) < 4.0 / np.sqrt(8000)
    again = np.asarray(tracker(history, r, z, z=FOCUS, key=jax.random.key(3))) - 1.0
    np.testing.assert_array_equal(noise, again)


def full_tracker():
    return single_element_tracker(
        **PAPER,
        window_length=1.5e-3,
        noise_to_signal=0.1,
        correlation=0.99,
        radial_offset=0.31e-3,
        axial_offset=0.17e-3,
        gain=0.93,
    )


def total(tracker, z=FOCUS, scale=1.0):
    r, nodes_z = nodes(8)
    history = scale * jnp.asarray([1.0, 0.4, -0.7])[:, None, None] * motion(r, nodes_z)[None]
    shown = tracker(history, r, nodes_z, z=z, key=jax.random.key(1))
    return jnp.sum(shown * jnp.asarray([1.0, 2.0, -1.0])) + 1e3 * tracker.jitter_sd


def test_gradient_in_every_attribute():
    assert_gradient_of_each_leaf(total, full_tracker(), step=1e-4)
    assert_gradient(lambda x: total(full_tracker(), *x), (jnp.asarray(FOCUS), jnp.asarray(1.3)), rtol=2e-6)


def test_gradient_at_zero_is_finite():
    gradient = jax.grad(total)(jax.tree.map(jnp.asarray, SpeckleTracker()))
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(gradient))
    assert abs(float(gradient.radial_offset)) < 1e-9 and abs(float(gradient.axial_offset)) > 1.0


def test_jit_and_vmap_agree_with_one_by_one():
    offsets = jnp.linspace(0.0, 1e-3, 3)
    trackers = eqx.filter_vmap(lambda x: SpeckleTracker(**BEAM, radial_offset=x))(offsets)
    batched = eqx.filter_jit(eqx.filter_vmap(total))(trackers)
    single = [total(SpeckleTracker(**BEAM, radial_offset=float(x))) for x in offsets]
    np.testing.assert_allclose(batched, single, rtol=1e-12)


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        ({"lateral_width": -1e-3}, "`lateral_width` must be a finite number not below 0 [m], got -0.001"),
        ({"window_length": np.nan}, "`window_length` must be"),
        ({"window_length": 1.5}, "`window_length` is 1.5 m. Millimetres? Pass metres."),
        ({"radial_offset": np.inf}, "`radial_offset` must be a finite number [m]"),
        ({"gain": np.nan}, "`gain` must be a finite number [1]"),
    ],
)
def test_impossible_settings(settings, cause):
    with pytest.raises(InputError) as error:
        SpeckleTracker(**settings)
    assert cause in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        ({"lowest_frequency": 5.84, "highest_frequency": 8.66}, "Megahertz? Pass hertz."),
        ({"aperture_diameter": 16.5}, "`aperture_diameter` is 16.5 m. Millimetres?"),
        ({"highest_frequency": 5e6}, "`highest_frequency` less `lowest_frequency` must be a finite number above 0"),
        ({"window_length": 0.0}, "`window_length` must be a finite number above 0 [m]"),
        ({"correlation": 99.0}, "Percent?"),
    ],
)
def test_impossible_element(settings, cause):
    with pytest.raises(InputError) as error:
        single_element_tracker(**(PAPER | {"window_length": 2e-3} | settings))
    assert cause in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda r, z, u: (u[:-1], r, z, FOCUS), "`displacement` has shape (8, 17) for 9 radii and 17 axial"),
        (lambda r, z, u: (u, r[::-1], z, FOCUS), "`r` must ascend"),
        (lambda r, z, u: (u, r, np.where(z > 0.094, np.nan, z), FOCUS), "`nodes` must ascend and be finite"),
        (lambda r, z, u: (u, r - 1e-3, z, FOCUS), "`r` must not be negative"),
        (lambda r, z, u: (u, r, z, 90.4), "Millimetres? Pass metres; or enlarge the map of displacement"),
        (lambda r, z, u: (u, r, z, 0.0953), "reaches from z = 0.09395 to 0.09665 m"),
        (lambda r, z, u: (u, 0.2 * r, z, FOCUS), "to r = 0.00168 m, the map of displacement only"),
        (lambda r, z, u: (1j * u, r, z, FOCUS), "amplitudes of harmonics have no noise"),
    ],
)
def test_impossible_readings(change, cause):
    r, z = nodes(8)
    displacement, r, z, focus = change(r, z, motion(r, z))
    with pytest.raises(InputError) as error:
        SpeckleTracker(**BEAM)(displacement, r, z, z=focus, key=jax.random.key(0))
    assert cause in str(error.value) and "\n" not in str(error.value)


def test_without_delays_there_is_no_jitter():
    assert SpeckleTracker().jitter_sd == 0.0
    delays = DelayEstimation(7.25e6, 0.39, 2.6e-6, noise_to_signal=0.1)
    assert float(SpeckleTracker(delays=delays).jitter_sd) > 0.0
