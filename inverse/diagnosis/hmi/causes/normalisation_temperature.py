"""Curves that were divided by a reading at another temperature than said."""

import jax.numpy as jnp

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States


class NormalisationTemperature(HmiCause):
    """Curves that were divided by a reading at another temperature than said."""

    name = "normalisation-temperature"
    place = "instruments: displacement"
    unit = "K"
    sign = 0
    plausible = 3.0
    sentence = "The reading that the curve is divided by was taken at another temperature than stated."
    helps = "Displacement in metres, or the temperature of the reading that it was divided by."
    source = "Assumed; the paper divides by a reading at 37 degC in one place and at 35 degC in another"

    def temperature(
        self, temperature: States, conditions: HmiConditions, strength: Strength, shape: Strength
    ) -> States:
        """The reference reading at another temperature."""
        del shape
        return jnp.where(conditions.is_reference, temperature + strength, temperature)
