"""What a cause is worth on sonications, or blocks of one, that the fit did not see."""

import dataclasses

import numpy as np
import pytest
from scipy import linalg, stats

from inverse.diagnosis.hmi import gain
from inverse.diagnosis.hmi.courses import HmiRows
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.gain import _folds, _score, held_out_gain_hmi
from inverse.diagnosis.hmi.refit import fit_hmi
from inverse.diagnosis.noise import Noise, series
from tests.inverse.diagnosis.hmi.cases import bare, fitted_with, measured_with, white

NOISE = 0.005


def of_one_sonication(problem, count):
    """The first readings, as if there were no others."""
    rows = problem.rows
    kept = {
        field.name: value[:count] if isinstance(value := getattr(rows, field.name), np.ndarray) else value
        for field in dataclasses.fields(rows)
    }
    return dataclasses.replace(problem, rows=dataclasses.replace(rows, **kept | {"labels": ("1",)}))


def test_the_cause_that_is_there_predicts_the_sonication_that_is_left_out(problem):
    fit = fitted_with(problem, "output-drift", 2.0, NOISE)
    null = fit_hmi(fit.problem, (), white(fit.problem), size=NOISE)
    found = held_out_gain_hmi(white(fit.problem), size=NOISE, null=null, extended=fit)
    assert found is not None and found.unfinished == 0
    assert found.split.startswith("each of 2 sonications left out in turn, its own factor")
    # What is left is noise: a root mean square of 26 such is known to 14 %, constants and factors add to it.
    assert 0.5 * NOISE < found.rmse_after < 2.0 * NOISE < found.rmse_before
    assert found.log_score_gain > 0.0


def test_score_is_the_density_of_contrasts_within_the_sonication(problem):
    """Whatever its factor is: differences of its readings have a normal density of the noise of the others."""
    hidden, _ = measured_with(problem, None, 0.0, noise=NOISE, seed=2)
    left_out = hidden.rows.sonication == 1
    fit = fit_hmi(hidden, (), white(hidden), size=NOISE, used=~left_out)
    _, density = _score(fit, white(hidden), left_out)
    raw, used = hidden.residuals(fit.unknowns), fit.of_readings[~left_out]
    deviation = np.sqrt(used @ used / fit.freedom)
    contrasts = linalg.helmert(int(np.sum(left_out))) @ raw[left_out]
    assert density == pytest.approx(float(np.sum(stats.norm.logpdf(contrasts, scale=deviation))), rel=1e-9)
    # A constant that only its belief tells takes no reading; counted so, thirteen readings would leave fewer.
    assert fit.freedom > np.sum(~left_out) - 1 - len(hidden.program.constants)


@pytest.mark.parametrize("count", [6, 11, 13])
def test_every_reading_of_one_sonication_is_left_out_once(problem, count):
    parts, split = _folds(of_one_sonication(problem, count))
    assert split.startswith("5 blocks of neighbouring temperatures")
    np.testing.assert_array_equal(np.sum(parts, axis=0), np.ones(count))


def test_a_sonication_of_two_readings_is_never_left_out_and_that_is_said(problem):
    rows = problem.rows
    sonication = np.where(np.arange(len(rows)) < 2, 2, rows.sonication)
    three = dataclasses.replace(rows, sonication=sonication, labels=("1", "2", "3"))
    parts, split = _folds(dataclasses.replace(problem, rows=three))
    assert len(parts) == 2 and not any(np.any(part[:2]) for part in parts)
    assert split.startswith("each of 2 sonications left out in turn (1 more with 2 readings or fewer never)")


class Linear:
    """One sonication whose weighted residuals are known, with readings of weights that differ."""

    def __init__(self, temperature, raw, weights):
        count = len(temperature)
        at, none = np.asarray(temperature), np.zeros(count, dtype=int)
        self.rows = HmiRows(np.zeros(count), none, ("1",), at, at, none > 0, None, np.arange(count))
        self.raw, self.weights = raw, weights

    def residuals(self, _):
        return self.raw


def test_score_of_a_block_has_the_factor_and_the_noise_of_the_readings_in_use():
    """Three times louder noise above the middle; what is left out tells nothing of the factor."""
    rng, weights = np.random.default_rng(3), np.linspace(20.0, 60.0, 12)
    temperature, left_out = np.linspace(37.0, 80.0, 12), np.isin(np.arange(12), [4, 5, 8])
    scale = np.where(temperature < 60.0, 1.0, 3.0)
    noise = Noise(0.0, series("time", [0] * 12, temperature), np.log(scale), 0.0, 3.0, 60.0)
    problem = Linear(temperature, weights * 0.05 + scale * rng.standard_normal(12), weights)
    factor = np.linalg.lstsq((weights / scale)[~left_out, None], (problem.raw / scale)[~left_out])[0][0]
    rest = problem.raw - factor * weights
    fit = bare(HmiFit, problem=problem, unknowns=np.zeros(0), residuals=rest, freedom=6.0)
    relative, density = _score(fit, noise, left_out)
    np.testing.assert_allclose(relative, (rest / weights)[left_out], rtol=1e-12)
    deviation = np.sqrt(np.sum((rest / scale)[~left_out] ** 2) / 6.0) * scale[left_out]
    assert density == pytest.approx(float(np.sum(stats.norm.logpdf(rest[left_out], scale=deviation))), rel=1e-12)


def test_refits_that_did_not_converge_are_counted(problem, monkeypatch):
    asked = []

    def refitted(*_, used, **__):
        asked.append(used)
        return bare(HmiFit, converged=len(asked) != 3)

    monkeypatch.setattr(gain, "fit_hmi", refitted)
    monkeypatch.setattr(gain, "_score", lambda fit, noise, left_out: (np.ones(2), 0.0))
    whole = bare(HmiFit, problem=problem, extensions=(), unknowns=problem.program.null(), strengths=np.zeros(0))
    found = held_out_gain_hmi(white(problem), size=NOISE, null=whole, extended=whole)
    assert len(asked) == 4 and found is not None and found.unfinished == 1
