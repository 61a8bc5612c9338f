"""A boundary near the focus, which shear waves reach within the push."""

import equinox as eqx
import jax.numpy as jnp

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class NearBoundary(HmiCause):
    """A boundary near the focus, which shear waves reach within the push."""

    name = "near-boundary"
    place = "mechanics: boundary"
    unit = "1"
    sign = 0
    plausible = 0.1
    sentence = (
        "A boundary near the focus sends the shear wave back within the push; it comes the earlier, the stiffer "
        "the tissue is."
    )
    helps = "A shorter push, or another depth."
    source = (
        "Palmeri et al. (2006), IEEE UFFC 53, 2065: shear waves from boundaries alter displacement after a push; twice "
        "the distance over shear speed against its duration; strength relative to liver at the start, assumed"
    )

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Force changed with the square root of the lesion's modulus over its value at the start."""
        del shape
        law = model.lesion.viscoelasticity.branch_modulus
        faster = jnp.sqrt(law.evaluate(conditions.temperature) / law.evaluate(conditions.start_temperature)) - 1.0
        return eqx.tree_at(
            lambda each: each.force, change, change.force * (1.0 - strength * conditions.coagulated * faster)
        )
