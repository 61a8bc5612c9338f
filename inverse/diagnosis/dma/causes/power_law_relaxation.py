"""Relaxation by a power law."""

from jaxtyping import Array, Float

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause


class PowerLawRelaxation(DmaCause):
    """A fractional order in place of a single relaxation time."""

    name = "power-law-relaxation"
    place = "material: viscoelasticity"
    unit = "1"
    sign = 1
    plausible = 0.5
    largest = 0.95
    sentence = "Stress relaxes by a power law, over many decades of time, where the model has one relaxation time."
    helps = "The fractional model has it already; with the conventional one (--model zener) it is tested."
    source = "Kohandel et al. (2005), as cited by Suomi et al. (2016); scale assumed: order 0.5"

    def material(self, constants: Float[Array, "sweep 4"], strength: Strength) -> Float[Array, "sweep 4"]:
        """Order less the strength."""
        return constants.at[:, 3].add(-strength)
