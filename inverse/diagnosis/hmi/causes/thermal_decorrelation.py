"""Echoes that change with temperature, so that tracking loses motion."""

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States


class ThermalDecorrelation(HmiCause):
    """Echoes that change with temperature, so that tracking loses motion."""

    name = "thermal-decorrelation"
    place = "instruments: tracking"
    unit = "1"
    sign = 1
    plausible = 0.2
    largest = 0.95
    sentence = (
        "Heating changes the echoes from one frame to the next, the faster the temperature rises: the correlation "
        "falls, and motion is underestimated."
    )
    helps = "Pushes after the sound is off, at the same temperatures without a rise."
    source = (
        "Mast et al. (2008), doi 10.7863/jum.2008.27.12.1685: echoes of liver decorrelate as it is ablated; loss in "
        "proportion to the rate of rise, relative to 5 K/s, assumed"
    )

    def measured(self, displacement: States, conditions: HmiConditions, strength: Strength, shape: Strength) -> States:
        """A loss that grows with the rate of rise."""
        del shape
        return displacement * (1.0 - strength * conditions.rise_rate / 5.0)
