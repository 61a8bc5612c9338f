"""What a design says in special cases: nothing better, nothing certain, what was noted, and how an answer is listed."""

import dataclasses

import numpy as np
import pytest
from matplotlib.patches import Rectangle
from scipy import stats

from arfjax import StepwiseProtocol
from inverse.design import report
from inverse.design.design import Check, Design, Rated
from inverse.design.dma_information import Information
from inverse.design.dma_proposals import DmaProposal
from inverse.design.hmi_proposals import hmi_proposals
from inverse.design.separation import Separation
from inverse.figures.design import design_figure


def of_probability(right):
    """Two causes of one sign at right angles, the right one likelier so often."""
    d_prime = np.full(2, np.sqrt(2.0) * min(stats.norm.ppf(right), 50.0))
    return Separation(("slip", "drying"), d_prime, np.eye(2), np.ones(2, dtype=bool))


def design(now, *rated, proposal=None, **more):
    if proposal is None:
        proposal = DmaProposal("again", "the same once more", np.ones(3), np.full(3, 20.0), np.arange(3.0), "")
    found = tuple(Rated(proposal, of_probability(one)) for one in rated)
    return Design("confusable", {"slip": 0.2, "drying": 0.1}, of_probability(now), found, (), (0.02,), 0, **more)


@pytest.mark.parametrize(
    ("right", "words"), [(0.5, "50 %"), (0.944, "94 %"), (0.99, "99 %"), (0.9949, "99 %"), (0.9951, "more than 99 %")]
)
def test_nothing_is_certain_in_words(right, words):
    """In the report of a diagnosis as in that of a design; `100 % at least` nobody knows."""
    found = design(0.5, right)
    text = report.report(found, "data.csv")
    assert f"with the same once more, in {words}." in text and f"| the same once more | 3 | {words} |" in text
    assert report.percent(right) == words
    if right > 0.5:
        assert f"90 degrees, {words}." in report.in_words(found)[0]


def test_what_separates_as_well_as_what_there_is_separates_no_better():
    assert "None of 1 measurements" in report.in_words(design(0.9, 0.9))[0]
    assert "None of 1 measurements" in report.in_words(design(1.0, 1.0))[0]
    assert "separates them best" in report.in_words(design(0.9, 0.9001))[0]


def test_what_was_noted_is_said_with_proposals_and_without():
    noted = ("The first.", "The second.")
    assert "\nThe first.\n\nThe second.\n" in report.report(design(0.9, 0.95, notes=noted), "data.csv")
    assert report.in_words(design(0.9, notes=noted)) == list(noted)
    without = report.report(design(0.9, notes=noted), "data.csv")
    assert "after data.csv" in without and "The second." in without


def test_one_that_is_named_is_what_a_simulation_said_although_others_may_stand_beside_it():
    checks = (
        Check("slip", "confusable", ("slip",), ("drying", "sweep-drift")),
        Check("drying", "unexplained", (), ()),
    )
    text = report.report(dataclasses.replace(design(0.9, 0.95), checks=checks), "data.csv")
    assert "## again, simulated and diagnosed again" in text
    assert "| slip | confusable | slip |" in text and "| drying | unexplained | - |" in text


def test_keys_of_an_experiment_file_are_written_as_that_file_has_them():
    """A text in quotes, a number without."""
    usual = StepwiseProtocol(start_temperature=35.0, duration=0.5, push_duration=0.3e-3)
    found = {one.name: one for one in hmi_proposals(usual, reference=37.0, hottest=75.0, readings=13)}
    text = report.report(design(0.9, 0.95, proposal=found["modulated-push"]), "curves.csv")
    assert '`sonication_s = 0.5`, `push_ms = 0.6`, `push_modulation = "intensity"`' in text


@pytest.mark.parametrize(("duration", "push_ms"), [(60.0, 0.5), (0.5, 0.25), (45.0, 0.125), (7.5, 2.05)])
def test_words_of_a_sonication_have_its_seconds_and_milliseconds(duration, push_ms):
    """Of one of half a second no `0 s`, of a push of an eighth of a millisecond no `0.12 ms`."""
    usual = StepwiseProtocol(start_temperature=35.0, duration=duration, push_duration=1e-3 * push_ms)
    found = {one.name: one for one in hmi_proposals(usual, reference=37.0, hottest=75.0, readings=13)}
    for name in ("slower", "faster"):
        assert found[name].words.endswith(f" in {found[name].seconds:g} s instead of {duration:g}")
    for name in ("shorter-push", "longer-push"):
        assert f"of {found[name].keys['push_ms']:g} ms instead of {push_ms:g}" in found[name].words
    assert f"pushes of {2.0 * push_ms:g} ms whose force" in found["modulated-push"].words
    assert f"read {0.5 * push_ms:g} ms after" in found["later-reading"].words


def test_a_figure_of_curves_has_no_information_and_no_odds_below_even():
    found = design(0.5, 0.9996, 0.9994)
    (axis,) = design_figure(found).axes
    bars = [bar.get_width() for bar in axis.patches if isinstance(bar, Rectangle)]
    assert bars == pytest.approx([0.0, np.log10(0.9994 / 6e-4), np.log10(2499.0)])
    assert [text.get_text().strip() for text in axis.texts] == ["50 %", "99.9 %", "> 99.9 %"]


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_figure_shows_three_decades_of_information_below_the_best_and_the_hottest_brightest(scale):
    nat = scale * np.array([[0.1, 0.2, 0.1], [0.3, 0.5, 0.4], [0.2, 0.2, 0.2]])
    temperature, frequency = np.array([20.0, 30.0, 40.0]), np.array([1.0, 10.0, 100.0])
    known = Information(("slip", "drying"), temperature, frequency, nat, 30.0, 9.0, float(nat.max()))
    _, axis = design_figure(design(0.5, 0.9, information=known)).axes
    low, high = axis.get_ylim()
    assert high == pytest.approx(2.0 * nat.max()) and low == pytest.approx(1e-3 * nat.max())
    lines = {line.get_label(): line.get_color() for line in axis.lines}
    brightness = [np.dot(lines[f"{one:.0f} degC"][:3], [0.3, 0.6, 0.1]) for one in temperature]
    assert brightness == sorted(brightness) and len(set(brightness)) == 3
