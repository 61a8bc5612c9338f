"""Rows in the order of the measurement: visits of a temperature, neighbours, and folds that can be left out."""

import dataclasses
import inspect
from types import SimpleNamespace

import numpy as np
import pytest

from inverse.datasets.dma import dma_data, read_dma
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.cause import Extension, every_shape
from inverse.diagnosis.dma import diagnosis as dma_diagnosis
from inverse.diagnosis.dma import examination as dma_examination
from inverse.diagnosis.dma import extended_fit
from inverse.diagnosis.dma.account import DmaAccount
from inverse.diagnosis.dma.diagnosis import repeats_of
from inverse.diagnosis.dma.extended_fit import ExtendedFit, fit_extended
from inverse.diagnosis.dma.free_forms import dma_free_forms
from inverse.diagnosis.dma.gain import held_out_gain
from inverse.diagnosis.dma.problem import dma_problem
from inverse.diagnosis.dma.weighing import Weighing
from inverse.diagnosis.free_forms import COARSE
from inverse.diagnosis.noise import noise_family
from inverse.diagnosis.outlying import Outlying
from inverse.diagnosis.where import Absorbed
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL
from tests.blind import dma_generator as blind

FREQUENCY = np.geomspace(0.1, 100.0, 6)


def problem_of(temperature, frequency, time):
    constants = np.array([[1e3, 2e3, 0.01, 0.5]])
    modulus = blind.solid(constants, 2.0 * np.pi * np.asarray(frequency))[0] * (1.0 + np.asarray(temperature) / 100.0)
    modulus = modulus * np.exp(0.01 * np.random.default_rng(2).standard_normal(len(time)))
    data = dma_data(np.asarray(frequency), np.asarray(temperature), np.stack([modulus.real, modulus.imag], axis=-1))
    return dma_problem(dataclasses.replace(data, time_s=np.asarray(time, dtype=float)), FRACTIONAL, n_starts=4)


def test_a_temperature_that_is_measured_again_has_two_visits_and_one_set_of_constants():
    temperature = np.repeat([20.0, 40.0, 20.0], 6)
    problem = problem_of(temperature, np.tile(FREQUENCY, 3), np.arange(18.0))
    at, order = problem.conditions, np.argsort(np.asarray(problem.conditions.time))
    assert len(problem.sweeps) == 2
    np.testing.assert_array_equal(np.asarray(at.visit)[order], np.repeat([0, 1, 2], 6))
    np.testing.assert_array_equal(np.asarray(at.sweep)[order], np.repeat([0, 1, 0], 6))
    np.testing.assert_array_equal(np.asarray(at.sweep_before)[order], np.repeat([0, 0, 1], 6))
    np.testing.assert_allclose(np.asarray(at.time_in_sweep)[order], np.tile(np.linspace(0.0, 1.0, 6), 3))
    # Noise is not correlated across the pause between the visits: each visit and coordinate starts a series.
    assert [int(np.sum(one.previous < 0)) for one in problem.orderings()] == [6]


def test_temperatures_that_change_from_row_to_row_are_no_visits():
    problem = problem_of(np.tile([20.0, 40.0], 6), np.repeat(FREQUENCY, 2), np.arange(12.0))
    np.testing.assert_array_equal(problem.conditions.visit, problem.conditions.sweep)
    np.testing.assert_array_equal(problem.conditions.sweep_before, 0)


def test_a_sweep_from_high_to_low_has_the_neighbours_of_one_from_low_to_high():
    down = problem_of(np.repeat([20.0, 40.0], 6), np.tile(FREQUENCY[::-1], 2), np.arange(12.0))
    assert [one.name for one in down.orderings()] == ["frequency"]
    mixed = np.array([3, 0, 5, 1, 4, 2])
    drawn = problem_of(np.repeat([20.0, 40.0], 6), np.tile(FREQUENCY[mixed], 2), np.arange(12.0))
    assert [one.name for one in drawn.orderings()] == ["frequency", "time"]


def test_many_readings_are_judged_in_the_likeliest_noise(monkeypatch):
    asked, expected = [], inspect.signature(dma_examination.decide)

    def spied(*arguments, **options):
        given = expected.bind(*arguments, **options)
        given.apply_defaults()
        asked.append(given.arguments["few"])
        raise InterruptedError

    monkeypatch.setattr(dma_examination, "decide", spied)
    problem = problem_of(np.repeat([20.0, 40.0], 6), np.tile(FREQUENCY, 2), np.arange(12.0))
    with pytest.raises(InterruptedError):
        dma_examination.examine_dma(problem, DMA_CAUSES, np.random.default_rng(1))
    assert asked == [False]


def test_no_gain_where_every_block_leaves_too_few_rows():
    problem = problem_of(np.repeat([20.0, 40.0], 5), np.tile(FREQUENCY[:5], 2), np.arange(10.0))
    noise = noise_family(problem.orderings(), problem.frequencies())[0]
    drift = next(cause for cause in DMA_CAUSES if cause.name == "sweep-drift")
    assert held_out_gain(problem, (Extension(drift, 0.0),), noise, np.zeros(1)) is None


@pytest.mark.slow
def test_blocks_that_leave_too_few_rows_are_left_in_and_that_is_said():
    problem = problem_of(np.repeat([20.0, 40.0], 6), np.tile(FREQUENCY, 2), np.arange(12.0))
    noise = noise_family(problem.orderings(), problem.frequencies())[0]
    drift = next(cause for cause in DMA_CAUSES if cause.name == "sweep-drift")
    gain = held_out_gain(problem, (Extension(drift, 0.0),), noise, np.zeros(1))
    assert gain is not None and "4 blocks" in gain.split and "1 more would have left too few rows" in gain.split
    assert np.isfinite(gain.log_score_gain)


def test_few_control_readings_between_sweeps_are_visits_and_leave_the_others_as_they_are():
    temperature = np.concatenate([np.repeat([20.0, 40.0], 6), [20.0], np.repeat(60.0, 6)])
    frequency = np.concatenate([FREQUENCY, FREQUENCY, [1.0], FREQUENCY])
    problem = problem_of(temperature, frequency, np.arange(19.0) + 100.0)
    at, order = problem.conditions, np.argsort(np.asarray(problem.conditions.time))
    np.testing.assert_array_equal(np.asarray(at.visit)[order], np.repeat([0, 1, 2, 3], [6, 6, 1, 6]))
    np.testing.assert_array_equal(np.asarray(at.sweep_before)[order], np.repeat([0, 0, 1, 0], [6, 6, 1, 6]))
    steps = np.linspace(0.0, 1.0, 6)
    np.testing.assert_allclose(np.asarray(at.time_in_sweep)[order], np.concatenate([steps, steps, [0.0], steps]))
    # The clock of the file starts anywhere, that of the sample at its first reading.
    np.testing.assert_allclose(np.asarray(at.time)[order], np.arange(19.0))


def test_second_causes_are_counted_in_their_units():
    problem = problem_of(np.repeat([20.0, 40.0], 6), np.tile(FREQUENCY, 2), np.arange(12.0))
    noise = noise_family(problem.orderings(), problem.frequencies())[0]
    refit = fit_extended(problem, (), noise, np.zeros(0), library=DMA_CAUSES, profile=False)
    first = problem.directions(every_shape(DMA_CAUSES), refit.constants)
    expected = {(one.name, one.shape): one.directions for one in first}
    assert len(refit.others) == len(expected)
    for one in refit.others:
        wanted = expected[one.name, one.shape]
        np.testing.assert_allclose(one.directions, wanted, atol=1e-7 * np.max(np.abs(wanted)), err_msg=one.name)


def test_repeats_of_unequal_deviations_scatter_about_their_weighted_mean():
    problem = problem_of(np.repeat([20.0, 40.0, 20.0], 6), np.tile(FREQUENCY, 3), np.arange(18.0))
    order = np.argsort(np.asarray(problem.conditions.time))
    weights = np.empty_like(problem.weights)
    # Between the two visits of 20 degC the deviations of a pair are 1 and 2.
    weights[order] = 1.0 / np.repeat(np.array([1.0, 1.0, 2.0]), 6)[:, None]
    weighted = dataclasses.replace(problem, weights=weights)
    measured = problem.measured[order]
    # Of two readings with variances 1 and 4 the squares about the weighted mean are their difference's over 5.
    expected = np.sqrt(np.mean((measured[:6] - measured[12:]) ** 2 / 5.0))
    found = repeats_of(weighted)
    assert found.freedom == 12 and found.scatter == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("model", "name"),
    [(FRACTIONAL, "slip"), (FRACTIONAL, "sweep-drift"), (CONVENTIONAL, "slip"), (CONVENTIONAL, "power-law-relaxation")],
)
def test_what_a_fit_leaves_of_a_hidden_effect_is_what_its_key_says(tmp_path, model, name):
    """The generator, whose fit is its own, finds the strength of a d' to 1e-3."""
    conventional = model == CONVENTIONAL
    hidden = {"name": name, "d_prime": 6.0, "noise": "none", "conventional": conventional}
    blind.write(tmp_path / "data.csv", tmp_path / "key.json", seed=17, **hidden)
    problem = dma_problem(read_dma(tmp_path / "data.csv"), model)
    size = blind.noise_size(conventional=conventional)
    assert np.linalg.norm(problem.residuals()) / size == pytest.approx(6.0, rel=2e-3)


def test_an_interval_holds_what_shapes_between_those_of_a_coarse_list_allow(tmp_path, monkeypatch):
    """Close to the relaxation of the solid a second one fits, weaker or stronger, within a tenth of the sweep."""
    hidden = {"name": "second-relaxation", "d_prime": 6.0, "conventional": True}
    blind.write(tmp_path / "data.csv", tmp_path / "key.json", seed=12212, **hidden)
    problem = dma_problem(read_dma(tmp_path / "data.csv"), CONVENTIONAL)
    white = noise_family(problem.orderings(), problem.frequencies())[0]
    second = [Extension(next(one for one in DMA_CAUSES if one.name == "second-relaxation"), 0.55)]
    ends = {}
    for count in (9, 41):
        monkeypatch.setattr(extended_fit, "_PROFILED", count)
        ends[count] = fit_extended(problem, second, white, np.array([0.1]), library=DMA_CAUSES).intervals[0]
    width = float(np.ptp(ends[41]))
    # The ends are highest and lowest points of an ellipse over the shape, met to an eighth of its reach: to 4 % of the
    # width where shape and strength are correlated by 0.95.
    np.testing.assert_allclose(ends[9], ends[41], atol=0.05 * width)


def test_a_fit_that_fails_in_the_likeliest_noise_is_not_used_and_that_is_said(tmp_path, monkeypatch):
    file = tmp_path / "data.csv"
    blind.write(file, tmp_path / "key.json", seed=19_000, noise="loud")
    refit, begun = dma_examination.fit_extended, []

    def lost(problem, extensions, *given, **named):
        found = refit(problem, extensions, *given, **named)
        if extensions:
            return found
        begun.append(found)
        return dataclasses.replace(found, converged=False, status="too many steps")

    monkeypatch.setattr(dma_examination, "fit_extended", lost)
    problem = dma_problem(read_dma(file), FRACTIONAL)
    slip = [cause for cause in DMA_CAUSES if cause.name == "slip"]
    found = dma_examination.examine_dma(problem, slip, np.random.default_rng(1))
    assert len(begun) == 1 and "too many steps" in found.remarks[0]
    np.testing.assert_array_equal(found.residuals, problem.residuals())


def test_constants_without_a_cause_are_those_that_were_tested(tmp_path):
    """In the noise that refits begin from: those in white noise differ by more than a cause would change."""
    blind.write(tmp_path / "data.csv", tmp_path / "key.json", seed=19_000, noise="loud")
    problem = dma_problem(read_dma(tmp_path / "data.csv"), FRACTIONAL)
    slip = [cause for cause in DMA_CAUSES if cause.name == "slip"]
    found = dma_examination.examine_dma(problem, slip, np.random.default_rng(1))
    refit = fit_extended(problem, (), found.family[found.decision.omnibus.null_noise], np.zeros(0), library=slip)
    np.testing.assert_allclose(found.constants, refit.constants, rtol=1e-6)
    assert np.max(np.abs(found.constants / problem.constants - 1.0)) > 0.01
    added = found.fit((Extension(slip[0], 0.0),), found.family[0], np.array([0.01]), False)
    told = DmaAccount(problem, found.constants).constants(added)
    np.testing.assert_array_equal([one.without for one in told], found.constants.ravel())


def test_a_deviation_that_is_not_used_is_named():
    sweep = np.geomspace(0.1, 100.0, 8)
    both = dma_data(sweep, np.full(8, 20.0), np.stack([1e3 * sweep**0.2, 1e2 * sweep**0.1], axis=-1))
    problem = dma_problem(dataclasses.replace(both, modulus_magnitude_sd=np.full(8, 10.0)), FRACTIONAL, n_starts=2)
    assert any("magnitude's standard deviation is not used" in note for note in problem.notes)
    assert not problem.stated_deviations


def test_so_cold_that_nothing_dries_drying_does_nothing():
    """The formula for vapour has a pole at -243 degC."""
    temperature = np.repeat([-250.0, -240.0, 20.0], 6)
    problem = problem_of(temperature, np.tile(FREQUENCY, 3), np.arange(18.0))
    cold = np.asarray(problem.conditions.temperature) < 0.0
    exposure = np.asarray(problem.conditions.exposure)
    assert np.all(exposure[cold] < 1e-5) and exposure.max() == 1.0


@pytest.mark.parametrize(
    ("coordinate", "size", "sweeps", "words"),
    [
        (
            0,
            0.03,
            (1, 2),
            "the measured magnitude is 3 % above the model at most, at 100 Hz (60.0 degC), from 40 degC on",
        ),
        (
            1,
            -0.02,
            (1, 2),
            "the measured phase is 20 mrad below the model at most, at 100 Hz (60.0 degC), from 40 degC on",
        ),
        # Neither from some temperature on where it is there from the first, nor where it is at one alone.
        (0, -0.03, (0, 1, 2), "the measured magnitude is 3 % below the model at most, at 100 Hz (60.0 degC)"),
        # Of magnitudes the logarithm is seen: a tenth as large is 90 % below, ten times as large 900 above.
        (0, -np.log(10.0), (0, 1, 2), "the measured magnitude is 90 % below the model at most, at 100 Hz (60.0 degC)"),
        (0, 0.03, (1,), "the measured magnitude is 2.4 % above the model at most, at 100 Hz (40.0 degC)"),
    ],
)
def test_a_correction_is_told_by_its_place_sign_size_and_onset(coordinate, size, sweeps, words):
    problem = problem_of(np.repeat([20.0, 40.0, 60.0], 6), np.tile(FREQUENCY, 3), np.arange(18.0))
    correction = np.zeros(problem.weights.shape)
    for sweep in sweeps:
        rows = np.asarray(problem.conditions.sweep) == sweep
        correction[rows, coordinate] = size * np.linspace(0.1, 1.0, 6) * (sweep + 3.0) / 5.0
    place = Absorbed("somewhere", 0.5, 0.01, (problem.weights * correction).ravel())
    assert DmaAccount(problem, problem.constants).describe(place) == f"somewhere: {words}"


def test_of_two_samples_that_which_is_measured_longer_dries_more():
    """As vapour takes it away: at one temperature in proportion to the time."""
    frequency = np.tile(FREQUENCY, 2)
    time = np.concatenate([600.0 * np.linspace(0.0, 1.0, 6), 36_000.0 * np.linspace(0.0, 1.0, 6)])
    modulus = np.stack([1e3 * frequency**0.2, 1e2 * frequency**0.1], axis=-1)
    data = dma_data(frequency, np.full(12, 37.0), modulus)
    data = dataclasses.replace(data, time_s=time, sample=("short",) * 6 + ("long",) * 6)
    exposure = np.asarray(dma_problem(data, FRACTIONAL, n_starts=2).conditions.exposure)
    np.testing.assert_allclose(exposure, time / 36_000.0, rtol=1e-12)


def test_a_row_that_is_written_twice_is_one_reading():
    sweep = np.geomspace(0.1, 100.0, 8)
    rows = np.array([*range(8), 2, 3, *range(8)])
    modulus = np.stack([1e3 * sweep**0.2, 1e2 * sweep**0.1], axis=-1)
    data = dma_data(sweep[rows], np.full(len(rows), 20.0), modulus[rows])
    kept = data.without_copies()
    np.testing.assert_array_equal(kept.frequency_hz, sweep)
    assert kept.remarks[0].startswith("10 rows repeat others in every column that is used and are left out")
    # Another time, sample or modulus, however little, is another reading.
    for other in (
        dataclasses.replace(data, time_s=np.arange(18.0)),
        dataclasses.replace(data, sample=tuple("abcdefghijklmnopqr")),
        dataclasses.replace(data, loss_modulus=data.loss_modulus * (1.0 + 1e-9 * np.arange(18.0))),
        dataclasses.replace(data, storage_modulus_sd=np.arange(1.0, 19.0), loss_modulus_sd=np.ones(18)),
    ):
        assert other.without_copies() is other
    problem = dma_problem(data, FRACTIONAL, n_starts=2)
    assert problem.rows == 8
    # Who left them out has said so already.
    assert sum("10 rows repeat" in note for note in problem.notes) == 1
    assert not any("repeat" in note for note in dma_problem(kept, FRACTIONAL, n_starts=2).notes)


@pytest.fixture(scope="module")
def four_sweeps():
    """Two temperatures of each of two samples, frequencies in another order than time."""
    mixed = np.array([3, 0, 5, 1, 4, 2])
    temperature = np.repeat([20.0, 40.0, 30.0, 50.0], 6)
    problem = problem_of(temperature, np.tile(FREQUENCY[mixed], 4), np.arange(24.0))
    # By temperature: 20 and 30 of one sample, 40 and 50 of the other.
    sweeps = tuple(dataclasses.replace(one, sample="ab"[place // 2]) for place, one in enumerate(problem.sweeps))
    return dataclasses.replace(problem, sweeps=sweeps)


def test_neighbours_of_a_residual_are_of_its_kind_its_sample_and_next_to_it(four_sweeps):
    """Along frequency and time within a sweep, along temperature at one frequency of one sample."""
    problem, at = four_sweeps, four_sweeps.conditions
    place = {
        "frequency": np.asarray(at.angular_frequency),
        "temperature": np.asarray(at.temperature),
        "time": np.asarray(at.time),
    }
    sweep, rank = np.asarray(at.sweep), np.round(np.log(place["frequency"]), 6)
    sample = np.array([problem.sweeps[one].sample for one in sweep])
    same = {"frequency": sweep, "time": sweep, "temperature": [f"{s} {r}" for s, r in zip(sample, rank, strict=True)]}
    axes = {one.along: one for one in dma_diagnosis._axes(problem)}
    assert list(axes) == ["frequency", "temperature", "time"]
    for along, axis in axes.items():
        np.testing.assert_array_equal(axis.position, np.repeat(place[along], 2))
        series = [(key, which) for key in np.asarray(same[along]) for which in (0, 1)]
        alike = np.array([[one == other for one in series] for other in series])
        np.testing.assert_array_equal(axis.keys[:, None] == axis.keys[None, :], alike)
    assert len(np.unique(axes["temperature"].keys)) == 2 * 2 * 6


def test_size_of_the_noise_is_told_of_the_coordinate_that_it_is_of(four_sweeps):
    problem = four_sweeps
    weighing = Weighing(differs=True, factors=np.array([0.5, 2.0]), p_alike=0.001)
    told = dma_diagnosis._coordinates(problem, weighing)
    coordinates = problem.measured.ravel()
    magnitude = np.concatenate([sweep.data.modulus_magnitude for sweep in problem.sweeps])
    np.testing.assert_allclose(coordinates[told.which == told.names.index("the magnitude")], np.log(magnitude))
    assert told.names[1] == "the phase [rad]" and np.ptp(coordinates[told.which == 1]) < np.pi
    assert told.weighed and told.p_alike == 0.001
    np.testing.assert_array_equal(told.factors, weighing.factors)


def test_a_slip_is_told_with_its_place_in_percent_and_milliradian(four_sweeps, monkeypatch):
    problem = dataclasses.replace(four_sweeps, weights=np.repeat([[50.0, 20.0]], 24, axis=0))
    amount = np.array([50.0 * np.log(0.5), 20.0 * 0.03])
    monkeypatch.setattr(dma_diagnosis, "outlying", lambda *_: ((Outlying(8, amount),), 0.95))
    (told,) = dma_diagnosis._slips(problem)
    # The third row of the second sweep by temperature.
    words = f"{FREQUENCY[2]:.3g} Hz at a, 30.0 degC, of a magnitude -50 % and a phase +30 mrad off what the others say"
    assert told.startswith(f"One reading holds 95 % of the misfit: {words}")


def test_a_fit_says_what_speaks_against_its_numbers(four_sweeps, monkeypatch):
    problem = four_sweeps
    monkeypatch.setattr(dma_diagnosis, "_slips", lambda _: ())
    sure = [
        dataclasses.replace(
            fit, n_agreeing=2, uncertainty=dataclasses.replace(fit.uncertainty, not_identified={}, remarks=())
        )
        for fit in problem.fits
    ]
    assert dma_diagnosis._audit(dataclasses.replace(problem, fits=tuple(sure))) == ()
    alone = dataclasses.replace(sure[0], n_agreeing=1, n_starts=16)
    lost = dataclasses.replace(sure[1], converged=False, status="too many steps")
    loose = dataclasses.replace(
        sure[2], uncertainty=dataclasses.replace(sure[2].uncertainty, remarks=("it is loose.",))
    )
    labels = [fit.sweep.label for fit in problem.fits]
    assert dma_diagnosis._audit(dataclasses.replace(problem, fits=(alone, lost, loose, sure[3]))) == (
        f"{labels[0]}: only one of 16 starts reached the best fit.",
        f"{labels[1]}: too many steps.",
        f"{labels[2]}: it is loose.",
    )


def test_what_a_cause_makes_of_the_solid_is_told_of_its_constants(four_sweeps):
    """An order that is none of the conventional solid, and what it is with the cause in the model."""
    problem = dataclasses.replace(four_sweeps, model=CONVENTIONAL)
    constants = np.array(problem.constants)
    constants[:, 3] = 1.0
    causes = {one.name: one for one in DMA_CAUSES}

    def told(name, strength):
        extended = ExtendedFit(
            (Extension(causes[name], 0.0),), np.array([strength]), np.zeros((1, 2)), constants * [1.1, 1.1, 1.1, 1.0],
            np.zeros(48), np.zeros((48, 1)), (), 0.0, True, "",
        )  # fmt: skip
        return DmaAccount(problem, constants).constants(extended)

    orders = [one for one in told("power-law-relaxation", 0.3) if one.name == "alpha"]
    assert [one.of for one in orders] == [sweep.label for sweep in problem.sweeps]
    assert all((one.without, one.with_causes) == (1.0, pytest.approx(0.7)) for one in orders)
    kept = told("sweep-drift", 0.1)
    assert [one.name for one in kept] == ["M_0", "M_inf", "tau"] * 4
    np.testing.assert_allclose([one.with_causes / one.without for one in kept], 1.1)


def test_constants_without_a_cause_are_told_as_they_were_tested(four_sweeps, monkeypatch):
    """In the likeliest noise, not those of the first fit."""
    problem, asked = four_sweeps, []
    constants = 1.5 * problem.constants
    weighing = Weighing(differs=False, factors=np.ones(2), p_alike=0.5)
    examined = SimpleNamespace(problem=problem, constants=constants, remarks=("a remark",), weighing=weighing)
    monkeypatch.setattr(dma_diagnosis, "dma_problem", lambda *_, **__: problem)
    monkeypatch.setattr(dma_diagnosis, "examine_dma", lambda *_, **__: examined)

    def concluded(given, account, *_, **named):
        asked.append((given, account, named))
        raise InterruptedError

    monkeypatch.setattr(dma_diagnosis, "conclude", concluded)
    data = dma_data(np.ones(3), np.full(3, 20.0), np.ones(3))
    with pytest.raises(InterruptedError):
        dma_diagnosis.diagnose_dma(data, level=0.01, seed=4)
    ((given, account, named),) = asked
    assert given is examined and account.null is constants and "a remark" in named["audit"]
    assert (named["level"], named["seed"], named["replicates"]) == (0.01, 4, 2000)


def test_levels_are_geometric_means_of_sweeps_and_ends_are_those_of_all_rows(four_sweeps):
    problem = four_sweeps
    at = problem.conditions
    sizes = np.concatenate([sweep.data.modulus_magnitude for sweep in problem.sweeps])
    for number, sweep in enumerate(problem.sweeps):
        mean = np.prod(sweep.data.modulus_magnitude) ** (1.0 / 6.0)
        np.testing.assert_allclose(np.asarray(at.level)[np.asarray(at.sweep) == number], mean)
    assert (float(at.softest), float(at.stiffest)) == (sizes.min(), sizes.max())
    assert (float(at.lowest), float(at.highest)) == pytest.approx((0.2 * np.pi, 200.0 * np.pi))


def test_corrections_of_no_name_act_where_their_words_say():
    """Three sweeps of magnitude and phase; the modulus falls to a half and a quarter from one to the next."""
    frequency, sweep = np.repeat(np.tile(FREQUENCY, 3), 2), np.repeat([0, 1, 2], 12)
    temperature, coordinate = np.array([20.0, 40.0, 60.0])[sweep], np.tile([0, 1], 18)
    one = blind.solid(np.array([[1e3, 2e3, 0.01, 0.5]]), 2.0 * np.pi * frequency)[0]
    times = np.tile(np.repeat(np.linspace(0.0, 1.0, 6), 2), 3), np.repeat([0.1, 0.4, 1.0], 12)
    found, places = dma_free_forms(
        frequency, temperature, sweep, coordinate, ("cold", "warm", "hot"), one / 2.0**sweep, times
    )
    forms = {each.name: each.directions for each in found}
    words = {place.name: place.words for place in places}
    assert len(forms) == len(found) and list(forms) == list(words)
    for number, label in enumerate(("cold", "warm", "hot")):
        own = forms[f"sweep-{number}-{COARSE:g}"]
        assert words[f"sweep-{number}-{COARSE:g}"] == f"in the sweep {label} alone"
        assert not np.any(own[sweep != number]) and np.all(np.any(own[sweep == number] != 0.0, axis=1))
    alike, trend = forms[f"smooth-{COARSE:g}"], forms[f"trend-{COARSE:g}"]
    np.testing.assert_array_equal(alike[sweep == 0], alike[sweep == 2])
    np.testing.assert_allclose(trend, np.array([-1.0, 0.0, 1.0])[sweep][:, None] * alike, atol=1e-12)
    for which, quantity in enumerate(("magnitude", "phase")):
        name = f"line-{FREQUENCY[2]:.4g}-{quantity}"
        expected = np.isclose(frequency, FREQUENCY[2]) & (coordinate == which)
        np.testing.assert_array_equal(forms[name][:, 0], expected.astype(float))
        assert words[name] == f"in the {quantity} at {FREQUENCY[2]:.3g} Hz in all sweeps"
    # Along times of the visit and of the drying: the same where these are the same, whatever the frequency.
    for name, time in (("time-in-visit", times[0]), ("time-of-drying", times[1])):
        for value in np.unique(time):
            rows = forms[name][(time == value) & (coordinate == 0)]
            assert np.all(rows == rows[0])
        first, last = (forms[name][np.flatnonzero(time == end)[0]] for end in (time.min(), time.max()))
        assert np.max(np.abs(first - last)) > 0.1
    # A stiffness that is added changes the softest most, a force the stiffest.
    for name, factor in (("added-smooth", 2.0), ("force-smooth", 0.5), ("factor-power", 1.0)):
        np.testing.assert_allclose(forms[name][sweep == 1], factor * forms[name][sweep == 0], atol=1e-12)
    # A stiffness in phase with the strain, in proportion to frequency, over the modulus: real part and imaginary part.
    added, part = forms["added-power"][:, 0], frequency / (one / 2.0**sweep)
    expected = np.where(coordinate == 0, part.real, part.imag)
    np.testing.assert_allclose(added, expected * added[0] / expected[0], rtol=1e-9)
