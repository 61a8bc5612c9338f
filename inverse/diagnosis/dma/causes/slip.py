"""Partial slip of the sample in its grip."""

import jax.numpy as jnp
from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState
from inverse.diagnosis.dma.causes.friction import HYSTERESIS


class Slip(DmaCause):
    """Partial slip of the sample in its grip."""

    name = "slip"
    place = "instrument: grip"
    unit = "1"
    sign = 1
    plausible = 0.3
    largest = 0.95
    sentence = (
        "The sample slips in the grip as the force grows, which takes stiffness away and adds friction where the "
        "modulus is high."
    )
    helps = "A smaller strain amplitude, or a rough or glued grip."
    source = (
        "Mindlin & Deresiewicz (1953): partial slip dissipates; loss 4/(3 pi) of the stiffness lost, as of "
        "parabolic loops; scale assumed"
    )

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Stiffness lost in proportion to the force, friction gained."""
        del shape
        part = strength * jnp.abs(modulus) / state.conditions.stiffest
        return modulus * (1.0 - part * (1.0 - 1j * HYSTERESIS))
