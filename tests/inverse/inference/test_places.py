"""Places: numbers are read and written where a path says, and a wrong path is told what there is instead."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import InputError, read_experiment
from inverse.datasets.shipped import shipped
from inverse.inference import places

MODEL = read_experiment(shipped("suomi2016_experiment")).model()


def test_every_number_of_a_model_has_a_place_that_is_read_and_written():
    found = places.numbers(MODEL)
    assert len(found) > 40
    for place, value in found.items():
        np.testing.assert_array_equal(places.read(MODEL, place), value)
        changed = places.numbers(places.write(MODEL, place, 3.0 + jnp.zeros_like(value)))
        assert [name for name in found if not np.array_equal(changed[name], found[name])] == [place]


def test_one_element_of_an_array():
    place = "liver.attenuation.coefficients[2]"
    old = np.asarray(MODEL.liver.attenuation.coefficients)
    new = places.write(MODEL, place, jnp.asarray(7.0)).liver.attenuation.coefficients
    np.testing.assert_array_equal(new, np.where(np.arange(len(old)) == 2, 7.0, old))
    doubled = places.write(MODEL, "liver.attenuation.coefficients", jnp.asarray(2.0), relative=True)
    np.testing.assert_allclose(doubled.liver.attenuation.coefficients, 2.0 * old)


def test_tuples_and_dictionaries():
    tree = {"parts": (1.0, {"a": jnp.asarray([1.0, 2.0])})}
    assert float(places.read(tree, "parts[1].a[1]")) == 2.0
    assert float(places.write(tree, "parts[0]", jnp.asarray(5.0))["parts"][0]) == 5.0


def test_a_place_has_one_way_to_be_written():
    tree = {"parts": (1.0, {"a": jnp.asarray([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])})}
    for place in ("parts[1].a[1][0]", "parts[-1]['a'][-1][-3]", ".parts[1].a[-1][0]"):
        assert places.counted_from_start(tree, place) == "parts[1].a[1][0]"
    with pytest.raises(InputError, match="of length 2, without a number -3"):
        places.counted_from_start(tree, "parts[-3]")


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("liver.attenuaton.coefficients", "`liver` .Tissue. has no `attenuaton`"),
        ("liver.attenuation", "holds no number but NormalisedPolynomial; numbers stand at `liver.attenuation.ref"),
        ("liver.attenuation.coefficients[9]", "of length 5, without a number 9"),
        ("liver..attenuation", "is no place"),
        ("", "a place is empty"),
    ],
)
def test_wrong_places_are_told_what_there_is(place, said):
    with pytest.raises(InputError, match=said):
        places.read(MODEL, place)
    with pytest.raises(InputError, match="given were .3,."):
        places.write(MODEL, "liver.attenuation.reference_value", jnp.zeros(3))
