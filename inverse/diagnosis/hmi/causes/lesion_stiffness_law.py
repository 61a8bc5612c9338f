"""Stiffness of the lesion that turns with temperature."""

import equinox as eqx
import jax.numpy as jnp

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class LesionStiffnessLaw(HmiCause):
    """Stiffness of the lesion that turns with temperature."""

    name = "lesion-stiffness-law"
    place = "tissue: viscoelasticity"
    unit = "1"
    sign = 0
    plausible = 0.5
    sentence = (
        "The lesion's stiffness does not grow exponentially with temperature: its growth slows down, or sets in late."
    )
    helps = "DMA of coagulated tissue at more temperatures."
    source = (
        "Kiss et al. (2009), J. Biomech. 42, 959: moduli of lesions made at 60 to 90 degC peak at 70 to 75 degC and "
        "rise again; curvature of the logarithm over 10 K about 70 degC, and scale, assumed"
    )

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """A parabola in the logarithm of the modulus."""
        del model, shape
        turned = 0.5 * ((conditions.temperature - 70.0) / 10.0) ** 2
        return eqx.tree_at(lambda each: each.lesion_modulus, change, change.lesion_modulus * jnp.exp(strength * turned))
