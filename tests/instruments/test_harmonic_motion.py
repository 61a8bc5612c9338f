"""Peak-to-peak from pulses against closed forms, and the noise of the readings against many draws."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.instruments.harmonic_motion import (
    FittedHarmonics,
    HarmonicMotionImager,
    SampledExtremes,
    fitted_amplitudes,
    sampled_motion,
)
from arfjax.instruments.speckle_tracking import SpeckleTracker, single_element_tracker
from arfjax.suomi2016 import TEXT_MOTION_IMAGING
from tests.checks import assert_gradient, assert_gradient_of_each_leaf
from tests.instruments.test_speckle_tracking import BEAM, FOCUS, exact, motion, nodes

N = 20
R, Z = nodes(20)
TONES = np.asarray([2.0 - 1.0j, 0.3 + 0.4j, -0.2j])
MAPS = TONES[:, None, None] * motion(R, Z)


def read(imager, maps=MAPS, key=None):
    return imager(maps, R, Z, z=FOCUS, key=key)


def paper_imager(**settings):
    said = TEXT_MOTION_IMAGING
    tracker = single_element_tracker(
        aperture_diameter=1e-3 * said.imaging_diameter_mm,
        depth=1e-3 * said.focal_length_mm,
        lowest_frequency=1e6 * said.lowest_frequency_mhz,
        highest_frequency=1e6 * said.highest_frequency_mhz,
        window_length=2e-3,
        noise_to_signal=10 ** (-30 / 20),
    )
    n_pulses = round(said.pulse_repetition_frequency_hz / said.modulation_frequency_hz)
    return HarmonicMotionImager(
        tracker=tracker, pulses_per_period=n_pulses, n_averaged=said.averaged_samples, **settings
    )


def swing_of(tones):
    phase = np.linspace(0.0, 2.0 * np.pi, 200_001)
    return np.ptp(np.real(np.sum(tones[:, None] * np.exp(1j * np.outer(np.arange(1, len(tones) + 1), phase)), axis=0)))


def test_perfect_imager_reads_the_peak_to_peak_of_a_point():
    index = 20
    point = HarmonicMotionImager()(MAPS, R, Z, z=Z[index])
    np.testing.assert_allclose(point, swing_of(TONES) * motion(R, Z)[0, index], rtol=1e-9)


def test_beam_scales_the_motion():
    whole, beam = HarmonicMotionImager(), HarmonicMotionImager(tracker=SpeckleTracker(**BEAM))
    np.testing.assert_allclose(read(beam), swing_of(TONES) * exact(SpeckleTracker(**BEAM)), rtol=1e-3)
    assert float(read(beam)) < 0.8 * float(read(whole))


@pytest.mark.parametrize("share", [-1.0, -0.3, 0.0, 0.6, 1.0])
def test_pulses_miss_the_crest_of_a_sine(share):
    """A pulse pi d / n beside the crest, and one beside the trough, with an even number of pulses."""
    course = sampled_motion(jnp.asarray([3.0 + 0.0j]), n_pulses=N, first_pulse=np.pi * share / N)
    np.testing.assert_allclose(SampledExtremes()(course), 6.0 * np.cos(np.pi * share / N), rtol=1e-12)


def test_a_sine_loses_at_most_what_is_said_and_so_much_on_average():
    phases = jnp.linspace(0.0, 2.0 * np.pi / N, 2001)[:-1]
    courses = jax.vmap(lambda phase: sampled_motion(jnp.asarray([0.5 + 0.0j]), n_pulses=N, first_pulse=phase))(phases)
    found = np.asarray(SampledExtremes()(courses))
    np.testing.assert_allclose([found.min(), found.max()], [np.cos(np.pi / N), 1.0], atol=1e-9)
    assert 1.0 - found.min() < 0.0124
    # Trapezoidal mean over a kink: 1e-7.
    np.testing.assert_allclose(found.mean(), np.sin(np.pi / N) / (np.pi / N), rtol=1e-6)
    np.testing.assert_allclose(1.0 - found.mean(), 0.0041, atol=1e-4)


def test_sampled_course_is_the_sum_of_harmonics():
    batch = np.stack([TONES, 2.0 * TONES])
    course = sampled_motion(jnp.asarray(batch), n_pulses=7, first_pulse=0.4)
    phase = 0.4 + 2.0 * np.pi * np.arange(7) / 7
    single = np.real(sum(tone * np.exp(1j * (n + 1) * phase) for n, tone in enumerate(TONES)))
    np.testing.assert_allclose(course, np.stack([single, 2.0 * single]), rtol=1e-12)


def test_fit_finds_the_harmonics_whatever_phase_and_mean():
    course = 7.0 + sampled_motion(jnp.asarray(TONES), n_pulses=N, first_pulse=0.3)
    turned = TONES * np.exp(0.3j * np.arange(1, 4))
    np.testing.assert_allclose(fitted_amplitudes(course, n_harmonics=3), turned, rtol=1e-12)
    np.testing.assert_allclose(FittedHarmonics(3)(course), swing_of(TONES), rtol=1e-9)
    design = np.concatenate([f(np.outer(np.arange(N) * 2 * np.pi / N, [1, 2])) for f in (np.cos, np.sin)], axis=1)
    best = np.linalg.lstsq(np.column_stack([np.ones(N), design]), np.asarray(course), rcond=None)[0]
    np.testing.assert_allclose(fitted_amplitudes(course, n_harmonics=2), best[1:3] - 1j * best[3:5], rtol=1e-10)


@pytest.mark.parametrize(
    ("swing", "tones"), [(SampledExtremes(), TONES), (FittedHarmonics(1), TONES[:1]), (FittedHarmonics(3), TONES[:1])]
)
def test_noise_of_a_reading(swing, tones):
    """Small noise, and 4000 readings: four standard errors of a standard deviation are 4.5 %."""
    imager = paper_imager(swing=swing, first_pulse=0.1)
    maps = 1e-4 * np.broadcast_to((tones[:, None, None] * motion(R, Z))[None], (4000, len(tones), len(R), len(Z)))
    shown = np.asarray(read(imager, maps, key=jax.random.key(8)))
    mean = float(read(imager, maps[0]))
    np.testing.assert_allclose(shown.std() / float(imager.noise_sd), 1.0, atol=4.0 / np.sqrt(8000))
    assert abs(shown.mean() - mean) < 4.0 * float(imager.noise_sd) / np.sqrt(4000)
    once = eqx.tree_at(lambda each: each.tracker, paper_imager(swing=swing), imager.tracker)
    np.testing.assert_allclose(once.noise_sd, imager.noise_sd)


def test_noise_of_the_paper_is_tens_of_nanometres():
    """30 dB and a window of 2 mm, by the bound 0.196 um a pulse, sqrt(2 / 25) of that a reading of extremes."""
    imager = paper_imager()
    np.testing.assert_allclose(imager.noise_sd, np.sqrt(2.0 / 25.0) * imager.tracker.jitter_sd, rtol=1e-12)
    np.testing.assert_allclose(imager.tracker.jitter_sd, 0.196e-6, rtol=0.01)
    assert HarmonicMotionImager().noise_sd == 0.0


def test_noise_alone_is_read_as_its_range():
    """Where nothing moves, extremes are the range of 20 normal values, 3.735 standard deviations, averaged or not."""
    shown = np.asarray(read(paper_imager(), np.zeros((2000, *MAPS.shape), complex), key=jax.random.key(4)))
    # A range of 20 has a deviation of 0.73 (both from tables of control charts, d2 and d3).
    error = 0.73 / np.sqrt(2000 * 25)
    assert abs(shown.mean() / float(paper_imager().tracker.jitter_sd) - 3.735) < 4.0 * error + 5e-4


def test_steps_are_read_one_by_one():
    steps = np.stack([MAPS, 0.5 * MAPS, 1j * MAPS])
    for imager in (HarmonicMotionImager(), paper_imager(first_pulse=0.2), paper_imager(swing=FittedHarmonics(3))):
        np.testing.assert_allclose(read(imager, steps), [read(imager, each) for each in steps], rtol=1e-12)


def test_gradient():
    imager = HarmonicMotionImager(paper_imager().tracker, N, 0.21, n_averaged=2)
    offset = eqx.tree_at(lambda each: (each.tracker.radial_offset, each.tracker.axial_offset), imager, (2e-4, 3e-4))
    # Large enough to be seen in the derivative, too small to make another pulse extreme.
    noisy = eqx.tree_at(lambda each: each.tracker.delays.correlation, offset, 0.97)
    noisy = eqx.tree_at(lambda each: each.tracker.delays.sound_speed, noisy, 1540e2)
    r, z = nodes(8)
    maps = jnp.asarray(TONES[:, None, None] * motion(r, z)[None])
    steps = jnp.stack([maps, (0.4 + 0.2j) * maps])

    def total(imager):
        return imager(steps, r, z, z=FOCUS, key=jax.random.key(2)) @ jnp.asarray([1.0, 2.0])

    assert_gradient_of_each_leaf(total, noisy, step=1e-4)


@pytest.mark.parametrize("swing", [SampledExtremes(), FittedHarmonics(2)])
def test_gradient_in_the_course(swing):
    course = 0.5 + sampled_motion(jnp.asarray(TONES), n_pulses=N, first_pulse=0.3)
    assert_gradient(swing, course, step=1e-4)


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        ({"pulses_per_period": 1}, "`pulses_per_period` must be at least 2, got 1"),
        ({"n_averaged": 0}, "`n_averaged` must be at least 1 period, got 0"),
        ({"first_pulse": np.nan}, "`first_pulse` must be a finite number [rad]"),
    ],
)
def test_impossible_settings(settings, cause):
    with pytest.raises(InputError) as error:
        HarmonicMotionImager(**settings)
    assert cause in str(error.value) and "\n" not in str(error.value)


def test_impossible_readings():
    with pytest.raises(InputError, match="`n_harmonics` must be at least 1"):
        FittedHarmonics(0)
    with pytest.raises(InputError, match="6 pulses a period tell 2 harmonics apart, not 3"):
        read(HarmonicMotionImager(pulses_per_period=6, swing=FittedHarmonics(3)))
    with pytest.raises(InputError, match="noise comes with pulses"):
        read(HarmonicMotionImager(), key=jax.random.key(0))
