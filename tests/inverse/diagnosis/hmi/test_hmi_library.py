"""What every cause of misfit of displacement says of itself."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import read_experiment
from arfjax.tissues import coagulating, unperfused
from inverse.datasets.shipped import shipped
from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.hmi.cause import HmiConditions, unchanged
from inverse.diagnosis.hmi.causes.perfusion import PERFUSED

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
