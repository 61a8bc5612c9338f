"""Data in percent are what they are, and what cannot be compared is refused."""

import dataclasses

import numpy as np
import pytest

from arfjax import InputError, discretise, simulate_heating
from inverse.datasets.hmi import read_hmi
from inverse.diagnosis.free_forms import LOCAL_WIDTHS
from inverse.diagnosis.hmi.account import HmiAccount
from inverse.diagnosis.hmi.courses import HmiRows, hmi_rows, plan_courses
from inverse.diagnosis.hmi.diagnosis import _axes
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.free_forms import _shared, _taken_at, hmi_free_forms, hmi_local_forms, of_all_data
from inverse.diagnosis.hmi.prepare import _notes
from inverse.diagnosis.hmi.refit import fit_hmi
from inverse.diagnosis.where import Absorbed
from inverse.hmi_model import require_during
from tests.inverse.diagnosis.hmi.cases import TEMPERATURES, bare, curves, white


def test_reading_that_a_curve_was_divided_by_is_one_of_its_rows():
    percent = np.full(len(TEMPERATURES), 97.0)
    rows = hmi_rows(curves(percent), 37.0)
    assert len(rows) == len(TEMPERATURES) + 2 and int(np.sum(rows.is_reference)) == 2
    assert rows.temperature[-1] == 37.0 and rows.log_displacement[-1] == np.log(100.0)
    percent[[0, 13]] = 100.0
    again = hmi_rows(curves(percent), 37.0)
    assert len(again) == len(TEMPERATURES) and list(np.flatnonzero(again.is_reference)) == [0, 13]


def test_a_row_that_is_written_twice_is_one_reading():
    data = curves(np.linspace(100.0, 90.0, len(TEMPERATURES)))
    rows = np.concatenate([np.arange(len(TEMPERATURES)), [0, 3]])
    kept = data.select(rows).without_copies()
    assert kept.sonication == data.sonication and kept.remarks[0].startswith("2 rows repeat others")
    np.testing.assert_array_equal(kept.displacement, data.displacement)
    assert data.without_copies() is data
    # At another time, or from another sonication, the same value is another reading.
    timed = dataclasses.replace(data.select(rows), time=np.arange(float(len(rows))))
    assert timed.without_copies() is timed


def test_a_displacement_that_is_not_positive_is_refused():
    percent = np.full(len(TEMPERATURES), 97.0)
    percent[4] = -1.0
    with pytest.raises(InputError, match="row 5.*positive"):
        hmi_rows(curves(percent), 37.0)


def test_a_row_is_named_by_its_line_in_the_file(tmp_path):
    """Comments, a row of units and rows that were left out come before it."""
    file = tmp_path / "curve.csv"
    rows = "37,100\n45,97\n45,97\n60,80\n50,90\n"
    file.write_text("# a comment\ntemperature,displacement\ndegC,%\n" + rows)
    data = read_hmi(file)
    assert len(data.displacement) == 4 and data.remarks
    with pytest.raises(InputError, match=r"curve\.csv, line 8: 50 degC after 60 in sonication 1"):
        hmi_rows(data, 37.0)


def test_a_curve_that_is_100_percent_at_its_coldest_reading_was_divided_by_that():
    """Another reading of 100 percent at the reference temperature would be one that nobody took."""
    percent = np.full(len(TEMPERATURES), 97.0)
    percent[0], percent[5] = 100.0, 100.0
    rows = hmi_rows(curves(percent), 35.0)
    # The second sonication is nowhere 100 percent when it is coldest: its reading is not in the file.
    assert list(np.flatnonzero(rows.is_reference)) == [0, len(TEMPERATURES)]
    assert list(rows.temperature[rows.is_reference]) == [TEMPERATURES[0], 35.0] and rows.sonication[-1] == 1


def test_the_coldest_reading_need_not_be_the_first_and_one_that_is_missing_is_as_uncertain_as_most():
    """A thermometer's noise may be larger than the first steps are; one bad reading is no measure of the others."""
    percent, temperature = np.full(len(TEMPERATURES), 97.0), TEMPERATURES.copy()
    temperature[:2], percent[1] = [38.5, 37.5], 100.0
    deviation = np.where(np.arange(len(percent)) == 20, 30.0, 0.97)
    data = dataclasses.replace(curves(percent), temperature=temperature, sd=deviation)
    rows = hmi_rows(data, 35.0)
    assert list(np.flatnonzero(rows.is_reference)) == [1, len(TEMPERATURES)] and rows.sonication[-1] == 1
    assert rows.deviation[-1] == pytest.approx(0.01) and rows.deviation[20] == pytest.approx(30.0 / 97.0)


@pytest.mark.parametrize("timed", [True, False])
def test_readings_while_it_cools_are_refused(timed):
    data = curves(np.full(len(TEMPERATURES), 97.0), np.tile(np.arange(13.0), 2) if timed else None)
    noisy, cooling = TEMPERATURES.copy(), TEMPERATURES.copy()
    noisy[12] = noisy[11] - 1.5
    assert len(hmi_rows(dataclasses.replace(data, temperature=noisy), 37.0)) == len(TEMPERATURES) + 2
    cooling[20:] = cooling[20:][::-1] - 4.0
    with pytest.raises(InputError, match="row 22: .* degC after 76 in sonication 2; .*while it cools") as caught:
        hmi_rows(dataclasses.replace(data, temperature=cooling), 37.0)
    assert ("sort the rows" in str(caught.value)) is not timed


def test_times_after_the_sonication_are_refused_and_those_that_disagree_are_told(described, settings):
    model, protocol = described.model(), described.stepwise()
    coarse = discretise(model, refinement=0.5)

    def planned(time):
        data = curves(np.full(len(TEMPERATURES), 97.0), time)
        rows = hmi_rows(data, 37.0)
        require_during(data, protocol.duration)
        return plan_courses(data, rows, model, protocol, coarse, 37.0)[1]

    simulated = planned(None)
    assert np.all(np.isnan(simulated.lateness))
    times = simulated.time[: len(TEMPERATURES)]
    again = planned(times)
    np.testing.assert_allclose(again.lateness[: len(TEMPERATURES)], 0.0, atol=1e-9)
    np.testing.assert_allclose(planned(0.5 * times).lateness[: len(TEMPERATURES)], -0.5 * times, atol=1e-9)
    with pytest.raises(InputError, match="row 12: 76.* s is after the sonication's end at 60 s; .*sonication_s"):
        planned(2.0 * times)
    last = np.where(np.arange(len(times)) == 12, 60.6, 0.99 * times)
    assert planned(last).time[12] == 60.6
    usual = _notes(curves(np.full(len(TEMPERATURES), 97.0), times), again, 37.0)
    early = _notes(curves(np.full(len(TEMPERATURES), 97.0), 0.5 * times), planned(0.5 * times), 37.0)
    assert not any("earlier" in note for note in usual) and any(
        "s earlier than the simulated" in note for note in early
    )


def test_of_times_alone_temperatures_are_those_of_the_simulated_heating(described):
    """All sonications up to the protocol's last temperature, and what was read at its end is as warm as that."""
    model, protocol = described.model(), described.stepwise()
    times = np.tile(np.linspace(0.0, protocol.duration, 13), 2)
    data = dataclasses.replace(curves(np.full(len(TEMPERATURES), 97.0), times), temperature=None)
    settings = discretise(model, refinement=0.5)
    rows = plan_courses(data, hmi_rows(data, 37.0), model, protocol, settings, 37.0)[1]
    heating = simulate_heating(model, protocol, settings)
    np.testing.assert_allclose(rows.temperature, np.interp(times, heating.time, heating.focal_temperature), atol=1e-6)
    assert rows.temperature[0] == pytest.approx(protocol.start_temperature)
    assert rows.temperature[12] == pytest.approx(protocol.final_temperature)
    np.testing.assert_array_equal(rows.time, times)
    assert np.all(np.isnan(rows.lateness))


def test_readings_at_one_temperature_have_a_correction_however_dense_they_are():
    dense = np.tile(37.0 + 0.2 * np.arange(40), 3) + 0.01 * np.repeat([0.0, 1.0, 2.0], 40)
    sonication = np.repeat([0, 1, 2], 40)
    values = _shared(dense, sonication)
    inside = np.stack([_taken_at(dense, value) for value in values])
    # No reading is in two, and hardly any in none.
    assert np.all(np.sum(inside, axis=0) <= 1) and np.mean(np.any(inside, axis=0)) > 0.9
    usual = np.tile(37.0 + 2.0 * np.arange(14), 3)
    assert _shared(usual, np.repeat([0, 1, 2], 14)) == sorted(set(usual))


def test_micrometres_and_their_deviations_are_read_from_a_file(tmp_path):
    """Nothing was divided by a reading then, and every reading has its own relative error."""
    file = tmp_path / "hmi.csv"
    file.write_text(
        "sonication,temperature_c,displacement_um,displacement_um_sd\na,37,8,0.4\na,50,7.5,0.3\nb,37,9,0.9\nb,60,8,0.2\n"
    )
    rows = hmi_rows(read_hmi(file), 37.0)
    assert len(rows) == 4 and not np.any(rows.is_reference) and rows.labels == ("a", "b")
    np.testing.assert_allclose(rows.deviation, [0.05, 0.04, 0.1, 0.025])
    np.testing.assert_allclose(np.diff(rows.log_displacement)[[0, 2]], np.log([7.5 / 8.0, 8.0 / 9.0]))


@pytest.mark.parametrize("in_percent", [True, False])
def test_of_times_alone_it_is_said_where_temperatures_are_from_and_what_cannot_be_known(in_percent):
    data = dataclasses.replace(
        curves(np.full(len(TEMPERATURES), 97.0), np.tile(np.arange(13.0), 2)), temperature=None, in_percent=in_percent
    )
    rows = hmi_rows(data, 37.0)
    assert len(rows) == len(TEMPERATURES) and not np.any(rows.is_reference)
    notes = " ".join(_notes(data, rows, 37.0))
    assert "up to the last of `protocol.temperatures_c`" in notes
    assert ("`normalisation-temperature` has nothing to act on" in notes) == in_percent


@pytest.mark.parametrize(
    ("size", "lowest", "words"),
    [
        (
            0.03,
            60.0,
            "the measured displacement is 3 % above the model at most, at 80 degC in sonication 2, from 62 degC on",
        ),
        (-0.03, 0.0, "the measured displacement is 3 % below the model at most, at 80 degC in sonication 2"),
    ],
)
def test_a_correction_is_told_by_its_place_sign_size_and_onset(problem, size, lowest, words):
    null = fit_hmi(problem, (), white(problem), size=0.01)
    temperature = problem.rows.temperature
    correction = np.where(temperature >= lowest, size * (0.8 + 0.2 * temperature / 80.0), 0.0)
    beliefs = np.zeros(len(null.residuals) - len(problem.rows))
    place = Absorbed("somewhere", 0.5, 0.01, np.append(problem.weights * correction, beliefs))
    assert HmiAccount(problem, null).describe(place) == f"somewhere: {words}"


def test_a_correction_of_some_readings_in_the_middle_begins_nowhere(problem):
    """It is told from where on it is there only if it mostly is there from then on."""
    temperature, account = problem.rows.temperature, HmiAccount(problem, bare(HmiFit, problem=problem))
    for largest, said in ((85.0, True), (60.0, False)):
        correction = np.where((temperature > 50.0) & (temperature < largest), 0.1, 0.0)
        told = account.describe(Absorbed("somewhere", 0.5, 0.01, correction))
        assert told.endswith(", from 50 degC on") == said and "is 11 % above" in told


@pytest.mark.parametrize(("share", "words"), [(0.3, "70 % below"), (1.8, "80 % above")])
def test_a_large_correction_is_told_in_percent_of_the_model(problem, share, words):
    """Not by its logarithm, of which that to a third would be more than all; nor in units of stated deviations."""
    count = len(problem.rows)
    stated = dataclasses.replace(problem, rows=dataclasses.replace(problem.rows, deviation=np.full(count, 0.02)))
    correction = np.where(np.arange(count) == 7, np.log(share) / 0.02, 0.0)
    told = HmiAccount(stated, bare(HmiFit, problem=stated)).describe(Absorbed("somewhere", 0.5, 0.01, correction))
    assert f"is {words} the model at most, at {problem.rows.temperature[7]:.0f} degC in sonication 1" in told


def test_neighbours_at_one_temperature_are_of_different_sonications(problem):
    """Whatever many readings one has within a degree."""
    temperature, sonication = 70.0 + np.arange(float(len(problem.rows))), np.zeros(len(problem.rows), dtype=int)
    temperature[:7], sonication[4:7] = [50.1, 50.2, 50.4, 60.0, 50.0, 50.3, 60.2], 1
    rows = dataclasses.replace(problem.rows, temperature=temperature, sonication=sonication)
    axis = next(one for one in _axes(dataclasses.replace(problem, rows=rows)) if "one temperature" in one.along)
    pairs = [np.flatnonzero(axis.keys == key).tolist() for key in np.unique(axis.keys)]
    assert [one for one in pairs if len(one) > 1] == [[0, 4], [1, 5], [3, 6]] and [2] in pairs


def test_corrections_of_no_name_act_where_their_words_say():
    """Two sonications, the first and last readings at the same temperatures, three at the same times."""
    temperature = np.array([37.0, 45.0, 52.0, 58.0, 66.0, 80.0, 37.0, 44.0, 51.0, 59.0, 67.0, 80.0])
    time, sonication = np.array([0.0, 5, 9, 14, 30, 60, 0, 5, 10, 15, 31, 60]), np.repeat([0, 1], 6)
    rows = HmiRows(
        np.zeros(12), sonication, ("x", "y"), temperature, time, np.zeros(12, dtype=bool), None, np.arange(12)
    )
    # As much displacement in the two sonications, but for a factor.
    log_predicted = np.log(np.tile([1.0, 0.9, 1.1, 0.8, 0.6, 0.5], 2)) + np.repeat([0.0, 2.0], 6)
    found, places = hmi_free_forms(rows, log_predicted)
    forms, words = {one.name: one.directions for one in found}, {one.name: one.words for one in places}
    assert list(forms) == list(words) and "in all sonications alike" in words["smooth-0.3"]
    for name, coordinate in (("smooth-0.3", temperature), ("time", time), ("displacement", np.tile(np.arange(6), 2))):
        for value in np.unique(coordinate):
            same = forms[name][coordinate == value]
            np.testing.assert_allclose(same, same[:1] * np.ones((len(same), 1)), atol=1e-12)
        assert len(np.unique(np.round(forms[name][:, 1], 9))) == len(np.unique(coordinate))
    for number, label in enumerate("xy"):
        own = forms[f"sonication-{label}"]
        assert f"sonication {label} alone" in words[f"sonication-{label}"]
        assert not np.any(own[sonication != number]) and np.all(np.any(own[sonication == number] != 0.0, axis=1))
    for value in (37.0, 80.0):
        np.testing.assert_array_equal(forms[f"at-{value:.4g}"][:, 0], (temperature == value).astype(float))
        assert words[f"at-{value:.4g}"] == f"at {value:.3g} degC in all sonications"
    assert [name for name in forms if name.startswith("at-")] == ["at-37", "at-80"]


def test_what_tissue_has_gone_through_is_that_of_its_course(problem):
    """By then: shares of the minute that a sonication takes, coagulation from the lethal dose on."""
    rows = problem.rows
    assert rows.dose is not None
    for course in problem.program.courses:
        at, mine, places = course.conditions, np.asarray(course.rows), np.asarray(course.places)
        np.testing.assert_allclose(np.asarray(at.share), np.asarray(at.time) / 60.0, rtol=1e-12)
        assert float(at.share[-1]) == 1.0 and float(at.temperature[-1]) == course.protocol.final_temperature
        assert float(at.start_temperature) == course.protocol.start_temperature == 35.0
        assert float(at.push_duration) == course.protocol.push_duration
        np.testing.assert_allclose(np.asarray(at.temperature)[places], rows.temperature[mine])
        np.testing.assert_allclose(np.asarray(at.time)[places], rows.time[mine])
        np.testing.assert_allclose(np.asarray(at.rise), np.asarray(at.temperature) - 35.0)
        since, coagulated = np.asarray(at.since_coagulation)[places], np.asarray(at.coagulated)[places]
        lethal = rows.dose[mine] > 240.0
        np.testing.assert_array_equal(since > 0.0, lethal)
        times = rows.time[mine]
        assert np.all(np.diff(coagulated[np.argsort(times)]) >= 0.0) and coagulated.min() < 1e-6
        if np.any(lethal):
            begun = times[lethal] - since[lethal]
            np.testing.assert_allclose(begun, begun[0])
            assert np.max(times[~lethal]) <= begun[0] < np.min(times[lethal])
    # The hotter one coagulates, through and through.
    assert coagulated.max() > 0.9 and np.sum(lethal) > 1


def test_what_a_curve_was_divided_by_is_said_where_it_is_not_in_the_file():
    percent = np.full(len(TEMPERATURES), 97.0)
    missing = " ".join(_notes(curves(percent), hmi_rows(curves(percent), 37.0), 37.0))
    assert "Of 2 sonications the reading that the curve was divided by is not in the file" in missing
    percent[0] = 100.0
    rows = hmi_rows(curves(percent), 35.0)
    elsewhere = " ".join(_notes(curves(percent), rows, 35.0))
    assert "Of 1 sonications the reading" in elsewhere
    assert "were divided by that, not by one at 35 degC: 1 at 37 degC." in elsewhere
    assert "A factor of each sonication is free" in elsewhere


def test_local_corrections_are_everywhere_and_weigh_as_readings_do():
    temperature = np.array([37.0, 45.0, 52.0, 60.0, 80.0, 37.0, 50.0, 80.0])
    rows = HmiRows(
        np.zeros(8), np.repeat([0, 1], [5, 3]), ("x", "y"), temperature, np.arange(8.0), np.zeros(8, dtype=bool), None,
        np.arange(8),
    )  # fmt: skip
    found = hmi_local_forms(rows)
    assert {one.name.split("-")[0] for one in found} == {"local"} and len({one.name for one in found}) == len(found)
    bumps = np.concatenate([one.directions for one in found], axis=1)
    # Alike in all sonications, Gaussian, and one at the least within half its width of each reading.
    np.testing.assert_array_equal(bumps[[0, 4]], bumps[[5, 7]])
    assert np.all(np.max(bumps, axis=1) > np.exp(-0.5 * 0.5**2) - 1e-12) and np.max(bumps) == 1.0
    x = (temperature - 37.0) / 43.0
    of_start = bumps[:, bumps[0] == 1.0]
    widths = np.sort(np.sqrt(-0.5 * x[1] ** 2 / np.log(of_start[1])))
    np.testing.assert_allclose(widths, LOCAL_WIDTHS, rtol=1e-12)
    weights = np.linspace(1.0, 2.0, 8)
    for before, after in zip(found, of_all_data(found, weights, 11), strict=True):
        assert after.name == before.name and after.directions.shape == (11, 1)
        np.testing.assert_array_equal(after.directions[:8, 0], weights * before.directions[:, 0])
        assert not np.any(after.directions[8:])
