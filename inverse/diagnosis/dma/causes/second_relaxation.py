"""Second relaxation of the material."""

from typing import ClassVar

from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState


class SecondRelaxation(DmaCause):
    """Second relaxation of the material."""

    name = "second-relaxation"
    place = "material: viscoelasticity"
    unit = "1"
    sign = 1
    plausible = 0.5
    sentence = "The material relaxes a second time, within the sweep, by another mechanism."
    helps = "Frequencies at closer steps about the second relaxation."
    source = "Liu & Bilston (2000): liver by several relaxation times; scale assumed: half the modulus"
    # What the fit leaves of it turns by a right angle within a tenth of the sweep: screened in steps of an eighth, one
    # between two steps had 3.1 left of d' 4.5, and half of them went unseen.
    shapes: ClassVar[tuple[float, ...]] = tuple(round(0.125 + 0.0375 * n, 4) for n in range(21))
    shape_means: ClassVar[str] = "place in the sweep: 0 relaxes at the lowest frequency, 1 at the highest"

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """A branch of the same relaxation time at all temperatures, in proportion to the sweep's modulus."""
        time = state.conditions.lowest ** -(1.0 - shape) * state.conditions.highest**-shape
        z = 1j * state.conditions.angular_frequency * time
        return modulus + strength * state.conditions.level * z / (1.0 + z)
