"""The next measurement: its geometry, and that it does what is promised of it."""

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.patches import Rectangle
from scipy import stats

from arfjax import InputError
from inverse.commands.main import run
from inverse.datasets.dma import dma_data, read_dma
from inverse.design import design_dma, dma_design, dma_information, report
from inverse.design.design import Check, Design, Rated, alive, reasons
from inverse.design.dma_information import Information
from inverse.design.dma_proposals import DmaProposal, dma_proposals
from inverse.design.report import as_json
from inverse.design.separation import separation
from inverse.diagnosis import DMA_CAUSES, diagnose_dma
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.dma.problem import dma_problem
from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.screening import Alternative, Screen
from inverse.dma_fit import FRACTIONAL
from inverse.figures.design import design_figure
from tests.blind import dma_generator as blind
from tests.inverse.design.small import left_by_reading
from tests.inverse.diagnosis_keys import require_design_keys

LIKE = ("sweep-drift", "bath-viscosity")
NOTHING = Design(
    "adequate", {}, separation((), np.zeros((2, 0)), np.zeros(0), np.zeros((2, 0)), 1.0, ()), (), (), (), 0
)
STEADY = ("noise-floor", "strain-nonlinearity")


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hidden")
    blind.write(folder / "data.csv", folder / "key.json", seed=blind.TEST_SEEDS + 7001, name="sweep-drift", d_prime=6.0)
    return folder / "data.csv"


@pytest.fixture(scope="module")
def found(file):
    return diagnose_dma(read_dma(file), gain=False, seed=1)


def test_probability_of_the_right_one_is_that_of_simulated_statistics():
    rng = np.random.default_rng(3)
    fitted = rng.standard_normal((40, 4))
    directions = rng.standard_normal((40, 2))
    directions[:, 1] += 1.5 * directions[:, 0]
    strengths, size = np.array([0.35, 0.2]), 0.5
    told = separation(("a", "b"), directions, strengths, fitted, size, (0, 0))
    basis = np.linalg.qr(fitted)[0]
    left = directions - basis @ (basis.T @ directions)
    units = left / np.linalg.norm(left, axis=0)
    count = 40_000
    for true, other in ((0, 1), (1, 0)):
        data = strengths[true] * left[:, [true]] + size * rng.standard_normal((40, count))
        data -= basis @ (basis.T @ data)
        share = np.mean(units[:, true] @ data > units[:, other] @ data)
        # Four standard errors of a share of so many.
        assert abs(share - told.right[true, other]) < 4.0 * np.sqrt(0.25 / count)
    np.testing.assert_allclose(told.cosine[0, 1], units[:, 0] @ units[:, 1], rtol=1e-12)
    assert told.worst == min(told.right[0, 1], told.right[1, 0]) == told.right[told.closest]
    lines = directions - basis @ (basis.T @ directions)
    # The angle between two lines, from 0 to 90 degrees: by its tangent, along and across the first.
    along = units[:, 0] @ lines[:, 1]
    across = np.linalg.norm(lines[:, 1] - along * units[:, 0])
    np.testing.assert_allclose(told.angle, np.degrees(np.arctan2(across, abs(along))), rtol=1e-9)


@pytest.mark.parametrize("signs", [(1, 1), (0, 1), (1, 0), (0, 0)])
def test_a_cause_of_one_sign_is_no_answer_to_data_that_go_the_opposite_way(signs):
    """By the statistics of the diagnosis itself, on two directions of which one is nearly the other's reverse."""
    rng = np.random.default_rng(4)
    fitted, directions = rng.standard_normal((60, 2)), rng.standard_normal((60, 2))
    directions[:, 1] -= 2.5 * directions[:, 0]
    strengths, count = np.array([0.5, 0.2]), 4000
    told = separation(("a", "b"), directions, strengths, fitted, 1.0, signs)
    assert told.cosine[0, 1] < -0.9
    assert (told.angle > 90.0) is (signs == (1, 1))
    alternatives = [Alternative(name, directions[:, [k]], signs[k]) for k, name in enumerate("ab")]
    rows = np.arange(60.0)
    screen = Screen(fitted, alternatives, noise_family([series("row", [0] * 60, rows)], rows)[:1])
    for true, other in ((0, 1), (1, 0)):
        data = strengths[true] * directions[:, [true]] + rng.standard_normal((60, count))
        statistic = np.abs(screen.statistics(data).statistic)
        share = np.mean(statistic[true] > statistic[other])
        assert share == pytest.approx(told.right[true, other], abs=4.0 * np.sqrt(0.25 / count))


@pytest.mark.parametrize(("step", "between"), [(2.0, ()), (2.5, (21.25, 23.75)), (5.0, (22.5, 27.5))])
def test_sweeps_between_others_are_none_of_them(step, between):
    frequency = np.geomspace(0.1, 100.0, 8)
    temperature = np.repeat(20.0 + step * np.arange(3.0), 8)
    data = dma_data(np.tile(frequency, 3), temperature, np.full(24, 1e3))
    proposals = {one.name: one for one in dma_proposals(data)}
    assert tuple(np.unique(proposals["between"].temperature)) == between if between else "between" not in proposals


def test_what_is_written_twice_is_rated_once(file, found, monkeypatch):
    monkeypatch.setattr(dma_design, "dma_proposals", lambda *given, **asked: dma_proposals(*given, **asked)[:1])
    data = read_dma(file)
    twice = data.select(np.tile(np.arange(len(data)), 2))
    one, other = (design_dma(each, found=found, causes=LIKE, check=False, locate=False) for each in (data, twice))
    np.testing.assert_allclose(other.now.d_prime, one.now.d_prime, rtol=1e-9)


def test_a_strength_of_drying_means_the_same_after_a_longer_measurement(file):
    """Twice as long, a sample loses twice as much water, and the strength is that of what it had lost at first."""
    data = read_dma(file)
    problem = dma_problem(data, FRACTIONAL)
    again = next(one for one in dma_proposals(data) if one.name == "again")
    further = dma_problem(dma_design._with(data, problem, again), FRACTIONAL, whole_drying=problem.whole_drying)
    assert float(np.max(problem.conditions.exposure)) == 1.0
    assert float(np.max(further.conditions.exposure)) == pytest.approx(2.0, rel=0.05)
    first = np.asarray(further.conditions.time) <= np.max(problem.conditions.time)
    ours, theirs = (
        np.sort(np.asarray(one)) for one in (further.conditions.exposure[first], problem.conditions.exposure)
    )
    np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-15)


def test_proposals_come_after_what_was_measured_and_are_what_they_say(file):
    data = read_dma(file)
    proposals = {one.name: one for one in dma_proposals(data, seed=2)}
    end, grid = float(np.max(np.asarray(data.time_s))), np.unique(data.frequency_hz)
    for one in proposals.values():
        assert np.all(one.time > end) and np.all(np.diff(one.time) > 0.0)
    first = proposals["again"].temperature
    np.testing.assert_array_equal(np.unique(first), np.unique(proposals["reversed-temperatures"].temperature))
    assert first[0] < first[-1] and proposals["reversed-temperatures"].temperature[0] == first[-1]
    assert proposals["lower-frequencies"].frequency.max() < grid.min()
    assert proposals["higher-frequencies"].frequency.min() > grid.max()
    shuffled = proposals["random-order"].frequency[: len(grid)]
    assert np.any(np.diff(shuffled) < 0.0) and np.allclose(np.sort(shuffled), grid)
    assert not set(proposals["between"].temperature) & set(first)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_more_data_never_separate_worse_and_random_order_shows_drift(file, found):
    """A drift over a sweep looks like frequency where frequencies come in order."""
    design = design_dma(read_dma(file), found=found, causes=LIKE, check=False, seed=4)
    rated = {one.proposal.name: one.separation for one in design.rated}
    for one in rated.values():
        assert np.all(one.d_prime > 0.98 * design.now.d_prime)
    drift = design.now.names.index("sweep-drift")
    # Twice as many readings alone would give the square root of two.
    assert rated["random-order"].d_prime[drift] > 1.5 * rated["again"].d_prime[drift]
    assert [one.separation.worst for one in design.rated] == sorted((r.worst for r in rated.values()), reverse=True)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_command_writes_what_it_found_and_the_promise_is_kept(file, tmp_path):
    out, noted = tmp_path / "out", tmp_path / "noted.csv"
    header, *rows = file.read_text().splitlines()
    noted.write_text("\n".join([f"{header},operator", *(f"{row},A" for row in rows)]) + "\n")
    arguments = ["design", "--dma", str(noted), "--causes", ",".join(LIKE), "--out", str(out), "--seed", "5"]
    assert run(arguments) == 0
    content = json.loads((out / "design.json").read_text())
    require_design_keys(content)
    assert content["verdict"] in ("named", "confusable", "unexplained")
    best = content["proposals"][0]
    assert best["probability_right"] > content["now"]["probability_right"]
    assert [one["hidden"] for one in content["checks"]] == list(LIKE)
    # Promised to be told apart in nearly all cases: neither is given the other's name alone.
    for one, other in zip(content["checks"], reversed(LIKE), strict=True):
        assert one["verdict"] != "adequate" and one["named"] != [other]
    # A true cause is the answer in nine of ten such data sets, so that one of the two is in 99 of 100.
    assert any(one["hidden"] in (*one["named"], *one["confusable"]) for one in content["checks"])
    report = (out / "report.md").read_text()
    assert best["words"] in report and "A single reading would tell" in report
    assert "Columns not used: operator." in content["notes"]
    assert set(content["reading"]["causes"]) == set(LIKE) and content["reading"]["information_nat"] > 0.0
    assert (out / "design.png").stat().st_size > 10_000 and (out / "design.pdf").exists()


def test_what_nothing_can_be_designed_by_is_refused(file, found):
    data = read_dma(file)
    with pytest.raises(InputError, match="there is no cause 'gremlins'"):
        design_dma(data, causes=("slip", "gremlins"))
    with pytest.raises(InputError, match="cannot see 'clamp-compliance': the fitted .* of its effect; they see"):
        design_dma(data, found=found, causes=("slip", "clamp-compliance"))
    with pytest.raises(InputError, match="these data see fewer than two"):
        design_dma(data, found=dataclasses.replace(found, causes=found.causes[:1]))
    twice = design_dma(data, found=found, causes=("slip", "slip", "drying"), check=False, locate=False)
    assert twice.now.names == ("slip", "drying") and twice.information is None and twice.notes == ()
    require_design_keys(as_json(twice))
    # The best first, in noise as it was found in these data, of which the file states no deviation.
    worst = [one.separation.worst for one in twice.rated]
    assert worst == sorted(worst, reverse=True) and len(worst) == 6
    assert found.noise is not None and twice.sizes == pytest.approx((found.noise.size, found.noise.size))
    assert found.decision is not None
    pair = dataclasses.replace(found.decision, explanations=(("slip", "drying"), ("slip", "sweep-drift")))
    with pytest.raises(InputError, match=r"two causes at once \(slip with drying; slip with sweep-drift\)"):
        design_dma(data, found=dataclasses.replace(found, decision=pair))
    assert len(alive(dataclasses.replace(found, decision=pair), ("slip", "drying"), DMA_CAUSES)[0]) == 2
    failed = dataclasses.replace(found, verdict="fit-failure", noise=None, causes=())
    with pytest.raises(InputError, match="the fit of these data failed"):
        design_dma(data, found=failed)


def test_simulated_data_without_noise_are_designed_by_as_if_they_were_measured(file, monkeypatch):
    """With the noise of their rounding any measurement would tell any two causes apart."""
    asked = []

    def coarse(data, diagnose, seed):
        asked.append((len(data), seed))
        assert diagnose.keywords["seed"] == seed and not diagnose.keywords["gain"]
        raise InputError("stop here")

    monkeypatch.setattr("inverse.design.dma_design.diagnosed_as_measured", coarse)
    with pytest.raises(InputError, match="stop here"):
        design_dma(read_dma(file), seed=3)
    assert asked == [(len(read_dma(file)), 3)]


def test_why_these_causes_is_said_where_the_diagnosis_does_not_ask_for_them(found):
    def at_rest(kept):
        causes = tuple(
            dataclasses.replace(one, status="possible" if place < kept else "not needed")
            for place, one in enumerate(found.causes)
        )
        return dataclasses.replace(found, verdict="named" if kept else "adequate", causes=causes)

    first, second = (one.cause.name for one in found.causes[:2])
    (nothing,) = reasons(at_rest(0), (), (first, second))
    assert "says `adequate` and leaves no cause in question" in nothing and f"{first} and {second}" in nothing
    assert f"leaves {first} alone" in reasons(at_rest(1), (), (first, second))[0]
    assert reasons(at_rest(2), (), (first, second)) == () == reasons(at_rest(0), (first, second), (first, second))
    assert f"Of {second} alone" in reasons(at_rest(2), (second,), (second, first))[0]
    # Twice the same is one.
    assert reasons(at_rest(2), (second, second), (second, first)) == reasons(at_rest(2), (second,), (second, first))


@pytest.mark.slow
def test_a_reading_tells_what_the_other_cause_and_the_constants_cannot_imitate(found):
    """Neither cause looks at the time: where something was measured already, it tells as much as that did."""
    problem, known = found.problem, {one.cause.name: one for one in found.causes}
    extensions = [Extension(known[name].cause, known[name].shape or 0.0) for name in STEADY]
    strengths, size = np.array([known[name].detectability for name in STEADY]), np.array([0.02, 0.03])
    told = dma_information.dma_information(problem, extensions, strengths, size)
    expected = [0.5 * np.sum((left / size) ** 2, axis=1) for left in left_by_reading(problem, extensions, strengths)]
    omega = np.asarray(problem.conditions.angular_frequency)
    for end, frequency in ((0, omega.min()), (-1, omega.max())):
        rows = np.flatnonzero(omega == frequency)
        rows = rows[np.argsort(np.asarray(problem.conditions.temperature)[rows])]
        np.testing.assert_allclose(told.nat[:, end], np.min(expected, axis=0)[rows], rtol=1e-5)
    assert told.best >= np.max(told.nat) * (1.0 - 1e-9) and told.best_temperature in told.temperature
    assert told.frequency[0] * (1.0 - 1e-9) <= told.best_frequency <= told.frequency[-1] * (1.0 + 1e-9)


def test_magnitude_and_phase_are_rated_and_simulated_with_noise_of_their_own(file):
    data, size = dma_design._plain(read_dma(file)), np.array([0.01, 0.04])
    problem, causes = dma_problem(data, FRACTIONAL), {cause.name: cause for cause in DMA_CAUSES}
    extensions = [Extension(causes[name], 0.0) for name in LIKE]
    told = dma_design._separation(problem, extensions, np.array([0.05, 0.3]), size)
    over = np.tile(size, problem.rows)[:, None]
    basis = np.linalg.qr(problem.fitted_directions() / over)[0]
    for place, one in enumerate(problem.directions(extensions)):
        left = one.directions / over - basis @ (basis.T @ (one.directions / over))
        assert told.d_prime[place] == pytest.approx((0.05, 0.3)[place] * np.linalg.norm(left))
    read = dma_design._simulated(data, dataclasses.replace(problem, seed=5), extensions[0], 0.0, size)
    noise = dma_problem(read, FRACTIONAL).measured - (problem.measured - problem.residuals().reshape(-1, 2))
    # Of 70 numbers each, known to 8 %: four of these.
    assert np.std(noise, axis=0) == pytest.approx(size, rel=0.34)
    assert (
        report._noise(dataclasses.replace(NOTHING, sizes=tuple(size)))
        == "1 % in the magnitude and 40 mrad in the phase"
    )
    assert report._noise(dataclasses.replace(NOTHING, sizes=(0.02, 0.02))) == "2 %"


def test_causes_are_told_apart_as_strong_as_they_are_or_as_would_be_seen(found):
    """Of the sign that the data give them; of one that cannot be negative that is 1."""
    given = {
        "sweep-drift": (-0.5, 0.2, None, "possible"),
        "frame-resonance": (-0.01, 0.3, 1.75, "named"),
        "slip": (0.0, 0.4, None, "confusable"),
        "drying": (0.9, 0.1, None, "not needed"),
    }
    reports = {one.cause.name: one for one in found.causes}
    causes = tuple(
        dataclasses.replace(reports[name], estimate=estimate, detectability=seen, shape=shape, status=status)
        for name, (estimate, seen, shape, status) in given.items()
    )
    decision = dataclasses.replace(found.decision, explanations=())
    told = dataclasses.replace(found, causes=causes, decision=decision)
    extensions, strengths = alive(told, (), DMA_CAUSES)
    assert [(one.cause.name, one.shape) for one in extensions] == [
        ("sweep-drift", 0.0), ("frame-resonance", 1.75), ("slip", 0.0),
    ]  # fmt: skip
    np.testing.assert_array_equal(strengths, [-0.5, -0.3, 0.4])
    # None is stronger than there is such an effect; one of either sign that was found to be 0 is taken for positive.
    weak = tuple(dataclasses.replace(one, estimate=0.0, detectability=1.5) for one in causes)
    np.testing.assert_array_equal(alive(dataclasses.replace(told, causes=weak), (), DMA_CAUSES)[1], [1.5, 1.5, 0.95])
    weak = tuple(dataclasses.replace(one, estimate=-0.1) for one in weak)
    np.testing.assert_array_equal(alive(dataclasses.replace(told, causes=weak), (), DMA_CAUSES)[1], [-0.95, -1.5, 0.95])
    # Of one alone, and of none, the likeliest others beside it.
    wanted, (strength, _) = alive(told, ("drying",), DMA_CAUSES)
    assert [one.cause.name for one in wanted] == ["drying", "sweep-drift"] and strength == 0.9
    nothing = tuple(dataclasses.replace(one, status="ruled out") for one in causes)
    likeliest = alive(dataclasses.replace(told, causes=nothing), (), DMA_CAUSES)[0]
    assert [one.cause.name for one in likeliest] == ["sweep-drift", "frame-resonance"]


def measured_again(name, words, seconds, readings):
    time = np.linspace(100.0, 100.0 + seconds, readings)
    return DmaProposal(name, words, np.ones(readings), np.full(readings, 20.0), time, "")


def apart(angle, d_prime):
    """Of two causes of one sign at an angle [deg], each of a d'."""
    turned = np.radians(angle)
    directions = np.array([[1.0, np.cos(turned)], [0.0, np.sin(turned)], [0.0, 0.0]])
    return separation(("slip", "drying"), directions, np.array([d_prime, d_prime]), np.zeros((3, 0)), 1.0, (1, 1))


def right(angle, d_prime):
    """Half the distance of both, in standard deviations."""
    return float(stats.norm.cdf(d_prime * np.sin(0.5 * np.radians(angle))))


def rated(*angles):
    """Of d' 6 with what there is at 30 degrees."""
    proposals = [
        measured_again("again", "the same once more", 600.0, 7),
        measured_again("other", "something else", 1200.0, 13),
    ]
    known = Information(("slip", "drying"), np.array([20.0, 40.0]), np.array([1.0, 10.0, 100.0]),
                        np.array([[0.1, 0.2, 0.1], [0.3, 0.5, 0.4]]), 40.0, 12.5, 0.7)  # fmt: skip
    return Design(
        "confusable", {"slip": 0.25, "drying": 0.125}, apart(30.0, 6.0),
        tuple(Rated(one, apart(angle, 6.0)) for one, angle in zip(proposals, angles, strict=True)),
        (Check("slip", "named", ("slip",), ()), Check("drying", "confusable", (), ("slip", "drying"))),
        (0.02, 0.03), 4, ("a note",), known,
    )  # fmt: skip


def test_what_a_design_says_in_json_is_what_it_found():
    told = rated(80.0, 50.0)
    content = as_json(told)
    require_design_keys(content)
    json.dumps(content, allow_nan=False)
    assert content["causes"] == {"slip": 0.25, "drying": 0.125} and content["noise"] == [0.02, 0.03]
    assert content["now"]["probability_right"] == pytest.approx(right(30.0, 6.0))
    assert content["now"]["d_prime"] == pytest.approx({"slip": 6.0, "drying": 6.0})
    assert [(one["name"], one["words"], one["readings"], one["seconds"]) for one in content["proposals"]] == [
        ("again", "the same once more", 7, 600.0), ("other", "something else", 13, 1200.0),
    ]  # fmt: skip
    assert [one["angle_deg"] for one in content["proposals"]] == pytest.approx([80.0, 50.0])
    assert content["reading"] == {
        "causes": ["slip", "drying"], "temperature_c": 40.0, "frequency_hz": 12.5, "information_nat": 0.7,
    }  # fmt: skip
    assert content["checks"][1] == {
        "hidden": "drying", "verdict": "confusable", "named": [], "confusable": ["slip", "drying"],
    }  # fmt: skip
    short = report.in_short(told)
    assert short["angle_deg"] == pytest.approx(30.0) and short["causes"] == ["slip", "drying"]
    assert short["measurement"]["words"] == "the same once more" and short["measurement"]["readings"] == 7
    assert short["measurement"]["angle_deg"] == pytest.approx(80.0)
    assert short["measurement"]["probability_right"] == pytest.approx(right(80.0, 6.0))
    assert report.in_short(dataclasses.replace(told, rated=()))["measurement"] is None


def test_what_a_design_says_in_words_is_what_it_found():
    """Right in 94 of 100 cases at 30 degrees, in more than 99 at 80, in 98 at 40."""
    now, then = (round(100.0 * right(angle, 6.0)) for angle in (30.0, 40.0))
    assert (now, then) == (94, 98) and right(80.0, 6.0) > 0.995
    (words,) = report.in_words(rated(80.0, 40.0))
    assert "What slip and drying do to these data" in words and "is as little as 30 degrees apart" in words
    assert "would look likelier in 94 % of cases at least" in words
    assert (
        "Of 2 measurements that could be made next, the same once more separates them best: 80 degrees, more" in words
    )
    assert "more than 99 %." in words
    assert "40 degrees, 98 %." in report.in_words(rated(40.0, 35.0))[0]
    assert (
        "None of 2 measurements that could be made next separates them better" in report.in_words(rated(29.0, 20.0))[0]
    )
    text = report.report(rated(40.0, 35.0), "data.csv", ["design.png"])
    assert "To be told apart: slip (0.25), drying (0.125)." in text
    assert "likelier in 94 % of cases at least; with the same once more, in 98 %." in text
    assert "| nothing more |  | 94 % | 6.0 | 6.0 |" in text and "| the same once more | 7 | 98 % | 6.0 | 6.0 |" in text
    assert "| slip | named | slip |" in text and "| drying | confusable | slip or drying |" in text
    assert "noise of 2 % in the magnitude and 30 mrad in the phase" in text and "![design.png](design.png)" in text


@pytest.mark.parametrize(("nat", "words"), [(3.1, "no more than one"), (0.7, "5 such or more"), (1e-4, "too many")])
def test_how_many_readings_make_it_twenty_to_one(nat, words):
    """Of which the logarithm is 3.0."""
    told = rated(40.0, 35.0)
    assert told.information is not None
    information = dataclasses.replace(told.information, best=nat)
    text = report.report(dataclasses.replace(told, information=information), "data.csv")
    assert "A single reading would tell slip from drying best at 40 degC and 12.5 Hz" in text
    assert f"favour the true one by {nat:.2g} nat. Twenty to one takes {words}." in text


def test_the_figure_has_the_odds_of_every_measurement_by_its_name():
    told = rated(80.0, 40.0)
    ratings, information = design_figure(told).axes
    names = [label.get_text() for label in ratings.get_yticklabels()]
    odds = dict(zip(names, [bar.get_width() for bar in ratings.patches if isinstance(bar, Rectangle)], strict=True))
    chances = {"nothing more": right(30.0, 6.0), "again": right(80.0, 6.0), "other": right(40.0, 6.0)}
    assert odds == pytest.approx({name: np.log10(p / (1.0 - p)) for name, p in chances.items()})
    # The best on top, each with its chance beside it.
    assert names == ["nothing more", "other", "again"]
    assert [text.get_text().strip() for text in ratings.texts] == ["94 %", "98 %", "> 99.9 %"]
    curves = {line.get_label(): np.asarray(line.get_xydata()) for line in information.lines}
    np.testing.assert_allclose(curves["40 degC"], [[1.0, 0.3], [10.0, 0.5], [100.0, 0.4]])
    assert [12.5, 0.7] in [np.asarray(line.get_xydata())[0].tolist() for line in information.lines]


def test_further_readings_come_at_the_pace_of_those_that_were_taken():
    """Every ten seconds, with two minutes more to another temperature."""
    frequency, temperature = np.tile(np.geomspace(0.1, 100.0, 8), 3), np.repeat([20.0, 30.0, 40.0], 8)
    clock = 10.0 * np.arange(24.0) + 120.0 * np.repeat([0.0, 1.0, 2.0], 8)
    data = dataclasses.replace(dma_data(frequency, temperature, np.full(24, 1e3)), time_s=clock)
    proposals = {one.name: one for one in dma_proposals(data)}
    np.testing.assert_allclose(proposals["again"].time, clock + clock[-1] + 130.0)
    assert proposals["again"].seconds == clock[-1] and len(proposals["again"]) == 24
    lower = proposals["lower-frequencies"]
    assert len(lower) == 3 * 7 and lower.frequency.min() == pytest.approx(0.01)
    np.testing.assert_allclose(np.diff(np.log10(lower.frequency[:7])), 1.0 / 7.0)
    assert proposals["higher-frequencies"].frequency.max() == pytest.approx(1e3)
    assert proposals["between"].words == "sweeps at 25, 35 degC, between those that were measured"
    timeless = {one.name: one for one in dma_proposals(dataclasses.replace(data, time_s=None))}
    assert timeless["again"].seconds is None


def test_between_temperatures_the_solid_is_between_those_that_were_fitted(file):
    """Half way the geometric mean of moduli and times, and the mean of the orders; beyond the ends as there."""
    problem = dma_problem(read_dma(file), FRACTIONAL)
    temperature = [one.temperature_c for one in problem.sweeps]
    first, second, last = (problem.constants[place] for place in (0, 1, -1))
    found = dma_design._constants_at(problem, "", 0.5 * (temperature[0] + temperature[1]))
    np.testing.assert_allclose(found, [*np.sqrt(first * second)[:3], 0.5 * (first + second)[3]], rtol=1e-9)
    np.testing.assert_allclose(dma_design._constants_at(problem, "", temperature[-1] + 20.0), last, rtol=1e-12)
    np.testing.assert_allclose(dma_design._constants_at(problem, "", temperature[1]), second, rtol=1e-12)


def test_one_more_reading_is_the_first_of_a_visit_after_all_others(file):
    """At a temperature that was measured; what it comes from is the one that was measured last."""
    problem = dma_problem(read_dma(file), FRACTIONAL)
    was, now = problem.conditions, dma_information._one_more(problem, jnp.asarray(1), jnp.log(jnp.asarray(7.0)))
    assert len(now.time) == problem.rows + 1 and float(now.angular_frequency[-1]) == pytest.approx(7.0)
    here = np.asarray(was.sweep) == 1
    assert float(now.temperature[-1]) in np.asarray(was.temperature)[here]
    assert float(now.level[-1]) == np.asarray(was.level)[here][0] and int(now.sweep[-1]) == 1
    last = int(np.argmax(np.asarray(was.time)))
    assert (float(now.time[-1]), float(now.exposure[-1])) == (float(was.time[last]), float(was.exposure[last]))
    assert int(now.sweep_before[-1]) == int(was.sweep[last]) == len(problem.sweeps) - 1
    assert float(now.time_in_sweep[-1]) == 0.0 and int(now.visit[-1]) == int(np.max(was.visit)) + 1
