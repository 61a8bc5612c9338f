"""What every cause of misfit of displacement says of itself."""

import jax.numpy as jnp
import numpy as np

from arfjax import read_experiment
from inverse.datasets.shipped import shipped
from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.hmi.cause import HmiConditions, unchanged

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


def force(name, temperature, strength):
    """What a cause leaves of the radiation force at some temperatures of the focus."""
    one, none = jnp.ones(len(temperature)), jnp.zeros(len(temperature))
    conditions = HmiConditions(
        temperature=jnp.asarray(temperature), time=one, share=one, rise_rate=one, age=none[:, None],
        past_rise_rate=none[:, None], coagulated=one, since_coagulation=none, off_axis_fall=jnp.ones((len(one), 3)),
        is_reference=none > 0.0, start_temperature=jnp.asarray(37.0), push_duration=jnp.asarray(5e-4),
    )  # fmt: skip
    cause = next(one for one in HMI_CAUSES if one.name == name)
    model = read_experiment(shipped("suomi2016_experiment")).model()
    return cause.tissue(unchanged(len(temperature)), conditions, model, jnp.asarray(strength), jnp.asarray(0.0)).force


def test_the_two_that_no_curve_here_shows_do_what_they_say():
    """One needs 99 degC, the other changes all displacements alike."""
    boiling = force("boiling", [70.0, 99.0, 110.0], 0.5)
    np.testing.assert_allclose(boiling, [1.0, 0.75, 0.5], atol=1e-5)
    np.testing.assert_allclose(force("scattering-fraction", [37.0, 84.0], 0.3), 0.7, rtol=1e-12)
