"""Noise of magnitude and phase of unequal size: found, weighed by, and left alone where it cannot be told."""

import dataclasses

import numpy as np
import pytest
from scipy import optimize

import inverse
from inverse.datasets.dma import read_dma
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.cause import every_shape
from inverse.diagnosis.dma import examination, weighing
from inverse.diagnosis.dma.problem import dma_problem
from inverse.diagnosis.noise import noise_family
from inverse.diagnosis.screening import Alternative
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL
from tests.blind import dma_generator as blind

SEED = blind.TEST_SEEDS + 7300
TRUE = {seed: np.array(blind.parts_of(blind.UNEQUAL, seed)) for seed in range(SEED, SEED + 6)}


def made(folder, seed, **hidden):
    blind.write(folder / "data.csv", folder / "key.json", seed=seed, **hidden)
    return folder / "data.csv"


def weighed_by(problem, effects):
    family = noise_family(problem.orderings(), problem.frequencies())
    return weighing.weighed_by_noise(problem, effects, examination._likeliest(problem, family))


def weighed(file, model=FRACTIONAL):
    problem = dma_problem(read_dma(file), model)
    return problem, *weighed_by(problem, problem.directions(every_shape(DMA_CAUSES)))


@pytest.mark.parametrize("seed", TRUE)
def test_the_sizes_of_magnitude_and_phase_are_found(seed, tmp_path):
    """About 90 of 140 numbers tell them, so that the logarithm of their ratio is known to 0.15: 3.5 of these."""
    problem, after, found = weighed(made(tmp_path, seed, noise=blind.UNEQUAL))
    assert found.differs and found.p_alike == 0.001
    assert np.log(found.factors / TRUE[seed]) == pytest.approx(np.zeros(2), abs=3.5 * 0.5 * 0.15)
    assert np.prod(found.factors) == pytest.approx(1.0)
    assert np.array_equal(after.weights, 1.0 / np.tile(found.factors, (problem.rows, 1)))
    assert {tuple(one) for one in TRUE.values()} == {(0.5, 2.0), (2.0, 0.5)}


def test_the_ratio_is_the_likeliest_by_an_independent_optimiser(tmp_path, monkeypatch):
    """Restricted likelihood of two variances, the mean's directions those of the constants, every square counted."""
    monkeypatch.setattr(weighing, "_OUTLYING", 1e3)
    monkeypatch.setattr(weighing, "_COUNTED", 1.0)
    problem = dma_problem(read_dma(made(tmp_path, SEED, noise=blind.UNEQUAL)), FRACTIONAL)
    white = noise_family(problem.orderings(), problem.frequencies())[0]
    _, found = weighing.weighed_by_noise(problem, [], white)
    fitted, residuals = np.linalg.qr(problem.fitted_directions())[0], problem.residuals()
    left = np.linalg.svd(fitted)[0][:, fitted.shape[1] :]
    contrasts = left.T @ residuals

    def cost(log_sizes):
        covariance = left.T @ (np.tile(np.exp(2.0 * log_sizes), problem.rows)[:, None] * left)
        return 0.5 * (np.linalg.slogdet(covariance)[1] + contrasts @ np.linalg.solve(covariance, contrasts))

    best = optimize.minimize(cost, np.log([0.02, 0.02]), method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-10})
    assert found.factors[0] / found.factors[1] == pytest.approx(np.exp(best.x[0] - best.x[1]), rel=1e-4)


def test_a_size_is_that_of_normal_numbers_and_slips_do_not_change_it():
    drawn = np.random.default_rng(1).standard_normal((20000, 2))
    drawn[:200, 1] = 50.0
    free = np.full(20000, 0.5)
    size = weighing._robust_size(np.sqrt(0.5) * 3.0 * drawn, free, 1e-9)
    # 1 of 100 that count as 4 of 0.77: 2.6 % of the variance that is counted, of which more is then below the bound.
    assert size[0] == pytest.approx(3.0, rel=0.02) and size[0] < size[1] < 1.06 * size[0]


def test_without_a_part_it_is_as_without_its_rows(tmp_path):
    problem = dma_problem(read_dma(made(tmp_path, SEED)), FRACTIONAL)
    directions, which = problem.fitted_directions(), np.tile(np.arange(2), problem.rows)
    data = np.random.default_rng(1).standard_normal((len(which), 4))
    parts = weighing._parts(problem)
    assert len(parts) == 14 + 5
    ratios = []
    for part in parts:
        kept = np.setdiff1d(np.arange(len(which)), part)
        across = weighing._across(directions[kept])
        magnitude, phase = weighing._sizes(across @ data[kept], np.diagonal(across), which[kept], 1e-3)
        ratios.append(np.log(magnitude / phase))
    each = np.stack(ratios)
    each -= np.median(each[:, 1:], axis=1, keepdims=True)
    expected = np.where(each.min(axis=0) > 0, each.min(axis=0), np.where(each.max(axis=0) < 0, -each.max(axis=0), 0.0))
    unlike = weighing._unlike(data, weighing._across(directions), which, parts)
    assert unlike == pytest.approx(expected, abs=1e-9)


def test_nothing_is_weighed_where_noise_is_equal_or_sizes_cannot_be_told(tmp_path, monkeypatch):
    problem, after, found = weighed(made(tmp_path, SEED))
    assert after is problem and not found.differs and np.array_equal(found.factors, np.ones(2)) and found.p_alike > 0.01
    file = made(tmp_path, SEED, noise=blind.UNEQUAL)
    data = read_dma(file)
    alone = dma_problem(dataclasses.replace(data, storage_modulus=None, loss_modulus=None), FRACTIONAL)
    assert weighed_by(alone, alone.directions(every_shape(DMA_CAUSES)))[0] is alone
    one = data.select(np.flatnonzero(data.temperature_c == data.temperature_c.min()))
    few = dma_problem(one.select(np.arange(8)), FRACTIONAL)  # 16 numbers, four constants
    after, found = weighed_by(few, few.directions(every_shape(DMA_CAUSES)))
    assert after is few and not found.differs and np.isnan(found.p_alike)
    problem, after, found = weighed(file, CONVENTIONAL)  # of which a fractional solid is far
    assert after is problem and not found.differs and np.isnan(found.p_alike)
    monkeypatch.setattr(weighing, "_TURNS", 1)
    problem, after, found = weighed(file)
    assert after is problem and not found.differs and found.p_alike < 0.01


@pytest.mark.parametrize("hidden", [{"name": "phase-delay"}, {"name": "smooth"}, {"name": "mains"}, {"name": "bump"}])
def test_an_effect_is_no_noise(hidden, tmp_path):
    problem, after, found = weighed(made(tmp_path, SEED, d_prime=9.0, **hidden))
    assert after is problem and not found.differs


def test_a_slip_is_no_noise(tmp_path):
    file = made(tmp_path, SEED)
    data = read_dma(file)
    for row in (3, 40):
        factor = np.where(np.arange(len(data)) == row, 1.5, 1.0)
        scaled = {
            name: factor * getattr(data, name) for name in ("modulus_magnitude", "storage_modulus", "loss_modulus")
        }
        off = dataclasses.replace(data, **scaled)
        problem = dma_problem(off, FRACTIONAL)
        after, found = weighed_by(problem, problem.directions(every_shape(DMA_CAUSES)))
        assert after is problem and not found.differs


def test_a_direction_that_is_not_finite_is_left_out(tmp_path):
    problem = dma_problem(read_dma(made(tmp_path, SEED, noise=blind.UNEQUAL)), FRACTIONAL)
    broken = Alternative("broken", np.full((problem.weights.size, 1), np.nan))
    assert np.array_equal(weighed_by(problem, [broken])[1].factors, weighed_by(problem, [])[1].factors)


def test_stated_deviations_keep_their_unit(tmp_path):
    """Those of the file, 1.3 times too small, times what the sizes differ by."""
    file = made(tmp_path, SEED, noise=blind.UNEQUAL)
    data = read_dma(file)
    modulus = np.hypot(data.storage_modulus, data.loss_modulus)
    stated = dataclasses.replace(data, storage_modulus_sd=0.01 * modulus, loss_modulus_sd=0.01 * modulus)
    problem = dma_problem(stated, FRACTIONAL)
    after, found = weighed_by(problem, [])
    assert problem.stated_deviations and found.differs
    np.testing.assert_allclose(after.weights, problem.weights / found.factors)


def test_a_fit_that_fails_weighs_both_alike(tmp_path, monkeypatch):
    problem = dma_problem(read_dma(made(tmp_path, SEED, noise=blind.UNEQUAL)), FRACTIONAL)
    refit = examination.fit_extended

    def failing(given, extensions, *rest, **options):
        found = refit(given, extensions, *rest, **options)
        return found if extensions else dataclasses.replace(found, converged=False, status="it failed")

    monkeypatch.setattr(examination, "fit_extended", failing)
    found = examination.examine_dma(problem, DMA_CAUSES[:2], np.random.default_rng(1))
    assert found.problem is problem and not found.weighing.differs
    assert any("of unlike noise" in one and "(it failed)" in one for one in found.remarks)
    np.testing.assert_array_equal(found.residuals, problem.residuals())


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    quiet = next(seed for seed, parts in TRUE.items() if parts[0] < 1.0)
    file = made(tmp_path_factory.mktemp("unequal"), quiet, name="bath-viscosity", d_prime=6.0, noise=blind.UNEQUAL)
    return inverse.diagnose(file, gain=False), quiet


def test_a_cause_is_found_in_noise_of_unequal_sizes_and_the_report_says_how_it_was_weighed(diagnosed):
    found, seed = diagnosed
    assert "bath-viscosity" in (*found.details.named, *(name for one in found.details.confusable for name in one))
    noise = found.details.noise
    sizes = np.array(list(noise.sizes.values()))
    assert noise.weighed and noise.p_sizes == 0.001 and sizes == pytest.approx(blind.NOISE * TRUE[seed], rel=0.4)
    assert noise.size == pytest.approx(np.sqrt(np.prod(sizes)), rel=0.1)
    words = noise.describe()
    assert "each weighing by its own" in words and "tails" not in words
