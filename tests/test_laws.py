"""Laws of temperature: their values, what they say outside their range, and the paper's tables in them."""

import dataclasses
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import suomi2016, tissues, units
from arfjax.coagulation import coagulated_fraction
from arfjax.errors import ExtrapolationWarning, InputError
from arfjax.laws import (
    Coagulating,
    Constant,
    Exponential,
    Linear,
    NormalisedPolynomial,
    PolynomialThrough,
    Scaled,
    ScaledRise,
    Shifted,
    Tabulated,
    common_range,
    extrapolations,
)
from tests.checks import assert_gradient

LABELS = {"unit": "1", "source": "test"}


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (Constant(3.0, **LABELS), 3.0),
        (Linear(2.0, 0.5, 40.0, **LABELS), 7.0),
        (Exponential(2.0, 0.1, 40.0, **LABELS), 2.0 * np.exp(1.0)),
        (NormalisedPolynomial(2.0, np.asarray([1.0, 2.0, 0.5]), **LABELS), 0.02 * (1.0 + 100.0 + 0.5 * 2500.0)),
        (Tabulated(np.asarray([40.0, 60.0]), np.asarray([1.0, 3.0]), **LABELS), 2.0),
    ],
)
def test_value_at_50_degc(law, expected):
    assert float(law(50.0)) == pytest.approx(expected, rel=1e-14)
    np.testing.assert_allclose(law(jnp.asarray([50.0, 50.0])), expected, rtol=1e-14)


def test_outside_its_range_a_law_gives_its_value_and_says_so():
    law = Linear(2.0, 0.5, 40.0, valid_range=(5.0, 70.0), **LABELS)
    with pytest.warns(ExtrapolationWarning, match="extrapolated to 80 degC.*covers 5 to 70 degC"):
        assert float(law(80.0)) == 22.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        law(70.0)
        jax.jit(law)(80.0)  # cannot know; whoever starts a traced run asks `extrapolations`


def test_extrapolations_of_a_model_are_listed_with_their_place():
    liver = tissues.liver()
    assert extrapolations(liver, 37.0) == []
    (message,) = extrapolations(liver, np.asarray([37.0, 72.0, 84.0]), name="liver")
    assert message.startswith("liver.attenuation: extrapolated to 72 to 84 degC;")


def test_attenuation_polynomial_against_its_printed_coefficients():
    attenuation = tissues.liver().attenuation
    # 123 + 1.99 T - 0.141 T^2 + 1.94e-3 T^3 - 2.55e-6 T^4, by hand.
    assert float(attenuation.percent(37.0)) == pytest.approx(97.0887, abs=1e-4)
    assert float(attenuation.percent(35.0)) == pytest.approx(99.275, abs=1e-3)
    expected = 35.0 * 99.275e-2 / units.DECIBEL_PER_NEPER
    assert float(attenuation(35.0)) == pytest.approx(expected, rel=1e-5)


def test_gradient_to_the_polynomial():
    law = tissues.liver().attenuation

    def value(coefficients):
        return NormalisedPolynomial(law.reference_value, coefficients, **LABELS)(55.0) ** 2

    assert_gradient(value, law.coefficients)


@pytest.mark.parametrize("temperature", sorted(suomi2016.TABLE_3_LESION))
def test_lesion_law_goes_through_table_3(temperature):
    row = suomi2016.TABLE_3_LESION[temperature]
    solid = tissues.lesion_viscoelasticity()(temperature)
    # Three printed digits; the middle row is the reference, the outer ones share the regression's slope.
    assert float(solid.unrelaxed_modulus - solid.relaxed_modulus) == pytest.approx(
        1e3 * row.branch_modulus_kpa, rel=2e-3
    )
    assert float(solid.relaxation_time) == pytest.approx(row.relaxation_time, abs=5e-4)
    assert float(solid.relaxed_modulus) == row.relaxed_modulus_pa


def test_every_tissue_states_unit_and_source():
    for make in tissues.BY_NAME.values():
        for law in jax.tree.leaves(make(), is_leaf=lambda node: hasattr(node, "valid_range")):
            if hasattr(law, "valid_range"):
                assert law.unit and law.source


def test_attenuation_at_another_frequency_follows_the_power_law():
    skin = tissues.skin().acoustic(35.0)
    assert float(skin.attenuation_at(2e6)) == pytest.approx(units.from_db_per_cm(0.35) * 2.0**1.55, rel=1e-12)


@pytest.mark.parametrize(
    ("temperatures", "values", "message"),
    [
        ([70.0, 50.0, 30.0], [3.0, 2.0, 1.0], "ascending"),
        ([30.0, 30.0], [1.0, 2.0], "none twice"),
        ([30.0, np.nan], [1.0, 2.0], "finite"),
    ],
)
def test_tables_that_cannot_be_read_are_refused(temperatures, values, message):
    with pytest.raises(InputError, match=message):
        Tabulated(np.asarray(temperatures), np.asarray(values), **LABELS)
    if temperatures[0] == 70.0:  # any order is a polynomial's
        assert float(PolynomialThrough(tuple(temperatures), np.asarray(values), **LABELS)(60.0)) == 2.5
        return
    with pytest.raises(InputError, match=message):
        PolynomialThrough(tuple(temperatures), np.asarray(values), **LABELS)


def test_a_polynomial_needs_a_value_for_each_temperature():
    for values in ([1.0], [1.0, 2.0, 9.0]):
        with pytest.raises(InputError, match="one value a temperature"):
            PolynomialThrough((30.0, 50.0), np.asarray(values), **LABELS)


def test_a_transition_of_negative_width_or_threshold_is_refused():
    law = coagulating()
    for changes in ({"width": -0.25}, {"width": 0.0}, {"threshold": -240.0}, {"width": float("nan")}):
        with pytest.raises(InputError, match="of coagulation must be positive"):
            dataclasses.replace(law, **changes)
        with pytest.raises(InputError, match="of coagulation must be positive"):
            coagulated_fraction(300.0, **({"threshold": 240.0, "width": 0.25} | changes))


def test_the_range_of_laws_together_is_what_all_cover():
    inner = Linear(2.0, 0.5, 40.0, **LABELS, valid_range=(50.0, 80.0))
    wide = Constant(1.0, **LABELS, valid_range=(0.0, 70.0))
    wrapped = Scaled(Shifted(inner, 1.0, **LABELS), 2.0, **LABELS)
    assert common_range({"one": wrapped, "two": wide}) == (50.0, 70.0)
    assert common_range(Constant(1.0, **LABELS)) == (-np.inf, np.inf)


def coagulating(width=0.25, **ranges):
    fresh = Linear(2.0, 0.5, 40.0, **LABELS, **ranges)
    return Coagulating(fresh, Constant(10.0, **LABELS), 240.0, width, **LABELS)


def test_coagulating_goes_from_one_law_to_the_other():
    law = coagulating()
    for temperature, fresh in ((40.0, 2.0), (50.0, 7.0)):
        assert float(law(temperature)) == float(law(temperature, 0.0)) == fresh
        assert float(law(temperature, 1e-3)) == pytest.approx(fresh, abs=1e-12)
        assert float(law(temperature, 240.0)) == pytest.approx(0.5 * (fresh + 10.0), rel=1e-14)
        assert float(law(temperature, 1e12)) == pytest.approx(10.0, rel=1e-14)
        # From a tenth to nine tenths dose grows by 81^width.
        for share, factor in ((0.1, 9.0**-0.25), (0.9, 9.0**0.25)):
            assert float(law(temperature, 240.0 * factor)) == pytest.approx(fresh + share * (10.0 - fresh), rel=1e-12)
    values = law(jnp.asarray([[40.0, 50.0]] * 2), jnp.asarray([[0.0], [1e12]]))
    np.testing.assert_allclose(values, [[2.0, 7.0], [10.0, 10.0]], rtol=1e-14)


def test_laws_that_do_not_ask_for_dose_ignore_it():
    for law in (Linear(2.0, 0.5, 40.0, **LABELS), tissues.liver().attenuation):
        assert float(law(50.0, 1e3)) == float(law(50.0))


def test_coagulating_within_coagulating():
    """Two transitions one after the other, far apart: each acts at its own dose."""
    first = Coagulating(Constant(1.0, **LABELS), Constant(2.0, **LABELS), 1.0, 0.1, **LABELS)
    law = Coagulating(first, Constant(5.0, **LABELS), 1e4, 0.1, **LABELS)
    expected = [1.0, 1.5, 2.0, 3.5, 5.0]
    np.testing.assert_allclose(law(jnp.full(5, 40.0), jnp.asarray([0.0, 1.0, 100.0, 1e4, 1e8])), expected, rtol=1e-12)


def test_coagulating_is_smooth_and_finite_from_no_dose_on():
    law = coagulating()
    slopes = jax.vmap(jax.grad(lambda dose: law(50.0, dose)))(jnp.asarray([0.0, 1e-40, 1.0, 240.0, 1e30]))
    assert np.all(np.isfinite(slopes)) and float(slopes[0]) == 0.0
    # d share / d ln dose is 1 / (4 width) at the threshold.
    assert float(slopes[3]) == pytest.approx((10.0 - 7.0) / (4.0 * 0.25 * 240.0), rel=1e-12)

    def value(p):
        return coagulating(p["width"])(p["temperature"], p["dose"])

    assert_gradient(value, {"width": 0.3, "temperature": 52.0, "dose": 200.0})


def test_coagulating_speaks_for_the_laws_within():
    law = coagulating(valid_range=(5.0, 70.0))
    assert law.outside_range(60.0) is None
    with pytest.warns(ExtrapolationWarning, match="extrapolated to 80 degC.*covers 5 to 70 degC"):
        law(80.0, 300.0)
    (message,) = extrapolations({"attenuation": law}, np.asarray([37.0, 80.0]))
    assert message.startswith("model['attenuation']: extrapolated to 80 degC;")


def ranged():
    return Linear(2.0, 0.5, 40.0, valid_range=(5.0, 70.0), **LABELS)


def wrapped(law):
    """Every law of another law, with its value where that one's is 7 at 50 and 17 at 70 degC, and 2 before heat."""
    flat = Constant(1.0, **LABELS)
    return {
        "scaled": (Scaled(law, 2.0, **LABELS), lambda value: 2.0 * value),
        "shifted": (Shifted(law, 3.0, **LABELS), lambda value: value + 3.0),
        "risen": (ScaledRise(law, 1.5, 40.0, **LABELS), lambda value: 2.0 + 1.5 * (value - 2.0)),
        "fresh": (Coagulating(law, flat, 240.0, 0.25, **LABELS), lambda value: 0.5 * (value + 1.0)),
        "coagulated": (Coagulating(flat, law, 240.0, 0.25, **LABELS), lambda value: 0.5 * (value + 1.0)),
    }


@pytest.mark.parametrize("name", wrapped(ranged()))
def test_a_wrapped_law_is_held_at_its_own_range(name):
    law, value = wrapped(ranged())[name]
    held = law.held(jnp.asarray([50.0, 70.0, 90.0]), 240.0)
    np.testing.assert_allclose(held, value(np.asarray([7.0, 17.0, 17.0])), rtol=1e-12)
    np.testing.assert_allclose(law.held(50.0, 240.0), law.after(50.0, 240.0), rtol=1e-15)
    # Followed, not held, where it is only evaluated; and said, whatever the wrapper says of itself.
    assert float(law.after(90.0, 240.0)) == pytest.approx(value(27.0), rel=1e-12)
    assert law.outside_range(70.0) is None
    assert "extrapolated to 90 degC" in law.outside_range(90.0)
    # Another wrapper around it changes nothing of that.
    twice = Scaled(law, 1.0, **LABELS)
    np.testing.assert_allclose(twice.held(90.0, 240.0), held[-1], rtol=1e-15)
    assert twice.outside_range(90.0) == law.outside_range(90.0)


def test_a_wrapper_of_a_narrower_range_is_held_there():
    law = Scaled(ranged(), 2.0, valid_range=(5.0, 50.0), **LABELS)
    assert float(law.held(90.0, 0.0)) == pytest.approx(14.0, rel=1e-15)
    assert "covers 5 to 50 degC" in law.outside_range(60.0)


def test_gradients_through_a_held_wrapper():
    def value(p):
        inner = Linear(2.0, p["slope"], 40.0, valid_range=(5.0, 70.0), **LABELS)
        law = Scaled(Coagulating(inner, Shifted(inner, p["shift"], **LABELS), 240.0, 0.25, **LABELS), 1.5, **LABELS)
        return jnp.sum(law.held(p["temperature"], 200.0))

    at = {"slope": 0.5, "shift": 3.0, "temperature": jnp.asarray([55.0, 90.0])}
    assert_gradient(value, at)
    slopes = jax.grad(value)(at)["temperature"]
    assert float(slopes[0]) > 0.0 and float(slopes[1]) == 0.0


def test_what_a_subclass_makes_of_its_law_holds_beyond_the_range_too():
    class Positive(Shifted):
        def after(self, temperature, dose):
            return jnp.maximum(super().after(temperature, dose), 0.0)

    falling = Linear(2.0, -0.1, 40.0, valid_range=(5.0, 70.0), **LABELS)
    law = Positive(falling, 0.5, **LABELS)
    np.testing.assert_allclose(law.held(jnp.asarray([40.0, 60.0, 90.0]), 0.0), [2.5, 0.5, 0.0], atol=1e-15)


def test_polynomial_through_values_is_the_polynomial():
    """Through five values of a quartic it is that quartic, with the derivative of each value's own weight."""
    quartic = tissues.liver_attenuation()
    anchors = (35.0, 45.0, 55.0, 65.0, 84.0)
    values = jnp.asarray(quartic.evaluate(np.asarray(anchors)))
    through = PolynomialThrough(anchors, values, **LABELS)
    at = np.linspace(30.0, 90.0, 13)
    np.testing.assert_allclose(through.evaluate(at), quartic.evaluate(at), rtol=1e-10)
    weights = jax.jacfwd(lambda v: PolynomialThrough(anchors, v, unit="Np/m", source="test").evaluate(55.0))(values)
    np.testing.assert_allclose(weights, [0.0, 0.0, 1.0, 0.0, 0.0], atol=1e-13)
