"""Attenuation that coagulation raises slowly, and for good."""

import equinox as eqx
import jax.numpy as jnp

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange

TIME_CONSTANT = 118.0
"""Of the rise of attenuation after coagulation [s]."""


class AttenuationKinetics(HmiCause):
    """Attenuation that coagulation raises slowly, and for good."""

    name = "attenuation-kinetics"
    place = "tissue: attenuation"
    unit = "1"
    sign = 0
    plausible = 0.5
    least = -1.0
    sentence = (
        "Coagulated tissue attenuates more, and gets there slowly after its dose, whatever the temperature is then."
    )
    helps = "Sonications of other durations to the same temperature."
    source = "Clarke, Bush & ter Haar (2003): time constant 118 s; scale assumed: up to twice the attenuation"

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Attenuation after coagulation, by its time constant."""
        del model, shape
        reached = 1.0 - jnp.exp(-conditions.since_coagulation / TIME_CONSTANT)
        return eqx.tree_at(lambda each: each.attenuation, change, change.attenuation * (1.0 + strength * reached))
