"""Focus that moves as the tissue before it heats."""

import equinox as eqx

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange

TO_THE_FASTEST = 33.0
"""Rise of temperature at which liver's sound speed is highest [K]: near 70 degC, Techavipoo et al. (2002)."""


class ThermalLens(HmiCause):
    """Focus that moves as the tissue before it heats."""

    name = "thermal-lens"
    place = "acoustics: field"
    unit = "1"
    sign = 1
    plausible = 0.1
    largest = 0.95
    sentence = (
        "Heated tissue refracts: the focus moves towards the transducer and widens, so that the push at the old "
        "focus falls with the square of the sound speed's change."
    )
    helps = "A scan of the focus along the axis while hot."
    source = (
        "Connor & Hynynen (2002): focus 1 to 2 mm nearer to the transducer; quadratic in the sound speed's "
        "change, and scale, assumed"
    )

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Force lost with the square of the sound speed's change, in units of its largest."""
        del model, shape
        warmer = conditions.rise / TO_THE_FASTEST
        faster = warmer * (2.0 - warmer)
        return eqx.tree_at(lambda each: each.force, change, change.force * (1.0 - strength * faster**2))
