"""Sound that shocks before the focus, so that more power brings less."""

import equinox as eqx
import jax.numpy as jnp

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class AcousticSaturation(HmiCause):
    """Sound that shocks before the focus, so that more power brings less."""

    name = "acoustic-saturation"
    place = "acoustics: nonlinearity"
    unit = "1"
    sign = 1
    plausible = 0.3
    sentence = (
        "Nonlinear loss before the focus grows with the pressure there: tissue that attenuates less loses a part "
        "of what it lets through."
    )
    helps = "Half the power: a saturated focus loses less than half."
    source = "Bessonova et al. (2009): shocks limit the pressure at a focus; scale assumed"

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Force lost as attenuation in 20 mm of liver falls below that at the start."""
        del shape
        attenuation = model.liver.attenuation.evaluate
        less = attenuation(conditions.temperature) - attenuation(conditions.start_temperature)
        through = jnp.exp(-2.0 * 0.02 * less * 1e-6 * model.drive.frequency)
        return eqx.tree_at(lambda each: each.force, change, change.force * through ** (-strength))
