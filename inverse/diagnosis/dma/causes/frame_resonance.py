"""Resonance of the instrument's frame."""

from typing import ClassVar

from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState

QUALITY = 10.0
"""Of the resonance, assumed."""


class FrameResonance(DmaCause):
    """Resonance of the instrument's frame."""

    name = "frame-resonance"
    place = "instrument: force balance"
    unit = "1"
    sign = 0
    plausible = 0.3
    sentence = "A resonance of the frame above the sweep raises or lowers the modulus towards the highest frequencies."
    helps = "Frequencies up to the resonance, or a run with a known elastic spring."
    source = (
        "Catania & Amadori (2025): frame and moving mass in what a DMA measures; one mode, its quality and "
        "scale assumed"
    )
    shapes: ClassVar[tuple[float, ...]] = (1.25, 1.75, 3.0)
    shape_means: ClassVar[str] = "resonance over the highest frequency"

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Response of a damped oscillator, as a part of the modulus."""
        resonance = shape * state.conditions.highest
        ratio = state.conditions.angular_frequency / resonance
        response = ratio**2 / (1.0 - ratio**2 + 1j * ratio / QUALITY)
        return modulus * (1.0 + strength * response)
