"""What a report says of a curve: early dip, peak after it, end, and which cause mends what the simulation has wrong."""

import dataclasses

import numpy as np
import pytest

from inverse.diagnosis.hmi import account
from inverse.diagnosis.hmi import diagnosis as hmi_diagnosis
from inverse.diagnosis.hmi.account import HmiAccount
from inverse.diagnosis.hmi.features import Curve, mismatches
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.noise_size import noise_size
from inverse.diagnosis.hmi.refit import fit_hmi
from inverse.diagnosis.outlying import Outlying
from tests.inverse.diagnosis.hmi.cases import bare, measured_with, white

TEMPERATURE = np.array([37.0, 45.0, 59.0, 70.0, 84.0])


def curve(percent):
    return Curve("3", TEMPERATURE, np.array(percent))


@pytest.mark.parametrize(
    ("percent", "cells"),
    [
        # The third sonication of Suomi et al. 2016: the first reading is as high as the peak.
        ([100.0, 96.0, 100.0, 85.0, 65.0], "96 at 45 degC | 100 at 59 degC | 65 at 84 degC"),
        # The first: still above its start in the end.
        ([100.0, 99.0, 104.0, 110.0, 96.0], "99 at 45 degC | 110 at 70 degC | 96 at 84 degC"),
        # No dip: it rises from the start.
        ([100.0, 102.0, 105.0, 85.0, 65.0], "none | 105 at 59 degC | 65 at 84 degC"),
        # Neither.
        ([100.0, 99.0, 96.0, 85.0, 65.0], "none | none | 65 at 84 degC"),
    ],
)
def test_features_of_a_curve(percent, cells):
    assert curve(percent).cells() == cells


def test_a_mismatch_is_told_with_what_mends_half_of_it():
    measured, simulated = curve([100.0, 96.0, 110.0, 85.0, 65.0]), curve([100.0, 95.0, 100.0, 80.0, 49.0])
    causes = {
        "this": [curve([100.0, 96.0, 105.5, 85.0, 56.9])],  # of the peak more than half, of the end just less
        "that": [curve([100.0, 96.0, 101.0, 70.0, 57.1])],  # the other way round
    }
    told = mismatches([measured], [simulated], causes, size=0.01)
    assert told == [
        "Sonication 3, peak: 110 at 59 degC measured, 100 simulated; half of it or more is mended by this (106).",
        "Sonication 3, end: 65 at 84 degC measured, 49 simulated; half of it or more is mended by that (57).",
        "Not to be told from scatter, up to 2.9 % of a reading: the dip of 3.",
    ]


def test_what_no_cause_mends_and_what_noise_hides_are_said_so():
    measured, simulated = curve([100.0, 96.0, 110.0, 85.0, 65.0]), curve([100.0, 95.0, 100.0, 80.0, 49.0])
    (end, hidden) = mismatches([measured], [simulated], {}, size=0.05)
    assert end.endswith("49 simulated; mended by none in question.")
    assert hidden == "Not to be told from scatter, up to 15 % of a reading: the dip of 3, the peak of 3."


def test_of_a_curve_that_rises_to_its_end_one_reading_is_told_once():
    measured, simulated = curve([100.0, 96.0, 97.0, 100.0, 120.0]), curve([100.0, 96.0, 97.0, 99.0, 100.0])
    told = mismatches([measured], [simulated], {}, size=0.01)
    assert told[0].startswith("Sonication 3, peak: 120 at 84 degC measured, 100 simulated") and len(told) == 2


@pytest.mark.parametrize(("measured", "simulated", "is_told"), [(30.0, 25.0, True), (300.0, 307.0, False)])
def test_scatter_is_that_of_the_reading(measured, simulated, is_told):
    """Of 2 %: 5 points of 30 are six standard deviations, 7 of 300 less than one."""
    curves = [[curve([100.0, 95.0, 90.0, 60.0, end])] for end in (measured, simulated)]
    told = mismatches(*curves, {}, size=0.02)
    assert [one.startswith("Sonication 3, end") for one in told] == [is_told]


@pytest.mark.parametrize(
    ("labels", "said"), [(("1",), "a factor of the sonication"), (("1", "2"), "each of 2 sonications")]
)
def test_factors_are_counted(problem, labels, said):
    one = dataclasses.replace(problem, rows=dataclasses.replace(problem.rows, labels=labels))
    assert f"{said}, {len(problem.rows)} readings" in HmiAccount(one, bare(HmiFit, problem=one)).sentence


def test_scatter_is_that_of_the_fit_that_leaves_least(problem, monkeypatch):
    """What fits make least is weighed in the noise of each: of a bad one it can be less than of a good one."""
    asked = []
    monkeypatch.setattr(account, "mismatches", lambda *_, size: asked.append(size) or [])
    hidden, _ = measured_with(problem, "output-drift", 2.0, noise=0.01, seed=2)
    null = fit_hmi(hidden, (), white(hidden), size=0.01)
    better = dataclasses.replace(null, residuals=0.5 * null.residuals, misfit=2.0 * null.misfit)
    HmiAccount(hidden, null).facts({"output-drift": better})
    assert asked == [pytest.approx(noise_size(better))]


def test_curves_of_a_report_are_by_temperature_and_in_percent_whatever_the_weights(problem, monkeypatch):
    """Of a file with deviations of 2 %, its rows from hot to cold: residuals are in units of the deviations."""
    told = {}
    monkeypatch.setattr(account, "mismatches", lambda *curves, size: told.update(curves=curves, size=size) or [])
    count, hot = len(problem.rows), 5
    back = np.arange(count)[::-1]
    rows = dataclasses.replace(
        problem.rows,
        log_displacement=0.01 * problem.rows.temperature[back],
        temperature=problem.rows.temperature[back],
        sonication=problem.rows.sonication[back],
        deviation=np.full(count, 0.02),
    )
    stated = dataclasses.replace(problem, rows=rows)
    residuals = np.append(np.where(np.arange(count) == hot, np.log(1.1) / 0.02, 0.0), [7.0, 7.0])
    null = bare(HmiFit, problem=stated, residuals=residuals, freedom=16.0)
    HmiAccount(stated, null).facts({})
    measured, simulated, _ = told["curves"]
    for one, other in zip(measured, simulated, strict=True):
        np.testing.assert_allclose(one.percent, 100.0 * np.exp(0.01 * (one.temperature - one.temperature[0])))
        assert np.all(np.diff(one.temperature) > 0.0) and np.array_equal(other.temperature, one.temperature)
        off = np.where(one.temperature == rows.temperature[hot], np.log(1.1), 0.0)
        of_it = rows.labels[rows.sonication[hot]] == one.label
        np.testing.assert_allclose(np.log(one.percent / other.percent), off * of_it, atol=1e-12)
    assert told["size"] == pytest.approx(np.log(1.1) / 4.0)


def test_a_peak_at_another_temperature_is_told_with_what_takes_it_there():
    """The paper's: at 59 to 70 degC measured, at 55 degC simulated."""
    measured, simulated = curve([100.0, 96.0, 97.0, 104.0, 90.0]), curve([100.0, 96.0, 103.0, 99.0, 90.0])
    causes = {"this": [curve([100.0, 96.0, 99.0, 103.0, 90.0])], "that": [curve([100.0, 96.0, 103.0, 98.0, 90.0])]}
    told = mismatches([measured], [simulated], causes, size=0.01)
    assert told[1] == (
        "Sonication 3: the peak is at 70 degC measured, at 59 degC simulated; taken halfway there or further by this "
        "(at 70)."
    )
    # 7 points of the one and 4 of the other are lost between the two readings, 11.3 are two deviations of 4 %.
    assert any("the peak is at" in one for one in mismatches([measured], [simulated], {}, size=0.0386))
    assert not any("the peak is at" in one for one in mismatches([measured], [simulated], {}, size=0.0388))


def test_a_slip_is_told_with_its_temperature_and_sonication_in_percent(problem, monkeypatch):
    """By weights of the file; what is believed of constants is no reading."""
    count, asked = len(problem.rows), []
    rows = dataclasses.replace(problem.rows, deviation=np.full(count, 0.02))
    stated = dataclasses.replace(problem, rows=rows)

    def found(residuals, directions, reading):
        asked.append(reading)
        return (Outlying(15, np.array([np.log(0.9) / 0.02])), Outlying(2, np.array([np.log(1.2) / 0.02]))), 0.93

    monkeypatch.setattr(hmi_diagnosis, "outlying", found)
    null = bare(HmiFit, problem=stated, residuals=np.zeros(count + 2), directions=np.zeros((count + 2, 1)))
    (told,) = hmi_diagnosis._slips(null)
    cold, hot = (f"{problem.rows.temperature[row]:.3g} degC in sonication" for row in (15, 2))
    assert told.startswith(f"2 readings together hold 93 % of the misfit: {cold} 2, -10 % off what the others say; ")
    assert f"{hot} 1, +20 % off what the others say." in told
    np.testing.assert_array_equal(asked[0], [*range(count), -1, -1])


def test_a_fit_says_what_came_out_far_what_it_does_not_see_and_where_the_mesh_is_wrong(problem, monkeypatch):
    """Three standard deviations from what was believed are far, two are not."""
    monkeypatch.setattr(hmi_diagnosis, "_slips", lambda _: ())
    program, count = problem.program, len(problem.rows)
    slopes = program.penalty_slopes(program.null())[:, program.constants]
    # Constants of which something is believed by themselves; anchors of one curve go together.
    alone = [place for place in range(slopes.shape[1]) if np.sum(np.abs(slopes[:, place]) > 1e-9) == 1]
    far, near = alone[:2]
    beliefs = [program.names_of_beliefs[int(np.argmax(np.abs(slopes[:, place])))] for place in (far, near)]
    unknowns = program.null()
    unknowns[program.constants[[far, near]]] += np.array([3.0, -2.0]) * program.spreads[[far, near]]
    directions = np.ones((count + program.n_beliefs, slopes.shape[1] + 2))
    directions[:count, 1] = 1e-4
    trust = np.where(np.arange(count) == 20, 0.5, 0.95)
    fit = bare(HmiFit, problem=problem, unknowns=unknowns, directions=directions, left=float("nan"))
    name = program.parameters.names[1]
    said = hmi_diagnosis.fit_remarks(fit)
    assert [one for one in said if "believed of it" in one] == [
        f"{beliefs[0]} comes out 3.0 standard deviations from what was believed of it."
    ]
    assert f"These data hardly see {name}: what was believed of them stands." in said and len(said) == 2
    coarse = bare(HmiFit, problem=dataclasses.replace(problem, trust=trust), unknowns=program.null(),
                  directions=np.ones_like(directions), left=float("nan"))  # fmt: skip
    (mesh,) = hmi_diagnosis.fit_remarks(coarse)
    assert f"most of all at {problem.rows.temperature[20]:.0f} degC in sonication 2: 1 readings weigh less" in mesh
    assert "that one 0.50 of what its noise alone would give it" in mesh
