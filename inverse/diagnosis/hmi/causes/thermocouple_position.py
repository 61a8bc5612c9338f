"""Thermocouple beside the focus."""

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States


class ThermocouplePosition(HmiCause):
    """Thermocouple beside the focus."""

    name = "thermocouple-position"
    place = "instruments: thermocouple"
    unit = "mm^2"
    sign = 1
    plausible = 0.25
    sentence = (
        "The thermocouple lies beside the axis, where it is cooler, the more so the shorter the sonication has lasted."
    )
    helps = "A second sensor, an image of the wire, or a scan of the focus across it."
    source = "Temperature falls with the square of a small distance; scale assumed: half a millimetre"

    def temperature(
        self, temperature: States, conditions: HmiConditions, strength: Strength, shape: Strength
    ) -> States:
        """The rise at the focus from that beside it."""
        del shape
        lost = 1e-6 * strength * conditions.off_axis_drop
        return conditions.start_temperature + (temperature - conditions.start_temperature) * (1.0 + lost)
