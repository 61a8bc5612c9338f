"""Output of the transducer that drifts as it warms."""

import equinox as eqx

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class OutputDrift(HmiCause):
    """Output of the transducer that drifts as it warms."""

    name = "output-drift"
    place = "transducer: drive"
    unit = "1"
    sign = 0
    plausible = 0.1
    least = -0.95
    sentence = (
        "The transducer's efficiency changes while it warms: the same drive pushes less at the end of a "
        "sonication than at its start."
    )
    helps = "A hydrophone or a power meter during the sonication; or pushes in reversed order."
    source = (
        "Duck et al. (1989), Br. J. Radiol. 62, 1005: surfaces of transducers in air warm by up to 36 K in a minute; "
        "that this takes a few percent to ten of the output, assumed"
    )

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Force changed in proportion to time."""
        del model, shape
        return eqx.tree_at(lambda each: each.force, change, change.force * (1.0 + strength * conditions.share))
