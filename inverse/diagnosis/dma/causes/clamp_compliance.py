"""Compliance of the clamp in series with the sample."""

from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState


class ClampCompliance(DmaCause):
    """Compliance of the clamp in series with the sample."""

    name = "clamp-compliance"
    place = "instrument: displacement reading"
    unit = "1/Pa"
    sign = 1
    plausible = 1e-07
    sentence = "The clamp gives way in series with the sample, which lowers the modulus most where the sample is stiff."
    helps = (
        "A second sample of half the thickness: a compliance in series maps a fractional Zener solid onto another one."
    )
    source = (
        "Hossain et al. (2025), doi 10.1007/s00397-024-01481-9: compliance of a machine lowers moduli; scale: "
        "a clamp of 4e5 N/m on a 20 x 20 x 10 mm sample, assumed"
    )

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Compliances of sample and clamp in series."""
        del state, shape
        return modulus / (1.0 + strength * modulus)
