"""Sound speed that follows another course with temperature."""

import equinox as eqx

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class SoundSpeedChange(HmiCause):
    """Sound speed that follows another course with temperature."""

    name = "sound-speed-change"
    place = "tissue: sound speed"
    unit = "m/s"
    sign = 0
    plausible = 10.0
    sentence = "The liver's sound speed follows another course with temperature than in the model."
    helps = "The time of flight through the sample as it warms."
    source = "Techavipoo et al. (2002), dog's liver: rises to 70 degC, falls beyond; scale assumed, at 80 degC"

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """A change in proportion to the rise."""
        del model, shape
        return eqx.tree_at(
            lambda each: each.sound_speed, change, change.sound_speed + strength * conditions.rise / 43.0
        )
