"""Vapour at the focus."""

import equinox as eqx
import jax

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class Boiling(HmiCause):
    """Vapour at the focus."""

    name = "boiling"
    place = "acoustics: field"
    unit = "1"
    sign = 1
    plausible = 0.5
    largest = 0.95
    sentence = "At the boiling point vapour reflects the sound: hardly any push arrives at the focus behind it."
    helps = "Sonications that end below 95 degC, or a passive detector."
    source = (
        "Nahirnyak et al. (2010): boiling of muscle is heard from 97 +- 7 degC; a logistic 1 K wide at 99 "
        "degC, and scale, assumed"
    )

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Force lost at the boiling point."""
        del model, shape
        grown = jax.nn.sigmoid(conditions.temperature - 99.0)
        return eqx.tree_at(lambda each: each.force, change, change.force * (1.0 - strength * grown))
