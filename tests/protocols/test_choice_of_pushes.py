"""Which states a fast curve learns its pushes from."""

import inspect

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import InputError
from arfjax.protocols import fast_preparation
from arfjax.protocols.fast_curve import FEATURES
from arfjax.protocols.fast_preparation import _box, _far_apart, _places, _States
from arfjax.protocols.sound_table import Interval

LENGTH, DIAMETER = -3, -2
OF_SOUND = Interval.around(np.asarray([0.9, 1.2]), 8), Interval.around(np.asarray([1.1, 1.1]), 8)


@pytest.fixture
def states():
    """Lesions of 0.1 to 20 mm, evenly on a logarithm, then a state without one; all else is the same."""
    size = np.append(np.geomspace(1e-4, 2e-2, 300), 0.0)
    values = np.tile(np.linspace(1.0, 2.0, len(FEATURES)), (len(size), 1))
    values[:, LENGTH], values[:, DIAMETER] = size, 0.4 * size
    present = np.ones(values.shape, dtype=bool)
    present[-1, LENGTH:] = False
    number = np.zeros(len(size), dtype=int)
    return _States(number, number, np.full(len(size), 60.0), values, present)


def test_largest_lesion_is_1_and_the_smallest_are_minus_1_and_none_is_below(states):
    places = _places(states, _box(states, OF_SOUND), by_logarithm=True)
    for size in (LENGTH, DIAMETER):
        np.testing.assert_allclose(places[[-2, 0, -1], size], [1.0, -1.0, -1.5], atol=1e-12)
        # Halfway on the logarithm, which begins at 3 percent of the largest.
        half = np.argmin(np.abs(states.values[:-1, LENGTH] / 2e-2 - np.sqrt(0.03)))
        assert abs(places[half, size]) < 0.02
        assert np.all(np.diff(places[:-1, size]) >= 0.0)


def test_by_the_logarithm_half_of_the_pushes_are_of_small_lesions(states):
    small = {}
    for by_logarithm in (False, True):
        chosen = _far_apart(_places(states, _box(states, OF_SOUND), by_logarithm=by_logarithm), 12)
        assert len(set(chosen.tolist())) == 12 and chosen[0] == 299
        lesions = states.values[chosen, LENGTH][states.present[chosen, LENGTH]]
        small[by_logarithm] = int(np.sum(lesions < np.sqrt(0.03) * 2e-2))
    assert small[True] >= 5 and small[False] <= 3


def test_a_box_is_a_twentieth_wider_at_both_ends_than_what_was_seen(states):
    """Of a lesion, where there is one: the last state has none."""
    states.values[:, 4] = np.linspace(3.0, 7.0, len(states.values))
    box = _box(states, OF_SOUND)
    for feature, low, high in ((4, 3.0, 7.0), (LENGTH, 1e-4, 2e-2), (DIAMETER, 4e-5, 8e-3)):
        np.testing.assert_allclose(box.half[feature], 0.55 * (high - low), rtol=1e-12)
        np.testing.assert_allclose(box.middle[feature], 0.5 * (low + high), rtol=1e-12)


@pytest.mark.parametrize(("feature", "change", "covered"), [(0, 0.16, True), (0, 0.17, False), (1, 1e-3, False)])
def test_a_box_ends_where_the_table_of_sound_does(states, feature, change, covered):
    """Also where all draws have one sound speed, so that the table has a single term: a neighbour is not like them."""
    values = states.values[:1].copy()
    values[0, :2] = [interval.middle for interval in OF_SOUND]
    values[0, feature] += change
    excess = _box(states, OF_SOUND).excess(jnp.asarray(values), jnp.ones(values.shape, dtype=bool))
    assert (float(excess) <= 1.0) is covered


def test_draws_of_which_none_can_be_followed_are_refused(monkeypatch):
    """One feature that is not a number at one of two temperatures, in each draw; absent ones count for nothing."""
    present = np.ones((2, len(FEATURES)), dtype=bool)
    present[:, LENGTH:] = False

    def features_of(_fast, _protocol, temperatures):
        broken = jnp.zeros((len(temperatures), len(FEATURES))).at[1, 2].set(jnp.nan).at[:, LENGTH].set(jnp.nan)
        return lambda draw: (broken * draw, present)

    monkeypatch.setattr(fast_preparation, "_features_of", features_of)
    states_of = inspect.unwrap(fast_preparation._states)  # types of what is not looked at here are not either
    protocols = [(None, np.array([40.0, 50.0]))]
    with pytest.raises(InputError) as refused:
        states_of(None, [1.0, 2.0], protocols, lambda *_: None)
    message = str(refused.value)
    assert "of 2 draws none can be followed" in message and FEATURES[2] in message and FEATURES[LENGTH] not in message
    monkeypatch.setattr(fast_preparation, "_features_of", lambda *_: lambda draw: (draw * present, present))
    assert len(states_of(None, [1.0, 2.0], protocols, lambda *_: None).values) == 4
