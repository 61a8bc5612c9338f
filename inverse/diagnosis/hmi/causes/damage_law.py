"""Coagulation by another law than 240 equivalent minutes."""

import equinox as eqx
import jax.numpy as jnp

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class DamageLaw(HmiCause):
    """Coagulation by another law than 240 equivalent minutes."""

    name = "damage-law"
    place = "tissue: damage"
    unit = "1"
    sign = 0
    plausible = 1.5
    sentence = "Tissue coagulates at another dose than 240 equivalent minutes, or by another law."
    helps = "Histology of sonications of several durations."
    source = (
        "Strength is the change of the logarithm of the lethal dose; Damianou et al. (1997): attenuation of "
        "dog's tissue doubles by 100 to 1000 min; scale assumed"
    )

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Another threshold."""
        del conditions, model, shape
        return eqx.tree_at(lambda each: each.threshold, change, change.threshold * jnp.exp(strength))
