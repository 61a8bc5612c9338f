"""Tissue before the focus that warms and absorbs otherwise."""

import equinox as eqx
import jax.numpy as jnp

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class PathHeating(HmiCause):
    """Tissue before the focus that warms and absorbs otherwise."""

    name = "path-heating"
    place = "acoustics: path"
    unit = "K"
    sign = 0
    plausible = 1.0
    sentence = "The layers before the focus warm up with time and then absorb more or less than in the simulation."
    helps = "The sound that comes through, by a hydrophone behind the sample; or a thermocouple in the path."
    source = (
        "Todd et al. (2012), doi 10.1002/mrm.23055: heating before and behind the focus, mapped by MR; one percent of "
        "attenuation a kelvin over 30 mm of 8 Np/m, assumed"
    )

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Force changed in proportion to the energy that has passed."""
        del model, shape
        lost = 2.0 * 0.01 * strength * 8.0 * 0.03 * conditions.share
        return eqx.tree_at(lambda each: each.force, change, change.force * jnp.exp(-lost))
