"""Viscous drag of the bath."""

from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState


class BathViscosity(DmaCause):
    """Viscous drag of the bath."""

    name = "bath-viscosity"
    place = "instrument: bath"
    unit = "Pa s"
    sign = 1
    plausible = 1.0
    sentence = (
        "The bath is squeezed and sheared along with the sample, which adds to the loss modulus in proportion to "
        "frequency."
    )
    helps = "A run in the bath without a sample, or a sweep in air."
    source = (
        "Stefan (1874), as quoted: squeeze between discs, 3 pi eta R^4 / (2 h^3) times speed; scale: water in "
        "a gap of 1 mm, assumed"
    )

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Loss modulus plus viscosity times frequency."""
        del shape
        return modulus + 1j * strength * state.conditions.angular_frequency
