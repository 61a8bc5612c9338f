"""What is left out for the gain, and what a score is worth."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from inverse.datasets.dma import read_dma
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.dma import gain as gain_module
from inverse.diagnosis.dma import problem as dma_problem_module
from inverse.diagnosis.dma.diagnosis import repeats_of
from inverse.diagnosis.dma.extended_fit import Refit
from inverse.diagnosis.dma.gain import _Fold, _folds, _score, held_out_gain, sample_groups, temperature_groups
from inverse.diagnosis.dma.problem import DmaProblem, dma_problem
from inverse.diagnosis.gain import root_mean_square, summed_up
from inverse.diagnosis.noise import Noise, noise_family, series
from inverse.dma_fit import FRACTIONAL
from tests.blind import dma_generator as blind

DRIFT = next(cause for cause in DMA_CAUSES if cause.name == "sweep-drift")


def measured(folder, **hidden):
    blind.write(folder / "data.csv", folder / "key.json", **hidden)
    return read_dma(folder / "data.csv")


@pytest.fixture(scope="module")
def drifting(tmp_path_factory):
    data = measured(tmp_path_factory.mktemp("drift"), seed=311, name="sweep-drift", d_prime=12.0)
    return dma_problem(data, FRACTIONAL)


def white(problem):
    return noise_family(problem.orderings(), problem.frequencies())[0]


def test_each_temperature_is_left_out_in_turn(drifting):
    folds, split = _folds(drifting, 1)
    temperature = temperature_groups(drifting)
    assert len(np.unique(temperature)) == 5 and "5 temperatures" in split
    scored = sum(fold.scored.astype(int) for fold in folds)
    np.testing.assert_array_equal(scored, 1)
    for fold in folds:
        assert len(np.unique(temperature[fold.scored])) == 1
        # Neither the strength nor the constants have seen what is scored, nor the strength anything of its temperature.
        assert not np.any(fold.scored & (fold.strength | fold.constants))
        assert not np.any(fold.strength & (temperature == temperature[fold.scored][0]))


def test_each_sample_is_left_out_in_turn_where_there_are_enough(drifting):
    """Two temperatures each, which are too few to be left out."""
    sweeps = tuple(
        dataclasses.replace(sweep, sample=f"sample {index}", temperature_c=40.0 + 10.0 * (index % 2))
        for index, sweep in enumerate(drifting.sweeps)
    )
    problem = dataclasses.replace(drifting, sweeps=sweeps)
    folds, split = _folds(problem, 1)
    assert split.startswith("5 samples, each left out in turn")
    np.testing.assert_array_equal(sum(fold.scored.astype(int) for fold in folds), 1)
    sample = sample_groups(problem)
    for fold in folds:
        (left_out,) = np.unique(sample[fold.scored])
        assert not np.any(fold.scored & fold.constants) and not np.any(fold.strength & (sample == left_out))
    one_sample = dataclasses.replace(problem, sweeps=tuple(dataclasses.replace(one, sample="a") for one in sweeps))
    assert "left out of all sweeps" in _folds(one_sample, 1)[1]


def test_gain_of_the_hidden_cause_and_none_of_one_that_is_not_there(drifting):
    """The strength told by four temperatures predicts the fifth down to the noise."""
    gain = held_out_gain(drifting, (Extension(DRIFT, 0.0),), white(drifting), np.array([0.05]), library=(DRIFT,))
    assert gain is not None and gain.log_score_gain > 0.0 and gain.unfinished == 0
    assert gain.rmse_after < gain.rmse_before
    assert gain.rmse_after == pytest.approx(blind.NOISE, rel=0.6)


def test_scores_of_folds_are_summed_up_by_hand():
    """Three folds of 2, 2 and 4 data, the first two of one group: 4 nat on 8 data, by groups 1 and 0 on each."""
    before = [(np.full(2, 0.1), -3.0), (np.full(2, -0.1), 1.0), (np.full(4, 0.1), 2.0)]
    after = [(np.full(2, 0.02), 0.0), (np.full(2, -0.02), 2.0), (np.array([0.04, -0.04, 0.04, 0.04]), 2.0)]
    found = summed_up("by halves", before, after, [7, 7, 9], 2)
    assert (found.split, found.unfinished) == ("by halves", 2)
    assert found.log_score_gain == pytest.approx(4.0 / 8.0)
    # Of two numbers, 1 and 0, the deviation is 1 / sqrt(2), and that of their mean a half.
    assert found.standard_error == pytest.approx(0.5)
    assert found.rmse_before == pytest.approx(0.1) and found.rmse_before_error == pytest.approx(0.0, abs=1e-12)
    assert found.rmse_after == pytest.approx(np.sqrt(0.5 * (0.02**2 + 0.04**2)))
    # Squares of the groups differ by 12e-4; half of that is the error of their mean, over twice the root.
    assert found.rmse_after_error == pytest.approx(0.5 * 12e-4 / (2.0 * found.rmse_after))


def bare(kind, **fields):
    made = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


def test_score_is_the_normal_density_of_what_was_left_out_by_the_noise_of_what_was_fitted():
    """Five rows of magnitude and phase, the last row scored; in noise three times louder from the fourth row on."""
    weights = np.repeat([[10.0, 5.0]], 5, axis=0)
    plain = np.array([0.3, -0.2, 0.5, 0.1, -0.4, 0.2, 0.9, -0.6, 1.2, -0.3])
    louder = np.where(np.arange(10) < 6, 1.0, 3.0)
    noise = Noise(0.0, series("frequency", [0] * 10, np.arange(10.0)), np.log(louder), -2.5, 3.0, 3.5)
    problem = bare(DmaProblem, weights=weights)
    refit = bare(Refit, problem=problem, plain=lambda unknowns: plain + unknowns[0], _moved=np.arange(3))
    last = np.arange(5) == 4
    relative, density = _score(refit, noise, np.zeros(1), _Fold(last, ~last, ~last, 0.0))
    # Eight numbers were fitted by three.
    size = np.sqrt(np.sum((plain[:8] / louder[:8]) ** 2) / 5.0)
    assert density == pytest.approx(np.sum(stats.norm.logpdf(plain[8:], scale=3.0 * size)))
    np.testing.assert_allclose(relative, plain[8:] / [10.0, 5.0])


def test_error_of_a_root_mean_square_is_that_of_its_scatter():
    """Of Gaussian numbers it is one over the root of twice their number; from forty blocks, known to a tenth each."""
    rng = np.random.default_rng(1)
    told = [root_mean_square(np.split(rng.standard_normal(800), np.arange(10, 800, 20))) for _ in range(50)]
    assert np.mean([error for _, error in told]) == pytest.approx(1.0 / np.sqrt(2.0 * 800), rel=0.06)
    assert np.mean([value for value, _ in told]) == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * 800 * 50))


def test_frequencies_are_left_out_where_temperatures_are_few(tmp_path):
    data = measured(tmp_path, seed=312, name="sweep-drift", d_prime=12.0)
    few = data.select(np.flatnonzero(data.temperature_c < 60.0))
    problem = dma_problem(few, FRACTIONAL)
    folds, split = _folds(problem, 1)
    assert "left out of all sweeps" in split
    assert all(np.array_equal(fold.strength, fold.constants) for fold in folds)
    gain = held_out_gain(problem, (Extension(DRIFT, 0.0),), white(problem), np.array([0.05]), library=(DRIFT,))
    assert gain is not None and np.isfinite(gain.log_score_gain)


def test_repeats_at_not_quite_the_same_frequency_are_no_frequencies_more(tmp_path):
    """Six frequencies four times each, 0.02 % apart: a block left out must leave more distinct ones than constants.

    Counted by rounding, blocks were left out that left four or even three, and a fit to three is refused.
    """
    data = measured(tmp_path, seed=312, name="sweep-drift", d_prime=12.0)
    chosen = np.unique(data.frequency_hz)[[0, 3, 6, 9, 12, 13]]
    rows = np.tile(np.flatnonzero(np.isin(data.frequency_hz, chosen) & (data.temperature_c < 60.0)), 4)
    apart = np.random.default_rng(1).uniform(-2e-4, 2e-4, len(rows))
    data = data.select(rows)
    problem = dma_problem(dataclasses.replace(data, frequency_hz=data.frequency_hz * (1.0 + apart)), FRACTIONAL)
    sweep, omega = np.asarray(problem.conditions.sweep), np.asarray(problem.conditions.angular_frequency)
    folds = _folds(problem, 1)[0]
    assert len(folds) == 4
    for fold in folds:
        apart = [np.diff(np.sort(np.log(omega[fold.constants & (sweep == one)]))) for one in np.unique(sweep)]
        assert min(1 + np.sum(steps > 1e-3) for steps in apart) == 5
    assert repeats_of(problem).freedom == 2 * 3 * 6 * len(problem.sweeps)


def test_one_group_has_no_scatter_to_tell_an_error_from(drifting):
    """Of four temperatures one alone has the higher frequencies: all that could be left out is at that one."""
    sweep, omega = np.asarray(drifting.conditions.sweep), np.asarray(drifting.conditions.angular_frequency)
    alone = [_Fold(sweep == 0, omega < cut, sweep != 0, 0.0) for cut in np.quantile(omega, (0.5, 0.7, 0.9))]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gain_module, "_folds", lambda *_: (alone, "of one group"))
        assert held_out_gain(drifting, (Extension(DRIFT, 0.0),), white(drifting), np.array([0.05])) is None


def test_samples_at_about_the_same_temperature_are_left_out_together(drifting):
    shifted = tuple(
        dataclasses.replace(sweep, temperature_c=sweep.temperature_c + 0.3 * (index % 2))
        for index, sweep in enumerate((drifting.sweeps[0], drifting.sweeps[0], *drifting.sweeps[2:]))
    )
    groups = temperature_groups(dataclasses.replace(drifting, sweeps=shifted))
    sweep = np.asarray(drifting.conditions.sweep)
    assert np.all(groups[sweep == 0][0] == groups[sweep == 1]) and len(np.unique(groups)) == 4


@pytest.mark.parametrize("lost", ["constants", "strength"])
def test_a_refit_that_folds_share_counts_once(drifting, monkeypatch, lost):
    """Of five temperatures in five blocks each, one refit of constants, or of the strength, that did not converge."""
    asked = {"constants": [], "strength": []}

    def solved(self, strengths, used, constants=None):
        del strengths, constants
        kind = "strength" if self.extensions else "constants"
        asked[kind].append(used.tobytes())
        return np.zeros(0), not (kind == lost and len(asked[kind]) == 1), ""

    monkeypatch.setattr(gain_module.Refit, "solve", solved)
    monkeypatch.setattr(gain_module.Refit, "solve_constants", lambda *_, **__: (np.zeros(0), True, ""))
    monkeypatch.setattr(gain_module.Refit, "own_constants", lambda *_: np.zeros(0))
    monkeypatch.setattr(gain_module, "_score", lambda *_: (np.ones(2), 0.0))
    gain = held_out_gain(drifting, (Extension(DRIFT, 0.0),), white(drifting), np.array([0.05]), library=(DRIFT,))
    assert gain is not None and gain.unfinished == 1
    assert (len(asked["constants"]), len(asked["strength"])) == (5, 5)


def test_starts_of_held_out_fits_are_of_the_seed(tmp_path, monkeypatch):
    problem = dma_problem(measured(tmp_path, seed=313), FRACTIONAL, seed=7)
    seeds, fit_sweeps = [], dma_problem_module.fit_sweeps
    monkeypatch.setattr(
        dma_problem_module, "fit_sweeps", lambda *a, seed=0, **k: seeds.append(seed) or fit_sweeps(*a, seed=seed, **k)
    )
    problem.moved_by(np.asarray(problem.conditions.angular_frequency) > 2.0)
    assert seeds == [7]
