"""What every cause of misfit of displacement says of itself."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import read_experiment
from arfjax.model import DoseSize
from arfjax.tissues import coagulating, unperfused
from inverse.datasets.shipped import shipped
from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.hmi.cause import HmiConditions, TissueChange, unchanged
from inverse.diagnosis.hmi.causes.perfusion import PERFUSED
from inverse.diagnosis.hmi.courses import _AGES
from inverse.diagnosis.hmi.simulation import _with_rim
from inverse.diagnosis.hmi.simulation import changed as changed_model
from tests.blind import hmi_effects as blind

REQUIRED = (
    "thermocouple-viscous-heating thermocouple-lag thermocouple-position normalisation-temperature "
    "tracking-compression tracking-jitter thermal-decorrelation echo-strain thermal-lens path-heating "
    "attenuation-kinetics scattering-fraction exponent-change sound-speed-change perfusion conductivity-change "
    "pre-ablation-softening lesion-rim damage-law lesion-stiffness-law fractional-tissue cavitation boiling "
    "output-drift acoustic-saturation near-boundary"
).split()


def test_library_holds_the_names_that_users_write():
    assert [cause.name for cause in HMI_CAUSES] == list(dict.fromkeys(cause.name for cause in HMI_CAUSES))
    assert set(REQUIRED) <= {cause.name for cause in HMI_CAUSES}
    for cause in HMI_CAUSES:
        assert cause.sentence.endswith(".") and cause.helps.endswith(".") and cause.source and cause.unit
        assert cause.plausible > 0.0 and cause.sign in (0, 1) and ":" in cause.place


MODEL = read_experiment(shipped("suomi2016_experiment")).model()


def changed(cause, temperature, strength, shape=0.0):
    """What a cause makes of the tissue at some temperatures of the focus, at the end of a sonication."""
    one, none = jnp.ones(len(temperature)), jnp.zeros(len(temperature))
    conditions = HmiConditions(
        temperature=jnp.asarray(temperature), time=one, share=one, rise_rate=one, age=none[:, None],
        past_rise_rate=none[:, None], coagulated=one, since_coagulation=60.0 * one, is_reference=none > 0.0,
        off_axis_fall=jnp.ones((len(one), 3)), start_temperature=jnp.asarray(37.0), push_duration=jnp.asarray(5e-4),
    )  # fmt: skip
    return cause.tissue(unchanged(len(temperature)), conditions, MODEL, jnp.asarray(strength), jnp.asarray(shape))


def force(name, temperature, strength):
    """What is left of the radiation force."""
    return changed(named(name), temperature, strength).force


def named(name):
    return next(one for one in HMI_CAUSES if one.name == name)


def test_the_two_that_no_curve_here_shows_do_what_they_say():
    """One needs 99 degC, the other changes all displacements alike."""
    boiling = force("boiling", [70.0, 99.0, 110.0], 0.5)
    np.testing.assert_allclose(boiling, [1.0, 0.75, 0.5], atol=1e-5)
    np.testing.assert_allclose(force("scattering-fraction", [37.0, 84.0], 0.3), 1.0 / 0.7, rtol=1e-12)


ENDS = [(cause, end) for cause in HMI_CAUSES for end in cause.possible if math.isfinite(end)]


@pytest.mark.parametrize(("cause", "end"), ENDS, ids=[f"{cause.name}-{end:g}" for cause, end in ENDS])
def test_at_the_ends_of_a_strength_nothing_turns_its_sign(cause, end):
    tissue = changed(cause, [37.0, 60.0, 85.0, 110.0], end, cause.shapes[0])
    parts = (tissue.attenuation, tissue.liver_modulus, tissue.lesion_modulus, tissue.threshold, tissue.force)
    assert all(float(jnp.min(part)) > 0.0 for part in parts)
    liver = cause.model(MODEL, end, 0.0).liver
    assert float(liver.conductivity(60.0)) > 0.0 <= float(liver.perfusion_rate(60.0))


def test_flow_ends_where_there_is_none():
    """In tissue without flow less is as much, and more begins at once."""
    without = dataclasses.replace(MODEL, liver=unperfused(MODEL.liver))
    cause = named("perfusion")

    def flow(model, strength, dose=0.0):
        return cause.model(model, strength, 0.0).liver.perfusion_rate(60.0, dose)

    assert [float(flow(MODEL, s)) for s in (-1.0, -0.5, 1.0)] == pytest.approx([0.0, 0.5 * PERFUSED, 2.0 * PERFUSED])
    assert [float(flow(without, s)) for s in (-1.0, 0.0, 1.0)] == pytest.approx([0.0, 0.0, PERFUSED])
    stopped = dataclasses.replace(MODEL, liver=coagulating(MODEL.liver))
    assert float(flow(stopped, -0.5, 1e6)) == 0.0 < float(flow(stopped, -0.5))
    for model in (MODEL, without):
        assert float(jax.grad(lambda s, model=model: flow(model, s))(0.0)) == pytest.approx(PERFUSED)


TEMPERATURE = np.array([38.0, 46.0, 55.0, 63.0, 72.0, 81.0])
TIME, RATE = np.array([1.0, 10.0, 20.0, 33.0, 47.0, 60.0]), np.array([1.5, 1.2, 1.0, 0.8, 0.7, 0.6])
DOSE, COAGULATED_AT = np.array([1e-3, 1e-2, 1.0, 100.0, 300.0, 1e5]), 30.0
FROM_START = {"thermal-lens", "acoustic-saturation", "near-boundary"}
"""Of these the generator counts from 35 degC on, where its sonications begin; of others from the body's temperature."""
SHAPES = {"cavitation": 67.8, "pre-ablation-softening": 48.25}


def gone_through(name, **other):
    """Conditions of the readings of a sonication of a minute."""
    count, start = len(TIME), 35.0 if name in FROM_START else 37.0
    given = {
        "temperature": TEMPERATURE, "time": TIME, "share": TIME / 60.0, "rise_rate": RATE,
        "age": np.zeros((count, 1)), "past_rise_rate": np.zeros((count, 1)),
        "coagulated": 1.0 / (1.0 + (240.0 / DOSE) ** 4), "since_coagulation": np.maximum(TIME - COAGULATED_AT, 0.0),
        "off_axis_fall": np.zeros((count, 3)), "is_reference": np.arange(count) == 0, "start_temperature": start,
        "push_duration": 5e-4,
    }  # fmt: skip
    return HmiConditions(**{key: jnp.asarray(value) for key, value in (given | other).items()})


def blindly(name, strength):
    """The same readings as the generator has them with its effect in it."""
    one, none = np.ones(len(TIME)), np.zeros(len(TIME))
    scene = blind.Scene(
        model=MODEL, shown=TEMPERATURE, time=TIME, temperature=TEMPERATURE, rate=RATE, dose=DOSE,
        coagulated_at=COAGULATED_AT, attenuation=one, liver=one, lesion=one, threshold=240.0 * one, force=one,
        faster=none, rim=none,
    )  # fmt: skip
    if name in blind.TISSUE:
        blind.TISSUE[name](scene, strength)
    return scene


WAYS = [
    (name, sign)
    for name in (*blind.TISSUE, *blind.TRACKING)
    for sign in ((1.0,) if named(name).sign > 0 else (1.0, -1.0))
]


@pytest.mark.parametrize(("name", "sign"), WAYS)
def test_a_cause_does_what_an_independent_code_does(name, sign):
    """Its sign, its size at a plausible strength, and nothing else: where a fit ends, that is what a user is told."""
    cause = named(name)
    strength, shape, conditions = sign * cause.plausible, SHAPES.get(name, 0.0), gone_through(name)
    theirs = blindly(name, strength)
    tissue = cause.tissue(unchanged(len(TIME)), conditions, MODEL, strength, shape)
    model = cause.model(MODEL, strength, shape)
    temperature = cause.temperature(jnp.asarray(TEMPERATURE), conditions, strength, shape)
    relative = np.array([1.0, 0.9, 0.8, 0.95, 0.6, 0.3])
    reported = blind.TRACKING[name](relative, theirs, strength) if name in blind.TRACKING else relative
    for ours, expected in (
        (tissue.attenuation, theirs.attenuation),
        (tissue.liver_modulus, theirs.liver),
        (tissue.lesion_modulus, theirs.lesion),
        (240.0 * tissue.threshold, theirs.threshold),
        (tissue.force, theirs.force),
        (tissue.sound_speed, theirs.faster),
        # There it is what the edge lacks.
        (-tissue.rim, theirs.rim),
        (temperature, theirs.temperature),
        (cause.measured(jnp.asarray(relative), conditions, strength, shape), reported),
        (model.liver.perfusion_rate(37.0), np.maximum(theirs.model.liver.perfusion_rate(37.0), 0.0)),
        (model.liver.conductivity(37.0), theirs.model.liver.conductivity(37.0)),
    ):
        np.testing.assert_allclose(ours, expected, rtol=1e-9, atol=1e-12)


def shown_by(name, strength):
    """What a thermocouple with a fault shows where the focus rises by 0.6 K/s, and what its cause has to know."""
    focus = 37.0 + 0.6 * TIME
    if name == "thermocouple-position":
        # In a beam as wide as exp(-(r / 1.5 mm)^2), of which the logarithm is all in the first power of r^2.
        fall = np.outer(np.ones(len(TIME)), [1.0 / 1.5e-3**2, 0.0, 0.0])
        return focus, 37.0 + (focus - 37.0) * np.exp(-1e-6 * strength / 1.5e-3**2), {"off_axis_fall": fall}
    course = np.append(0.0, TIME), np.append(37.0, focus), np.zeros(0), np.zeros(0)
    age = TIME[:, None] * _AGES
    return focus, blind.SENSORS[name](course, strength)[1:], {"age": age, "past_rise_rate": 0.6 * np.ones(age.shape)}


@pytest.mark.parametrize("name", blind.SENSORS)
def test_of_what_a_faulty_thermocouple_shows_its_cause_makes_the_temperature_of_the_focus(name):
    cause, strength = named(name), 0.8 * named(name).plausible
    focus, shown, known = shown_by(name, strength)
    conditions = gone_through(name, temperature=shown, **known)
    shape = 3.0 if len(cause.shapes) > 1 else 0.0
    np.testing.assert_allclose(cause.temperature(jnp.asarray(shown), conditions, strength, shape), focus, rtol=1e-9)
    assert np.max(np.abs(shown - focus)) > 0.05


def test_tissue_of_one_state_has_its_own_factors_and_what_is_added_to_it():
    """Constants of liver and lesion apart, relaxation times as they were."""
    given = [[1.3, 0.7], [-7.0, 4.0], [0.8, 1.1], [1.5, 0.6], [0.0, 0.0], [2.0, 0.5], [1.0, 1.0]]
    change, names = TissueChange(*(jnp.array(one) for one in given)), ("relaxed_modulus", "branch_modulus")

    def laws(model):
        both = model.liver.viscoelasticity, model.lesion.viscoelasticity
        moduli = [getattr(law, name).evaluate(60.0) for law in both for name in names]
        times = [law.relaxation_time.evaluate(60.0) for law in both]
        return [model.liver.attenuation.evaluate(60.0), model.liver.sound_speed.evaluate(60.0), *moduli, *times]

    found = np.array(jax.vmap(lambda each: jnp.array(laws(changed_model(MODEL, each))))(change)).T
    attenuation, speed, *moduli, liver_time, lesion_time = (float(one) for one in laws(MODEL))
    expected = [attenuation * change.attenuation, speed + change.sound_speed]
    factors = np.repeat(np.array(given)[2:4], 2, axis=0)
    expected += [modulus * factor for modulus, factor in zip(moduli, factors, strict=True)]
    expected += [[liver_time, liver_time], [lesion_time, lesion_time]]
    np.testing.assert_allclose(found, np.array(expected), rtol=1e-12)
    by_dose = dataclasses.replace(MODEL, lesion=dataclasses.replace(MODEL.lesion, size=DoseSize(240.0)))
    thresholds = jax.vmap(lambda each: changed_model(by_dose, each).lesion.size.threshold)(change)
    np.testing.assert_allclose(thresholds, [480.0, 120.0])
    # A rim takes from where the lesion is partial, or adds to it, most where it is a half.
    rim = eqx.tree_at(lambda each: each.rim, change, jnp.array([0.4, -0.4]))
    np.testing.assert_allclose(_with_rim(jnp.array([0.5, 0.5]), rim), [0.6, 0.4])
    np.testing.assert_array_equal(_with_rim(jnp.array([0.0, 1.0]), rim), [0.0, 1.0])
