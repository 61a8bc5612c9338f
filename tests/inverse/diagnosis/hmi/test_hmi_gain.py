"""What a cause is worth on sonications, or blocks of one, that the fit did not see."""

import dataclasses

import numpy as np
import pytest
from scipy import linalg, stats

from inverse.diagnosis.hmi.gain import _folds, _score, held_out_gain_hmi
from inverse.diagnosis.hmi.refit import fit_hmi
from tests.inverse.diagnosis.hmi.cases import fitted_with, measured_with, white

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
