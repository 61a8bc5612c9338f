"""Thermocouple that follows late."""

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States


class ThermocoupleLag(HmiCause):
    """Thermocouple that follows late."""

    name = "thermocouple-lag"
    place = "instruments: thermocouple"
    unit = "s"
    sign = 1
    plausible = 1.0
    sentence = (
        "The thermocouple follows with a time constant: the tissue is hotter than it shows by that time the rate "
        "of rise."
    )
    helps = "Record times beside temperatures, or hold the temperature before a reading."
    source = "First-order lag; scale assumed, from the time constants of wire thermocouples in tissue"

    def temperature(
        self, temperature: States, conditions: HmiConditions, strength: Strength, shape: Strength
    ) -> States:
        """What the wire will show a time constant later."""
        del shape
        return temperature + strength * conditions.rise_rate
