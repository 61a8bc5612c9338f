"""Power of frequency in attenuation that changes with temperature."""

import equinox as eqx
import jax.numpy as jnp

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class ExponentChange(HmiCause):
    """Power of frequency in attenuation that changes with temperature."""

    name = "exponent-change"
    place = "tissue: attenuation"
    unit = "1"
    sign = 0
    plausible = 0.2
    sentence = (
        "The exponent of attenuation changes with temperature, so that attenuation at this frequency does not "
        "follow that at 1 MHz."
    )
    helps = "A second frequency."
    source = (
        "Suomi et al. (2016): ablation lowers the exponent by less than 0.3 % on average; scale assumed, far "
        "above that, from 37 to 80 degC"
    )

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Attenuation at the drive's frequency with an exponent that goes with the rise."""
        del shape
        exponent = strength * conditions.rise / 43.0
        factor = jnp.exp(exponent * jnp.log(1e-6 * model.drive.frequency))
        return eqx.tree_at(lambda each: each.attenuation, change, change.attenuation * factor)
