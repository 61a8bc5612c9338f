"""What a diagnosis tells, number by number: in JSON, in the report, in the terminal and in its figure."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import same_color

import inverse
from arfjax import InputError
from inverse.commands.diagnose import _show
from inverse.design.design import Design
from inverse.design.separation import separation
from inverse.diagnosed import _Asked
from inverse.diagnosis.cause import every_shape
from inverse.diagnosis.content import as_json
from inverse.diagnosis.examination import NotTestable
from inverse.diagnosis.gain import Gain
from inverse.diagnosis.report import report
from inverse.diagnosis.where import Whiteness
from inverse.figures.diagnosis import LABELS, diagnosis_figure
from tests.blind import dma_generator as blind

NUMBERS = {
    "statistic": 5.25, "p_value": 0.21, "p_alone": 0.032, "estimate": 0.43, "interval": (0.31, 0.57),
    "detectability": 0.067, "left": 0.77, "shape": 0.81,
}  # fmt: skip
"""No two alike."""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hidden")
    blind.write(
        folder / "data.csv", folder / "key.json", seed=blind.TEST_SEEDS + 5001, name="sweep-drift", d_prime=12.0
    )
    return inverse.diagnose(folder / "data.csv", causes=["sweep-drift", "slip", "drying"], gain=False)


@pytest.fixture(scope="module")
def found(told):
    return told.details


def with_first(found, **fields):
    """The same, its likeliest cause with other numbers and alone."""
    return dataclasses.replace(found, causes=(dataclasses.replace(found.causes[0], **NUMBERS | fields),))


def test_every_number_has_its_key(found):
    (one,) = with_first(found, status="possible", converged=False).causes
    assert found.decision is not None and one.cause.name == "sweep-drift"
    omnibus = dataclasses.replace(found.decision.omnibus, statistic=4.125, p_value=0.0625)
    other = dataclasses.replace(found, causes=(one,), decision=dataclasses.replace(found.decision, omnibus=omnibus))
    hidden, course = NotTestable("slip", "too weak", "a rough grip."), Whiteness("time", -0.25, 0.4)
    worth = Gain("in turn", 0.05, 0.004, 0.02, 0.001, 0.3, 0.04, 2)
    other = dataclasses.replace(other, not_testable=(hidden,), residuals_whiteness=(course,), gain=worth)
    content = as_json(other, ["a remark"])
    assert content["causes"] == [
        {
            "name": "sweep-drift",
            "place": one.cause.place,
            "p_value": 0.21,
            "p_value_alone": 0.032,
            "statistic": 5.25,
            "estimate": 0.43,
            "interval": [0.31, 0.57],
            "unit": "1 per sweep",
            "shape": 0.81,
            "shape_means": "",
            "detectability": 0.067,
            "status": "possible",
            "p_value_of_the_rest": 0.77,
            "converged": False,
            "physics": one.cause.sentence,
            "source": one.cause.source,
        }
    ]
    assert (content["omnibus"]["statistic"], content["omnibus"]["p_value"]) == (4.125, 0.0625)
    assert content["not_testable"] == [{"name": "slip", "why": "too weak", "what_would_help": "a rough grip."}]
    assert content["whiteness"] == [{"along": "time", "correlation": -0.25, "p_value": 0.4}]
    assert (content["gain"]["rmse_before"], content["gain"]["rmse_after"]) == (0.05, 0.02)
    assert content["notes"] == ["a remark", *found.account.notes]


def test_every_number_stands_in_its_column_of_the_report(found):
    columns = (
        "| cause | place | t | p | p alone | p of the rest | strength | 95 % | would be seen from | unit | status |"
    )
    place = found.causes[0].cause.place
    row = "| 5.25 | 0.21 | 0.032 | 0.77 | 0.43 | 0.31 to 0.57 | 0.067 | 1 per sweep | possible"
    for converged, words in ((True, ""), (False, " (the refit did not converge)")):
        text = report(with_first(found, status="possible", converged=converged), "these data", [])
        assert columns in text and f"| sweep-drift | {place} {row}{words} |" in text


@pytest.mark.parametrize(("strength", "is_far"), [(0.99, False), (1.01, True), (-1.01, True)])
def test_a_strength_that_nobody_would_believe_is_said_to_be_none(found, strength, is_far):
    """A tenth of a sweep is what one would believe of a drift; ten times that is not."""
    text = report(with_first(found, status="named", estimate=strength), "these data", [])
    assert f"Strength {strength:.3g} 1 per sweep (0.31 to 0.57 at 95 %)" in text
    far = "That is more than 10 times what one would believe (0.1 1 per sweep)."
    assert (far in text) == is_far


@pytest.mark.parametrize(("gain", "course"), [(0.3, "rises"), (-0.3, "falls")])
def test_what_the_extension_is_worth_is_said_in_percent_and_nat(found, gain, course):
    worth = Gain("each left out in turn", 0.05, 0.004, 0.02, 0.001, gain, 0.04, 2)
    text = report(dataclasses.replace(found, gain=worth), "these data", [])
    assert (
        "With sweep-drift in the model, differences from data that were left out (each left out in turn) go from "
        f"5 ± 0.4 to 2 ± 0.1 % (root mean square); the log score {course} by 0.3 ± 0.04 nat a datum."
    ) in text
    assert "2 of the refits did not converge." in text
    whole = dataclasses.replace(found, gain=dataclasses.replace(worth, unfinished=0))
    assert "of the refits did not converge" not in report(whole, "these data", [])


def test_what_is_known_of_the_noise_is_said_with_its_p_values(found):
    gate = dataclasses.replace(
        found.noise, size=0.0123, p_white=0.21, p_tails=0.32, p_sizes=0.5, p_size=np.nan, repeats=0.0456,
        repeats_freedom=7, p_repeats=0.33, weighed=False,
    )  # fmt: skip
    text = report(dataclasses.replace(found, noise=gate), "these data", [])
    assert "size 0.0123 (relative). White noise of one size looks so with p = 0.21, Gaussian noise" in text
    assert "such tails with p = 0.32 (each counts below 0.01)" in text
    assert "scatter by 0.0456 (7 degrees of freedom); that noise leaves residuals as large with p = 0.33" in text
    assert gate.as_thought and "do not need white noise" not in text
    strange = dataclasses.replace(gate, p_tails=0.001)
    assert "do not need white noise" in report(dataclasses.replace(found, noise=strange), "these data", [])


def test_where_and_what_cannot_be_seen_are_told(found):
    hidden = (NotTestable("slip", "it is too weak", "A rough grip."),)
    course = (Whiteness("time", -0.25, 0.4), Whiteness("frequency", 0.126, 1.0 / 401.0))
    text = report(dataclasses.replace(found, not_testable=hidden, residuals_whiteness=course), "these data", [])
    assert "- **slip**: it is too weak. A rough grip." in text
    # A p-value that is the least that 400 replicates of white noise can show is a bound.
    assert "| time | -0.25 | 0.4 |" in text and "| frequency | +0.13 | ≤ 0.0025 |" in text


def test_what_would_be_seen_is_four_and_a_half_deviations_beside_everything_that_is_fitted(found):
    """By the noise that the model with what is named in it leaves, white here."""
    slip = next(one for one in found.causes if one.cause.name == "slip")
    assert found.named == ("sweep-drift",) and found.decision.last.null_noise == 0
    problem, left = found.problem, found.extended.residuals
    fitted = np.linalg.qr(found.extended.directions)[0]
    spread = np.sqrt(left @ (left - fitted @ (fitted.T @ left)) / (len(left) - fitted.shape[1]))
    plain = np.linalg.qr(problem.fitted_directions())[0]
    direction = problem.directions(every_shape([slip.cause]))[0].directions[:, 0]
    seen = np.linalg.norm(direction - plain @ (plain.T @ direction)) * slip.detectability / spread
    # Constants are those of the fit in the likeliest noise without a cause, which may be another one.
    assert seen == pytest.approx(4.5, rel=0.05)


def test_bars_are_the_statistics_of_the_causes_that_they_are_called_by(found):
    given = {"sweep-drift": (-9.5, "named"), "slip": (-2.5, "ruled out"), "drying": (4.0, "possible")}
    causes = tuple(
        dataclasses.replace(one, statistic=given[one.cause.name][0], status=given[one.cause.name][1])
        for one in found.causes
    )
    axis = diagnosis_figure(dataclasses.replace(found, causes=causes)).axes[-1]
    names = [label.get_text() for label in axis.get_yticklabels()]
    bars = {names[round(bar.get_y() + 0.5 * bar.get_height())]: bar for bar in axis.patches}
    # A strength that cannot be negative and came out so has no evidence for it.
    assert {name: bar.get_width() for name, bar in bars.items()} == {"sweep-drift": 9.5, "slip": 0.0, "drying": 4.0}
    assert names[-1] == found.causes[0].cause.name
    legend = axis.get_legend()
    shown = {
        text.get_text(): patch.get_facecolor() for text, patch in zip(legend.texts, legend.get_patches(), strict=True)
    }
    assert list(shown) == ["named", "possible", "ruled out", "not needed"]
    assert all(same_color(bars[name].get_facecolor(), shown[status]) for name, (_, status) in given.items())


def test_residuals_are_drawn_in_percent_and_milliradian_without_and_with_the_cause(found):
    axes, problem = diagnosis_figure(found).axes, found.problem
    assert [axis.get_title() for axis in axes[:2]] == ["the fitted model", "with sweep-drift"]
    assert [axes[place].get_ylabel() for place in (0, 2)] == list(LABELS)
    frequency = np.asarray(problem.conditions.angular_frequency) / (2.0 * np.pi)
    for column, residuals in enumerate((found.residuals, found.extended.residuals)):
        relative = residuals.reshape(problem.weights.shape) / problem.weights * np.array([100.0, 1e3])
        for coordinate in (0, 1):
            lines = axes[2 * coordinate + column].lines
            drawn = np.concatenate([line.get_xydata() for line in lines if len(line.get_xdata()) > 2])
            expected = np.stack([frequency, relative[:, coordinate]], axis=-1)
            np.testing.assert_allclose(drawn[np.lexsort(drawn.T)], expected[np.lexsort(expected.T)])
            low, high = axes[2 * coordinate + column].get_ylim()
            assert low == -high and (low, high) == axes[2 * coordinate].get_ylim()


def shown_of(told, capsys, found, separation=()):
    content = {**told.content, "separation": list(separation)}
    _show(dataclasses.replace(told, details=found, content=content), Path("out"))
    return " ".join(capsys.readouterr().out.split())


def test_the_terminal_shows_strength_and_interval_of_the_likeliest_cause(told, found, capsys):
    named = with_first(found, status="named")
    words = shown_of(told, capsys, dataclasses.replace(named, not_testable=(NotTestable("slip", "weak", "Grip."),)))
    row = re.search(r"sweep-drift\W+0\.21\W+0\.43\W+0\.31 to 0\.57\W+1 per sweep\W+named", words)
    assert row and "verdict: named (sweep-drift)" in words and "not testable with these data: slip" in words


@pytest.mark.parametrize(
    ("then", "said"),
    [
        (0.9, "a rough grip (70 % -> 90 %)"),
        (0.997, "a rough grip (70 % -> more than 99 %)"),
        (0.6, "none of the measurements rated"),
    ],
)
def test_the_terminal_says_which_measurement_would_tell_them_apart(told, found, capsys, then, said):
    apart = {"probability_right": 0.7, "measurement": {"words": "a rough grip", "probability_right": then}}
    assert f"to tell them apart: {said}" in shown_of(told, capsys, found, [apart])
    assert "to tell them apart" not in shown_of(told, capsys, found, [{**apart, "measurement": None}])


def concluded(found, *explanations):
    decision = dataclasses.replace(found.decision, verdict="confusable", explanations=explanations)
    return dataclasses.replace(found, verdict="confusable", decision=decision)


@pytest.mark.parametrize(
    ("explanations", "separate", "asked"),
    [
        ((("slip",), ("drying",)), True, ["slip", "drying"]),
        ((("slip",), ("drying",)), False, None),
        # Of sets of two what would separate them is not rated, and of one alone there is nothing to separate.
        ((("slip", "drying"), ("slip", "sweep-drift")), True, None),
        ((("slip",),), True, None),
    ],
)
def test_a_measurement_is_looked_for_where_each_of_several_explains_the_data_alone(
    found, explanations, separate, asked
):
    wanted = []
    directions = np.random.default_rng(1).standard_normal((9, 2))
    apart = separation(("slip", "drying"), directions, np.ones(2), np.zeros((9, 0)), 1.0, (1, 1))

    def design(names):
        wanted.append(list(names))
        return Design("confusable", {"slip": 1.0, "drying": 1.0}, apart, (), (), (), 0)

    asked_for = _Asked((), 0.05, 0, False, separate, lambda _: None)
    answer = asked_for.answered(concluded(found, *explanations), "these data", ("a remark",), design)
    assert wanted == ([] if asked is None else [asked]) and answer.remarks == ("a remark",)
    said = [] if asked is None else [asked]
    assert [one["causes"] for one in answer.content["separation"]] == said and (answer.design is None) == (not said)


def test_a_diagnosis_stands_where_no_further_measurement_can_be_designed(found):
    def design(names):
        raise InputError("sweeps cannot be told apart.")

    asked_for = _Asked((), 0.05, 0, False, True, lambda _: None)
    answer = asked_for.answered(concluded(found, ("slip",), ("drying",)), "these data", ("a remark",), design)
    said = "Which measurement would tell them apart is not known: sweeps cannot be told apart."
    assert answer.remarks == ("a remark", said) and said in answer.content["notes"]
    assert answer.content["separation"] == [] and answer.design is None and answer.verdict == "confusable"
