"""Apparent displacement from a sound speed that changes."""

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States


class EchoStrain(HmiCause):
    """Apparent displacement from a sound speed that changes."""

    name = "echo-strain"
    place = "instruments: tracking"
    unit = "1"
    sign = 0
    plausible = 0.1
    sentence = (
        "Tissue that warms changes its sound speed, so that echoes shift as if tissue had moved: an offset that "
        "goes with the rate of rise."
    )
    helps = "Frames without a push at the same moments: what moves there is apparent."
    source = "Maass-Moreno & Damianou (1996), thermal echo strain; scale assumed, of the coldest displacement at 5 K/s"

    def measured(self, displacement: States, conditions: HmiConditions, strength: Strength, shape: Strength) -> States:
        """An offset in proportion to the rate of rise."""
        del shape
        return displacement + strength * conditions.rise_rate / 5.0
