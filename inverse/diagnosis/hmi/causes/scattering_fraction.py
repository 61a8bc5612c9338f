"""Attenuation that is not all absorption."""

import equinox as eqx

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class ScatteringFraction(HmiCause):
    """Attenuation that is not all absorption."""

    name = "scattering-fraction"
    place = "tissue: attenuation"
    unit = "1"
    sign = 1
    plausible = 0.3
    largest = 0.95
    sentence = "A part of attenuation scatters: it pushes as absorption does, and does not heat."
    helps = "Absorption from the first second of heating: a factor of every sonication is free here."
    source = "Suomi et al. (2016), Parker (1983): attenuation is mainly absorption; scale assumed, a large one"

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """More force for the power that heats as much."""
        del conditions, model, shape
        return eqx.tree_at(lambda each: each.force, change, change.force / (1.0 - strength))
