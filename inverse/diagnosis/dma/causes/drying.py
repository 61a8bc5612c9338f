"""Stiffening by loss of water."""

from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState


class Drying(DmaCause):
    """Stiffening by loss of water."""

    name = "drying"
    place = "sample: water content"
    unit = "1"
    sign = 1
    plausible = 0.3
    sentence = "The sample dries and stiffens, the faster the warmer it is, from sweep to sweep."
    helps = "Frequencies in random order, the first temperature repeated at the end, or the sample weighed."
    source = (
        "Gao & Gu (2014), J. Biomech. 47, 3196: moduli rise as the water's share falls; evaporation in proportion to "
        "the pressure of saturated vapour (Magnus formula, as in arfjax); scale assumed: a third over all"
    )

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Modulus times one plus the water lost so far."""
        del shape
        return modulus * (1.0 + strength * state.conditions.exposure)
