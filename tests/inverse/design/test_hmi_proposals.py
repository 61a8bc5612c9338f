"""Which sonications are proposed at the edges of what is worth one."""

import numpy as np
import pytest

from arfjax import SineIntensity, StepwiseProtocol
from inverse.design.hmi_proposals import hmi_proposals


def names(*, reference=37.0, hottest=75.0, readings=13, **protocol):
    usual = StepwiseProtocol(start_temperature=35.0, **protocol)
    return {one.name: one for one in hmi_proposals(usual, reference=reference, hottest=hottest, readings=readings)}


@pytest.mark.parametrize(("hottest", "proposed"), [(54.0, False), (55.0, False), (55.1, True)])
def test_one_without_coagulation_ends_well_below_the_usual(hottest, proposed):
    """By more than five kelvin: else it is the usual one."""
    assert ("not-coagulating" in names(hottest=hottest)) is proposed


@pytest.mark.parametrize("reference", [37.0, 47.0, 48.0, 50.0])
def test_no_reading_is_colder_than_the_reference_and_none_is_written_twice(reference):
    """A second one at the reference would count for as much as it, and as one that curves were divided by."""
    for one in names(reference=reference).values():
        assert one.temperature[0] == reference and np.all(np.diff(one.temperature) > 0.0) and len(one) == 13


def test_one_reading_is_none_around_coagulation():
    """Nor are two, of which the first is at the reference, and the other would end the sonication where it begins."""
    assert "around-coagulation" not in {*names(readings=1), *names(readings=2)}
    assert "around-coagulation" in names(readings=3)


def test_the_longest_push_of_an_experiment_file_is_proposed():
    assert {"longer-push", "modulated-push", "later-reading"} <= set(names(push_duration=10e-3))


def test_the_shortest_push_and_the_longest_and_shortest_sonication_of_an_experiment_file_are_proposed():
    assert "shorter-push" in names(push_duration=0.02e-3)
    assert "slower" in names(duration=90.0) and "faster" in names(duration=0.2)


@pytest.mark.parametrize(
    ("name", "hottest", "proposed"),
    [
        ("hotter", 82.0, True),
        ("hotter", 82.1, False),
        ("around-coagulation", 53.0, False),
        ("around-coagulation", 53.1, True),
    ],
)
def test_no_sonication_is_hotter_than_90_degrees_and_none_is_read_over_five_kelvin_alone(name, hottest, proposed):
    assert (name in names(hottest=hottest)) is proposed


def test_words_say_what_is_another_than_usual():
    """Lengths of pushes, with their unit; of a modulated one that of the whole course."""
    usual, modulated = names(), names(modulation=SineIntensity())
    assert [usual[name].words for name in ("shorter-push", "longer-push", "modulated-push")] == [
        "pushes of 0.25 ms instead of 0.5",
        "pushes of 1 ms instead of 0.5",
        "pushes of 1 ms whose force rises and falls as one period of a sine, instead of 0.5 ms of constant force",
    ]
    assert modulated["longer-push"].words == "pushes whose course takes 1 ms instead of 0.5"
    assert usual["slower"].words == "a sonication to 75 degC in 120 s instead of 60"
    assert usual["hotter"].words == "a sonication to 83 degC"
    assert usual["not-coagulating"].words == "a sonication that ends at 50 degC"
    assert usual["around-coagulation"].words == "a sonication that ends at 60 degC, read from 48 degC on only"


@pytest.mark.parametrize("push", [0.45, 0.65, 0.1])
def test_a_push_stands_in_an_experiment_file_as_a_person_writes_it(push):
    """0.45 ms, where 1e3 x 0.45e-3 is 0.45000000000000007."""
    assert names(push_duration=1e-3 * push)["again"].keys["push_ms"] == push
