"""Readings that hold the misfit by themselves."""

import numpy as np
import pytest

from inverse.datasets.dma import dma_data
from inverse.diagnosis.dma import diagnosis as dma_diagnosis
from inverse.diagnosis.dma.problem import dma_problem
from inverse.diagnosis.outlying import outlying, said_of
from inverse.dma_fit import FRACTIONAL
from tests.blind import dma_generator as blind

ROWS = 40
READING = np.repeat(np.arange(ROWS), 2)
FITTED = np.random.default_rng(1).standard_normal((2 * ROWS, 9))


def left_of(data):
    return data - FITTED @ np.linalg.lstsq(FITTED, data)[0]


@pytest.mark.parametrize("wrong", [(), (7,), (7, 30), (7, 30, 31), (1, 7, 30, 31)])
def test_readings_that_are_off_are_found_with_what_they_are_off_by(wrong):
    """Of up to three; what four have in common is no slip. What the fit took of them is given back."""
    data = 0.01 * np.random.default_rng(2).standard_normal(2 * ROWS)
    for place in wrong:
        data[2 * place : 2 * place + 2] += [0.7, -0.2]
    found, share = outlying(left_of(data), FITTED, READING)
    assert sorted(one.reading for one in found) == ([] if len(wrong) > 3 else list(wrong))
    assert (share > 0.9) == bool(found)
    others = ~np.isin(READING, [one.reading for one in found])
    fit = np.linalg.lstsq(FITTED[others], data[others])[0]
    for one in found:
        np.testing.assert_allclose(one.amount, (data - FITTED @ fit)[READING == one.reading], rtol=1e-9)


def test_noise_of_heavy_tails_and_what_bends_are_no_slips():
    rng = np.random.default_rng(3)
    assert not any(outlying(left_of(rng.standard_t(4, 2 * ROWS)), FITTED, READING)[0] for _ in range(100))
    bent = np.repeat(np.linspace(0.0, 1.0, ROWS) ** 4, 2)
    assert outlying(left_of(bent), FITTED, READING) == ((), 0.0)


def test_what_is_believed_is_no_reading_and_few_data_accuse_none():
    data = left_of(np.eye(2 * ROWS)[5])
    assert outlying(data, FITTED, np.where(READING == 2, -1, READING)) == ((), 0.0)
    few = slice(0, 20)
    assert outlying(data[few], FITTED[few], READING[few]) == ((), 0.0)
    assert outlying(np.zeros(2 * ROWS), FITTED, READING) == ((), 0.0)


def test_a_reading_of_twice_the_modulus_is_named(tmp_path):
    frequency, temperature = np.tile(np.geomspace(0.1, 100.0, 10), 4), np.repeat([20.0, 30.0, 40.0, 50.0], 10)
    modulus = blind.solid(np.tile([[1e3, 2e3, 0.01, 0.5]], (4, 1)), 2.0 * np.pi * frequency[:10]).ravel()
    modulus = modulus * np.exp(0.01 * np.random.default_rng(2).standard_normal(40))
    modulus[23] *= 2.0
    problem = dma_problem(dma_data(frequency, temperature, np.stack([modulus.real, modulus.imag], axis=-1)), FRACTIONAL)
    said = [one for one in dma_diagnosis._audit(problem) if "slip" in one]
    assert len(said) == 1 and "1 Hz at 40.0 degC, of a magnitude +98" in said[0] and "mrad off" in said[0]
    assert said_of([], 0.0) == () and "2 readings together hold 95 %" in said_of(["a", "b"], 0.95)[0]
