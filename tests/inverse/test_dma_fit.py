"""Fits of Zener solids: twin data are recovered, intervals cover, what is not fixed is said; and real sweeps."""

import dataclasses

import numpy as np
import pytest

from arfjax.mechanics.material.complex_modulus import complex_modulus
from arfjax.media import FractionalZener, Zener
from inverse.datasets.dma import Sweep, dma_data, group_sweeps, read_dma
from inverse.datasets.shipped import shipped
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL, fit_sweeps, magnitude_only
from inverse.dma_residuals import LinearModulus, LogModulus

FREQUENCY = np.geomspace(0.1, 100.0, 14)


def twin(solid, *, frequency=FREQUENCY, noise=0.0, seed=0, sds=False):
    clean = np.asarray(complex_modulus(solid, 2.0 * np.pi * frequency))
    rng = np.random.default_rng(seed)
    spread = noise * np.abs(clean)
    storage = clean.real + spread * rng.normal(size=len(clean))
    loss = np.maximum(clean.imag + spread * rng.normal(size=len(clean)), 1e-9)
    data = dma_data(frequency, np.full(len(clean), 37.0), np.stack([storage, loss], axis=-1))
    if sds:
        data = dataclasses.replace(data, storage_modulus_sd=spread, loss_modulus_sd=spread)
    return Sweep("", 37.0, data)


TRUTHS = [
    FractionalZener(855.2, 3.0e3, 1.23e-2, 0.4),
    FractionalZener(1.0e3, 2.0e4, 8.0e-3, 0.35),
    Zener(1351.1, 2.1e3, 3.45e-2),
    Zener(2.0e3, 1.5e4, 0.3),
]


def values_of(solid):
    values = [solid.relaxed_modulus, solid.unrelaxed_modulus, solid.relaxation_time]
    return np.array([*values, solid.fractional_order] if isinstance(solid, FractionalZener) else values)


@pytest.fixture(scope="module")
def clean_fits():
    return fit_sweeps([twin(truth) for truth in TRUTHS])


@pytest.mark.parametrize("number", range(len(TRUTHS)))
def test_noise_free_twins_are_recovered(clean_fits, number):
    truth = TRUTHS[number]
    model = FRACTIONAL if isinstance(truth, FractionalZener) else CONVENTIONAL
    fits = [fit for fit in clean_fits.select(model=model) if fit.sweep is clean_fits.sweeps[number]]
    assert {fit.residual.name for fit in fits} == {"log", "linear"}
    for fit in fits:
        assert fit.converged and fit.n_agreeing >= 8, fit.status
        np.testing.assert_allclose(fit.values, values_of(truth), rtol=1e-6)
        assert not fit.warnings
        assert max(fit.sse_log, fit.sse_relative) < 1e-12


def test_sums_of_squares_are_what_they_say(clean_fits):
    fit = clean_fits.select(model=CONVENTIONAL, residual=LogModulus())[0]
    data = fit.sweep.data
    measured, fitted = data.storage_modulus + 1j * data.loss_modulus, fit.modulus(data.frequency_hz)
    assert fit.sse_linear == pytest.approx(np.sum(np.abs(fitted - measured) ** 2))
    assert fit.sse_log == pytest.approx(np.sum(np.abs(np.log(fitted / measured)) ** 2))
    assert fit.sse_relative == pytest.approx(np.sum((np.abs(fitted) / np.abs(measured) - 1.0) ** 2))
    other = clean_fits.select(model=CONVENTIONAL, residual=LinearModulus())[0]
    assert fit.sse_log < other.sse_log and other.sse_linear < fit.sse_linear


@pytest.mark.parametrize("sds", [False, True])
def test_intervals_cover_the_truth(sds):
    """80 noisy twins: a 95 % interval holds the truth in 84 to 100 % of them (three binomial errors and curvature)."""
    truth = FractionalZener(1.0e3, 2.0e4, 8.0e-3, 0.35)
    sweeps = [twin(truth, noise=0.02, seed=seed, sds=sds) for seed in range(80)]
    fits = fit_sweeps(sweeps, models=(FRACTIONAL,), residuals=(LogModulus(),), n_starts=4).fits
    errors = np.stack([(fit.values - values_of(truth)) / fit.uncertainty.standard_errors for fit in fits])
    covered = np.mean(np.abs(errors) < 1.96, axis=0)
    assert np.all(covered > 0.84), covered
    spread = np.std([fit.values for fit in fits], axis=0)
    typical = np.median([fit.uncertainty.standard_errors for fit in fits], axis=0)
    np.testing.assert_allclose(typical, spread, rtol=0.4)


def test_relaxed_modulus_of_the_paper_is_not_identified_by_magnitude():
    """The paper's row at 50 degC, 8 Pa under 15 kPa: magnitudes from 0.1 Hz on do not tell 8 Pa from 0."""
    sweep = twin(Zener(8.0, 15e3, 0.462), noise=0.02)
    fit = fit_sweeps(magnitude_only([sweep]), models=(CONVENTIONAL,), residuals=(LogModulus(),)).fits[0]
    assert list(fit.uncertainty.not_identified) == ["relaxed_modulus"]
    assert "relaxed_modulus is not fixed by these data" in fit.warnings[0]
    np.testing.assert_allclose(fit.values[1:], [15e3, 0.462], rtol=0.1)


def test_residual_weights_come_from_deviations():
    """One wrong point of large deviation: ignored with deviations, harmful without."""
    sweep = twin(Zener(2.0e3, 1.5e4, 0.3))
    storage = sweep.data.storage_modulus.copy()
    storage[5] *= 3.0
    deviation = np.full(len(storage), 1.0)
    deviation[5] = 1e7
    data = dataclasses.replace(
        sweep.data, storage_modulus=storage, modulus_magnitude=np.hypot(storage, sweep.data.loss_modulus)
    )
    weighted = dataclasses.replace(data, storage_modulus_sd=deviation, loss_modulus_sd=deviation)
    sweeps = [dataclasses.replace(sweep, data=d) for d in (data, weighted)]
    fits = fit_sweeps(sweeps, models=(CONVENTIONAL,)).fits
    for plain, better in (fits[:2], fits[2:]):
        np.testing.assert_allclose(better.values, [2.0e3, 1.5e4, 0.3], rtol=1e-4)
        assert np.max(np.abs(plain.values / [2.0e3, 1.5e4, 0.3] - 1.0)) > 0.05


@pytest.mark.parametrize(
    ("residual", "coordinates"),
    [
        (LogModulus(), lambda modulus: (np.log(np.abs(modulus)), np.angle(modulus))),
        (LinearModulus(), lambda modulus: (modulus.real, modulus.imag)),
    ],
)
def test_deviations_of_the_file_become_those_of_the_coordinates(residual, coordinates):
    """To first order, by finite differences, of storage and loss moduli that are known differently well."""
    storage, loss = np.array([1500.0, 900.0]), np.array([200.0, 700.0])
    of_storage, of_loss = np.array([3.0, 40.0]), np.array([20.0, 5.0])
    data = dma_data(np.array([1.0, 2.0]), np.full(2, 37.0), np.stack([storage, loss], axis=1))
    data = dataclasses.replace(data, storage_modulus_sd=of_storage, loss_modulus_sd=of_loss)
    step, modulus = 1e-3, storage + 1j * loss
    slopes = [
        (np.stack(coordinates(modulus + step * along)) - np.stack(coordinates(modulus - step * along))) / (2.0 * step)
        for along in (1.0, 1j)
    ]
    expected = np.hypot(slopes[0] * of_storage, slopes[1] * of_loss).T
    np.testing.assert_allclose(residual.standard_deviations(data), expected, rtol=1e-6)
    shown = residual.observations(data, 3)
    np.testing.assert_allclose(shown.observed[:2], np.stack(coordinates(modulus), axis=1), rtol=1e-12)
    np.testing.assert_allclose(shown.weights[:2], 1.0 / expected, rtol=1e-6)
    np.testing.assert_array_equal(shown.in_use, [True] * 4 + [False] * 2)
    np.testing.assert_allclose(shown.angular_frequency[:2], [2.0 * np.pi, 4.0 * np.pi])


def test_deviations_of_a_magnitude():
    data = dma_data(np.array([1.0, 2.0]), np.full(2, 37.0), np.array([1500.0, 900.0]))
    data = dataclasses.replace(data, modulus_magnitude_sd=np.array([30.0, 9.0]))
    np.testing.assert_allclose(LogModulus().standard_deviations(data)[:, 0], [0.02, 0.01])
    np.testing.assert_allclose(LinearModulus().standard_deviations(data)[:, 0], [30.0, 9.0])
    # There is no second coordinate, whatever its weight.
    np.testing.assert_array_equal(LogModulus().observations(data, 2).in_use, [True, False, True, False])


def test_ends_of_reported_constants_are_those_of_what_is_moved():
    """A branch that vanishes is no end of the unrelaxed modulus, which is the relaxed one then."""
    data = twin(Zener(2.0e3, 1.5e4, 0.3)).data
    omega = 2.0 * np.pi * FREQUENCY
    earliest, latest = 1e-6 / omega.max(), 1e6 / omega.min()
    assert CONVENTIONAL.ends(data, np.array([2e3, 1.5e4, 0.3])) == [None, None, None]
    assert CONVENTIONAL.ends(data, np.array([1e-4, 1.5e4, 1.2 * earliest])) == ["lower", None, "lower"]
    assert CONVENTIONAL.ends(data, np.array([2e3, 2e3 * (1.0 + 1e-9), latest / 1.2])) == [None, None, "upper"]
    assert FRACTIONAL.ends(data, np.array([2e3, 1.5e4, 0.3, 1.0 - 1e-8]))[3] == "upper"


def test_same_seed_same_fit(clean_fits):
    again = fit_sweeps([twin(truth) for truth in TRUTHS])
    for one, other in zip(clean_fits.fits, again.fits, strict=True):
        np.testing.assert_array_equal(one.values, other.values)


def test_sweeps_of_different_length_are_fitted_as_if_alone():
    long, short = twin(TRUTHS[3]), twin(TRUTHS[3], frequency=FREQUENCY[::2], noise=0.01)
    together = fit_sweeps([long, short], models=(CONVENTIONAL,)).fits
    alone = fit_sweeps([short], models=(CONVENTIONAL,)).fits
    for one, other in zip([fit for fit in together if fit.sweep is short], alone, strict=True):
        np.testing.assert_allclose(one.values, other.values, rtol=1e-6)
        np.testing.assert_allclose(one.uncertainty.standard_errors, other.uncertainty.standard_errors, rtol=1e-5)


def test_few_frequencies_are_not_fitted():
    three = twin(TRUTHS[3], frequency=np.array([0.1, 1.0, 10.0]))
    fit = fit_sweeps([three])
    assert {one.model.name for one in fit.fits} == {"zener"}
    assert fit.unfitted[0].models == ("fractional",) and "3 distinct frequencies" in fit.unfitted[0].reason


def test_one_frequency_gives_means_and_scatter_only():
    """The NIST foam, at 10 rad/s: no Zener constants, but a modulus with its repeat scatter at each temperature."""
    fit = fit_sweeps(group_sweeps(read_dma(shipped("nist_foam"))))
    assert not fit.fits and len(fit.unfitted) == 68
    coldest = next(one for one in fit.unfitted if one.sweep.label == "VN01 0 kGy, -25.0 degC")
    assert "one frequency cannot fix" in coldest.reason
    storage = coldest.sweep.data.storage_modulus
    assert coldest.means["storage"] == pytest.approx(np.mean(storage))
    assert coldest.scatters["storage"] == pytest.approx(np.std(storage, ddof=1))
    assert 0.0 < coldest.scatters["storage"] < 0.05 * coldest.means["storage"]


@pytest.fixture(scope="module")
def real_fits():
    sweeps = group_sweeps(read_dma(shipped("pyvisco_polymer")))
    return fit_sweeps(sweeps), fit_sweeps(magnitude_only(sweeps))


def gains(fits, residual, kind):
    pairs = zip(
        fits.select(model=CONVENTIONAL, residual=residual),
        fits.select(model=FRACTIONAL, residual=residual),
        strict=True,
    )
    return {round(a.sweep.temperature_c): getattr(a, kind) / getattr(b, kind) for a, b in pairs}


@pytest.mark.parametrize(("residual", "kind"), [(LogModulus(), "sse_log"), (LinearModulus(), "sse_linear")])
def test_fractional_gain_on_real_complex_sweeps(real_fits, residual, kind):
    """Storage and loss together: ten times lower sums of squares from 32 degC up, in 10 of 21 sweeps, not a majority.

    In the glassy sweeps below, neither solid has the shape of the loss modulus, and the gain is 2 to 9.
    """
    gain = gains(real_fits[0], residual, kind)
    assert len(gain) == 21
    assert [t for t, g in gain.items() if g >= 10.0] == [32, 40, 47, 55, 62, 70, 77, 85, 92, 100]
    assert all(2.0 < g < 10.0 for t, g in gain.items() if t < 30)
    assert gain[77] > 400.0


@pytest.mark.parametrize(("residual", "kind"), [(LogModulus(), "sse_log"), (LinearModulus(), "sse_linear")])
def test_fractional_gain_on_real_magnitudes(real_fits, residual, kind):
    """The magnitude alone, as the paper fitted: ten times lower in 15 of 21 sweeps, up to four powers of ten."""
    gain = gains(real_fits[1], residual, kind)
    below = [t for t, g in gain.items() if g < 10.0]
    assert below == [-50, -42, -35, -27, -12, -5]
    assert max(gain.values()) > 1e4 and min(gain.values()) > 1.5


def test_real_fits_converge_and_say_what_they_cannot(real_fits):
    complex_fits, magnitude_fits = real_fits
    assert all(fit.converged for fit in complex_fits.fits)
    assert sum(not fit.converged for fit in magnitude_fits.fits) <= 3
    for fit in (*complex_fits.fits, *magnitude_fits.fits):
        relaxed, unrelaxed, time = fit.values[:3]
        assert 0.0 <= relaxed <= unrelaxed and time > 0.0
        assert fit.converged or "did not converge" in fit.warnings[0]
    sure = [fit for fit in complex_fits.select(model=FRACTIONAL, residual=LogModulus()) if not fit.warnings]
    assert [round(fit.sweep.temperature_c) for fit in sure] == [70, 77, 85]
