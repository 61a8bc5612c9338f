"""The next measurement: its geometry, and that it does what is promised of it."""

import dataclasses
import json

import numpy as np
import pytest

from arfjax import InputError
from inverse.commands.main import run
from inverse.datasets.dma import dma_data, read_dma
from inverse.design import design_dma, dma_design, report
from inverse.design.design import Design, alive, reasons
from inverse.design.dma_information import dma_information
from inverse.design.dma_proposals import dma_proposals
from inverse.design.report import as_json
from inverse.design.separation import separation
from inverse.diagnosis import DMA_CAUSES, diagnose_dma
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.dma.problem import dma_problem
from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.screening import Alternative, Screen
from inverse.dma_fit import FRACTIONAL
from tests.blind import dma_generator as blind
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


def test_what_is_written_twice_is_rated_once(file, found):
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
    with pytest.raises(InputError, match="cannot see 'clamp-compliance'; they see"):
        design_dma(data, found=found, causes=("slip", "clamp-compliance"))
    with pytest.raises(InputError, match="these data see fewer than two"):
        design_dma(data, found=dataclasses.replace(found, causes=found.causes[:1]))
    twice = design_dma(data, found=found, causes=("slip", "slip", "drying"), check=False, locate=False)
    assert twice.now.names == ("slip", "drying") and twice.information is None and twice.notes == ()
    require_design_keys(as_json(twice))
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


@pytest.mark.slow
def test_a_reading_tells_what_the_other_cause_and_the_constants_cannot_imitate(found):
    """Neither cause looks at the time: where something was measured already, it tells as much as that did."""
    problem, known = found.problem, {one.cause.name: one for one in found.causes}
    extensions = [Extension(known[name].cause, known[name].shape or 0.0) for name in STEADY]
    strengths, size = np.array([known[name].detectability for name in STEADY]), np.array([0.02, 0.03])
    told = dma_information(problem, extensions, strengths, size)
    moved = [one.directions[:, 0] for one in problem.directions(extensions)]
    effects = [strength * one for strength, one in zip(strengths, moved, strict=True)]
    expected = []
    for true, rival in (effects, effects[::-1]):
        basis = np.linalg.qr(np.column_stack([problem.fitted_directions(), rival]))[0]
        left = (true - basis @ (basis.T @ true)) / problem.weights.ravel()
        expected.append(0.5 * np.sum((left.reshape(-1, 2) / size) ** 2, axis=1))
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
