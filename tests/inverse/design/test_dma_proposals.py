"""What could be measured next: same instrument, same sample, at the frequencies, in the order and at the pace known."""

import dataclasses

import numpy as np
import pytest

from inverse.datasets.dma import dma_data, group_sweeps
from inverse.datasets.dma_checks import SWEEP_GAP
from inverse.design.dma_proposals import dma_proposals

FREQUENCY = np.geomspace(1.0, 100.0, 6)


def sweeps(*temperatures, frequency=FREQUENCY, clock=None, sample=()):
    """One at each temperature, in the order given."""
    count = len(temperatures)
    data = dma_data(
        np.tile(frequency, count), np.repeat(temperatures, len(frequency)), np.full(count * len(frequency), 1e4)
    )
    return dataclasses.replace(data, time_s=clock, sample=sample)


def proposed(data, **asked):
    return {one.name: one for one in dma_proposals(data, **asked)}


def test_the_same_sweeps_once_more_are_as_many_readings_where_an_instrument_states_what_it_ran_at():
    """A few in a million off from sweep to sweep: no other frequencies."""
    stated = np.tile(FREQUENCY, 3) * (1.0 + 1e-6 * np.arange(18.0))
    data = dataclasses.replace(sweeps(20.0, 30.0, 40.0), frequency_hz=stated)
    found = proposed(data)
    for name in ("again", "random-order", "reversed-temperatures"):
        assert len(found[name]) == 18
    assert len(found["between"]) == 12
    np.testing.assert_array_equal(found["again"].frequency, stated)


def test_the_same_sweep_once_more_has_the_frequencies_of_that_sweep_in_its_order():
    """From above in the first, half of them in the second; what was read twice, but for what an
    instrument rounds, is read once."""
    data = dma_data(
        np.concatenate([FREQUENCY[::-1], FREQUENCY[:3], 1.0001 * FREQUENCY[:1]]),
        np.repeat([40.0, 20.0], [6, 4]),
        np.full(10, 1e4),
    )
    found = proposed(data)
    np.testing.assert_array_equal(found["again"].frequency, [*FREQUENCY[::-1], *FREQUENCY[:3]])
    np.testing.assert_array_equal(found["again"].temperature, np.repeat([40.0, 20.0], [6, 3]))
    np.testing.assert_array_equal(found["reversed-temperatures"].frequency, [*FREQUENCY[:3], *FREQUENCY[::-1]])
    # Between two it is as full as the fuller one.
    np.testing.assert_array_equal(np.sort(found["between"].frequency), FREQUENCY)


def test_a_sweep_whose_temperature_wanders_is_one():
    """By less than a kelvin from one reading to the next, by more in all: sweeps are those that are fitted."""
    data = dataclasses.replace(
        sweeps(20.0, 40.0), temperature_c=np.concatenate([19.2 + 0.3 * np.arange(6.0), np.full(6, 40.0)])
    )
    found = proposed(data)
    again = found["again"]
    assert len(again) == 12
    # Each frequency where it was read: at the mean it would be far from itself, and no part of its sweep.
    np.testing.assert_array_equal(again.temperature, data.temperature_c)
    np.testing.assert_allclose(np.unique(found["higher-frequencies"].temperature), [19.95, 40.0])
    np.testing.assert_allclose(np.unique(found["between"].temperature), 29.975)


def test_every_proposal_can_be_joined_with_sweeps_that_drift():
    """By 5 K in each: read at their mean, frequencies would be 2.5 K from themselves."""
    data = dataclasses.replace(
        sweeps(20.0, 40.0, 60.0), temperature_c=(np.array([[20.0], [40.0], [60.0]]) + 0.99 * np.arange(6.0)).ravel()
    )
    for one in proposed(data, seed=3).values():
        both = dma_data(
            np.append(data.frequency_hz, one.frequency), np.append(data.temperature_c, one.temperature),
            np.full(len(data) + len(one), 1e4),
        )  # fmt: skip
        assert len(group_sweeps(both)) == (5 if one.name == "between" else 3)
        for frequency, temperature in zip(one.frequency, one.temperature, strict=True):
            same = data.temperature_c[data.frequency_hz == frequency]
            assert one.name == "between" or not len(same) or temperature in same


def test_the_pace_is_that_of_all_readings_where_temperature_changes_from_row_to_row():
    """All temperatures at one frequency, then at the next: a minute each."""
    data = dma_data(np.repeat(FREQUENCY, 5), np.tile([20.0, 30.0, 40.0, 50.0, 60.0], 6), np.full(30, 1e4))
    found = proposed(dataclasses.replace(data, time_s=60.0 * np.arange(30.0)))["again"]
    np.testing.assert_array_equal(np.diff(found.time), 60.0)
    assert found.time[0] == 30.0 * 60.0 and found.seconds == 29.0 * 60.0


@pytest.mark.parametrize("step", [2.5, 3.5, 5.0, 7.3])
def test_who_follows_the_words_measures_at_temperatures_of_their_own(step):
    """Rounded to whole degrees, 23.75 degC would be a part of the sweep at 25."""
    data = sweeps(*(20.0 + step * np.arange(3.0)))
    found = proposed(data)["between"]
    said = [float(word) for word in found.words.removeprefix("sweeps at ").split(" degC")[0].split(", ")]
    np.testing.assert_allclose(said, np.unique(found.temperature), atol=0.01)
    assert np.min(np.abs(np.subtract.outer(said, data.temperature_c))) > SWEEP_GAP


def test_no_reading_is_shorter_than_a_period():
    """At 0.05 Hz that is twenty seconds, where readings from 0.5 Hz on were taken every two."""
    clock = 2.0 * np.arange(12.0)
    found = proposed(sweeps(20.0, 40.0, frequency=np.geomspace(0.5, 100.0, 6), clock=clock))
    lower = found["lower-frequencies"]
    assert lower.frequency[0] == pytest.approx(0.05)
    steps = np.diff(lower.time)
    np.testing.assert_allclose(steps[:6], 1.0 / lower.frequency[1:7])
    # Two seconds are enough from 0.5 Hz on.
    np.testing.assert_allclose(np.diff(found["again"].time), 2.0)
    assert lower.seconds == pytest.approx(np.sum(1.0 / lower.frequency) - 20.0)
    # Where the data give no time, readings are counted.
    counted = proposed(sweeps(20.0, 40.0, frequency=np.geomspace(0.5, 100.0, 6)))["lower-frequencies"]
    np.testing.assert_array_equal(np.diff(counted.time), 1.0)


@pytest.mark.parametrize("sample", ["a", "b"])
@pytest.mark.parametrize("by_turns", [False, True])
def test_without_times_a_sample_is_measured_again_after_its_own_last_reading(sample, by_turns):
    """Rows are counted through each sample, whichever comes first in the file and however rows take turns."""
    data = sweeps(20.0, 40.0, 20.0, 40.0, sample=("a",) * 12 + ("b",) * 12)
    if by_turns:
        data = data.select(np.arange(24).reshape(2, 12).T.ravel())
    for one in dma_proposals(data, sample=sample):
        assert one.sample == sample and one.seconds is None
        assert one.time[0] == 12.0
        np.testing.assert_array_equal(np.diff(one.time), 1.0)


def test_another_temperature_takes_the_pause_that_it_took():
    """Half a minute more, before the first reading of each."""
    clock = np.arange(12.0) + np.repeat([0.0, 30.0], 6)
    again = proposed(sweeps(20.0, 40.0, clock=clock))["again"]
    np.testing.assert_array_equal(np.diff(again.time), np.diff(clock))
    assert again.time[0] == clock[-1] + 31.0
    one = proposed(sweeps(20.0, clock=np.arange(6.0)))
    np.testing.assert_array_equal(one["again"].time, np.arange(6.0, 12.0))
    assert "between" not in one and len(one["reversed-temperatures"]) == 6


def test_temperatures_come_again_in_the_order_in_which_they_came_first():
    """Of one to which a measurement comes back at its end."""
    found = proposed(sweeps(20.0, 40.0, 30.0, 20.0))
    np.testing.assert_array_equal(found["again"].temperature, np.repeat([20.0, 40.0, 30.0], 6))
    np.testing.assert_array_equal(found["reversed-temperatures"].temperature, np.repeat([30.0, 40.0, 20.0], 6))
    np.testing.assert_array_equal(np.unique(found["between"].temperature), [25.0, 35.0])


def test_the_first_sample_is_measured_again_and_each_seed_draws_orders_of_its_own():
    data = sweeps(20.0, 40.0, 20.0, 40.0, sample=("a",) * 12 + ("b",) * 12)
    assert {one.sample for one in dma_proposals(data)} == {"a"}
    drawn = [proposed(data, seed=seed)["random-order"].frequency.tolist() for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]
