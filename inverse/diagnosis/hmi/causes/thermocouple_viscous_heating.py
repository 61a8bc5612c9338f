"""Heat that the sound makes at the thermocouple itself."""

from typing import ClassVar

import jax.numpy as jnp

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States


class ThermocoupleViscousHeating(HmiCause):
    """Heat that the sound makes at the thermocouple itself."""

    name = "thermocouple-viscous-heating"
    place = "instruments: thermocouple"
    unit = "K"
    sign = 1
    plausible = 3.0
    sentence = (
        "Tissue that moves along the wire heats it while the sound is on: the thermocouple reads too high by a "
        "rise of its own that comes within seconds."
    )
    helps = (
        "Switch the sound off for a moment: the artefact decays within seconds. Or a fibre-optic sensor, or MR "
        "thermometry."
    )
    source = (
        "Kamimura et al. (2020): up to 81 % of a wire's reading; Tiennot et al. (2019): up to 90 % of a "
        "simulated rise; scale assumed"
    )
    shapes: ClassVar[tuple[float, ...]] = (1.0, 3.0, 8.0)
    shape_means: ClassVar[str] = "time in which the wire warms [s]"

    def temperature(
        self, temperature: States, conditions: HmiConditions, strength: Strength, shape: Strength
    ) -> States:
        """What the wire shows less its own heat."""
        built = 1.0 - jnp.exp(-conditions.time / shape)
        return temperature - strength * built
