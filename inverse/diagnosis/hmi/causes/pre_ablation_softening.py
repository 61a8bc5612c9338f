"""Tissue that softens, or stiffens, before it coagulates."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class PreAblationSoftening(HmiCause):
    """Tissue that softens, or stiffens, before it coagulates."""

    name = "pre-ablation-softening"
    place = "tissue: viscoelasticity"
    unit = "1"
    sign = 0
    plausible = 0.3
    largest = 0.95
    sentence = (
        "Liver changes its stiffness between body temperature and coagulation, by proteins that unfold before "
        "they aggregate."
    )
    helps = "DMA between 37 and 55 degC, or an attenuation that is measured and not fitted."
    source = (
        "Muscle softens (Wu et al. 2001), liver does not (Sapin-de Brosses et al. 2010), as Suomi et al. "
        "(2016) quote them; shape and scale assumed"
    )
    shapes: ClassVar[tuple[float, ...]] = (44.0, 45.0, 46.0, 47.5, 49.0, 50.5, 52.0, 53.0)
    shape_means: ClassVar[str] = "temperature at which it is softest [degC]"

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Softening about a temperature, with a width of 4 K."""
        del model
        bump = jnp.exp(-0.5 * ((conditions.temperature - shape) / 4.0) ** 2)
        return eqx.tree_at(lambda each: each.liver_modulus, change, change.liver_modulus * (1.0 - strength * bump))
