"""Thermocouple beside the focus."""

import jax.numpy as jnp

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import OFF_AXIS_REACH, HmiCause, HmiConditions, States


class ThermocouplePosition(HmiCause):
    """Thermocouple beside the focus."""

    name = "thermocouple-position"
    place = "instruments: thermocouple"
    unit = "mm^2"
    sign = 1
    plausible = 0.25
    largest = 1e6 * OFF_AXIS_REACH**2
    sentence = (
        "The thermocouple lies beside the axis, where it is cooler, the more so the shorter the sonication has lasted."
    )
    helps = "A second sensor, an image of the wire, or a scan of the focus across it."
    source = (
        "Hariharan et al. (2014), IEEE Trans. UFFC 61, 2019: rises beside a beam tell where it is, to 0.06 mm; profile "
        "of the simulated temperature across the axis; scale assumed: half a millimetre"
    )

    def temperature(
        self, temperature: States, conditions: HmiConditions, strength: Strength, shape: Strength
    ) -> States:
        """The rise at the focus from that beside it."""
        del shape
        # Farther out it is held: nothing is known of the temperature there.
        square = 1e-6 * jnp.minimum(strength, self.largest)
        fall = conditions.off_axis_fall @ jnp.stack([square, square**2, square**3])
        return conditions.start_temperature + (temperature - conditions.start_temperature) * jnp.exp(fall)
