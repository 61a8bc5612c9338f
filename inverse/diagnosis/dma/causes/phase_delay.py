"""Delay between the two channels of the instrument."""

import jax.numpy as jnp
from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState


class PhaseDelay(DmaCause):
    """Delay between the two channels of the instrument."""

    name = "phase-delay"
    place = "instrument: timing"
    unit = "s"
    sign = 0
    plausible = 0.0001
    sentence = "Displacement and force are read at different times, which turns the phase in proportion to frequency."
    helps = "A run with a known elastic spring, whose phase is zero."
    source = "By definition: phase is angular frequency times delay; scale: one sample at 10 kHz, assumed"

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Phase turned by frequency times the delay."""
        del shape
        return modulus * jnp.exp(1j * state.conditions.angular_frequency * strength)
