"""Which sonications are proposed at the edges of what is worth one."""

import numpy as np
import pytest

from arfjax import StepwiseProtocol
from inverse.design.hmi_proposals import hmi_proposals


def names(*, reference=37.0, hottest=75.0, readings=13, push_duration=0.5e-3):
    usual = StepwiseProtocol(start_temperature=35.0, push_duration=push_duration)
    return {one.name: one for one in hmi_proposals(usual, reference=reference, hottest=hottest, readings=readings)}


@pytest.mark.parametrize(("hottest", "proposed"), [(54.0, False), (55.0, False), (55.1, True)])
def test_one_without_coagulation_ends_well_below_the_usual(hottest, proposed):
    """By more than five kelvin: else it is the usual one."""
    assert ("not-coagulating" in names(hottest=hottest)) is proposed


@pytest.mark.parametrize("reference", [37.0, 47.0, 50.0])
def test_no_reading_is_colder_than_the_reference(reference):
    for one in names(reference=reference).values():
        assert one.temperature[0] == reference and np.all(np.diff(one.temperature) >= 0.0)


def test_one_reading_is_none_around_coagulation():
    """It is the one at the reference, which says nothing."""
    assert "around-coagulation" not in names(readings=1) and "around-coagulation" in names(readings=2)


def test_the_longest_push_of_an_experiment_file_is_proposed():
    assert {"longer-push", "modulated-push", "later-reading"} <= set(names(push_duration=10e-3))
