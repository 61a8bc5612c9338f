"""Noise of magnitude and phase of unequal size: found, weighed by, and left alone where it cannot be told."""

import dataclasses

import numpy as np
import pytest
from scipy import optimize

import inverse
from inverse.datasets.dma import read_dma
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.cause import every_shape
from inverse.diagnosis.dma.problem import dma_problem
from inverse.diagnosis.dma.weighing import weighed_by_noise
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL
from tests.blind import dma_generator as blind

SEED = blind.TEST_SEEDS + 7300
TRUE = {seed: np.array(blind.parts_of(blind.UNEQUAL, seed)) for seed in range(SEED, SEED + 6)}


def made(folder, seed, **hidden):
    blind.write(folder / "data.csv", folder / "key.json", seed=seed, **hidden)
    return folder / "data.csv"


def weighed(file, model=FRACTIONAL):
    problem = dma_problem(read_dma(file), model)
    return problem, *weighed_by_noise(problem, problem.directions(every_shape(DMA_CAUSES)))


@pytest.mark.parametrize("seed", TRUE)
def test_the_sizes_of_magnitude_and_phase_are_found(seed, tmp_path):
    """About 90 of 140 numbers tell them, so that the logarithm of their ratio is known to 0.15: 3.5 of these."""
    problem, after, found = weighed(made(tmp_path, seed, noise=blind.UNEQUAL))
    assert found.differs and found.p_alike < 1e-4
    assert np.log(found.factors / TRUE[seed]) == pytest.approx(np.zeros(2), abs=3.5 * 0.5 * 0.15)
    assert np.prod(found.factors) == pytest.approx(1.0)
    assert np.array_equal(after.weights, 1.0 / np.tile(found.factors, (problem.rows, 1)))
    assert {tuple(one) for one in TRUE.values()} == {(0.5, 2.0), (2.0, 0.5)}


def test_the_ratio_is_the_likeliest_by_an_independent_optimiser(tmp_path):
    """Restricted likelihood of two variances, the mean's directions those of the constants."""
    problem = dma_problem(read_dma(made(tmp_path, SEED, noise=blind.UNEQUAL)), FRACTIONAL)
    _, found = weighed_by_noise(problem, [])
    fitted, residuals = np.linalg.qr(problem.fitted_directions())[0], problem.residuals()
    left = np.linalg.svd(fitted)[0][:, fitted.shape[1] :]
    contrasts = left.T @ residuals

    def cost(log_sizes):
        covariance = left.T @ (np.tile(np.exp(2.0 * log_sizes), problem.rows)[:, None] * left)
        return 0.5 * (np.linalg.slogdet(covariance)[1] + contrasts @ np.linalg.solve(covariance, contrasts))

    best = optimize.minimize(cost, np.log([0.02, 0.02]), method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9})
    assert found.factors[0] / found.factors[1] == pytest.approx(np.exp(best.x[0] - best.x[1]), rel=1e-3)


def test_of_equal_noise_of_magnitudes_alone_of_few_readings_and_of_gross_effects_nothing_is_weighed(tmp_path):
    problem, after, found = weighed(made(tmp_path, SEED))
    assert after is problem and not found.differs and np.array_equal(found.factors, np.ones(2))
    file = made(tmp_path, SEED, noise=blind.UNEQUAL)
    data = read_dma(file)
    alone = dma_problem(dataclasses.replace(data, storage_modulus=None, loss_modulus=None), FRACTIONAL)
    assert weighed_by_noise(alone, alone.directions(every_shape(DMA_CAUSES)))[0] is alone
    few = data.select(np.flatnonzero(np.isin(data.frequency_hz, np.unique(data.frequency_hz)[::3])))
    sparse = dma_problem(few, FRACTIONAL)
    assert weighed_by_noise(sparse, sparse.directions(every_shape(DMA_CAUSES)))[0] is sparse
    problem, after, found = weighed(file, CONVENTIONAL)  # of which a fractional solid is far
    assert after is problem and not found.differs


def test_an_effect_is_no_noise(tmp_path):
    """A delay of d' 9 is in the phase alone; what causes can take is taken off before sizes are compared."""
    problem, after, found = weighed(made(tmp_path, SEED, name="phase-delay", d_prime=9.0))
    assert after is problem and not found.differs


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
    assert noise.weighed and noise.p_sizes < 1e-4 and sizes == pytest.approx(blind.NOISE * TRUE[seed], rel=0.4)
    assert noise.size == pytest.approx(np.sqrt(np.prod(sizes)), rel=0.1)
    words = noise.describe()
    assert "each weighing by its own" in words and "tails" not in words
