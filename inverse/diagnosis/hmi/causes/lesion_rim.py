"""Rim of the lesion that is softer or stiffer than a mixture."""

import equinox as eqx

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class LesionRim(HmiCause):
    """Rim of the lesion that is softer or stiffer than a mixture."""

    name = "lesion-rim"
    place = "mechanics: lesion"
    unit = "1"
    sign = 0
    plausible = 0.5
    least, largest = -1.0, 1.0
    """A softer rim would have less than no lesion in it, a stiffer one more than the lesion itself."""
    sentence = "Between lesion and liver lies a rim that is softer or stiffer than the model's transition."
    helps = "A scan of the push across the lesion's edge, or histology."
    source = (
        "Cornelis et al. (2017), PMC5744668, pig's liver: dead and living cells mix over 0.3 mm (microwaves) to 0.8 mm "
        "(radio frequency) of an ablation's edge; share times what lacks to one, and scale, assumed"
    )

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """More or less of the lesion where it is partial."""
        del conditions, model, shape
        return eqx.tree_at(lambda each: each.rim, change, change.rim - strength)
