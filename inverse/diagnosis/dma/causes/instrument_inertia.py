"""Mass that moves with the sample and was not taken off."""

from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState


class InstrumentInertia(DmaCause):
    """Mass that moves with the sample and was not taken off."""

    name = "instrument-inertia"
    place = "instrument: force balance"
    unit = "Pa s^2"
    sign = 1
    plausible = 0.01
    sentence = "A moving mass takes force in proportion to the square of frequency, which lowers the storage modulus."
    helps = "A run without a sample, or with a known elastic spring, gives the mass."
    source = (
        "Klemuk & Titze (2009): errors of the storage modulus by inertia; scale: 0.4 g uncompensated on a 20 "
        "x 20 x 10 mm sample, assumed"
    )

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Storage modulus less the mass over the sample's geometry factor times the square of frequency."""
        del shape
        return modulus - strength * state.conditions.angular_frequency**2
