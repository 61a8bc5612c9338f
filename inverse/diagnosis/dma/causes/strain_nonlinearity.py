"""Modulus that depends on strain."""

import jax.numpy as jnp
from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState
from inverse.diagnosis.dma.causes.friction import HYSTERESIS


class StrainNonlinearity(DmaCause):
    """Modulus that depends on strain."""

    name = "strain-nonlinearity"
    place = "material: linearity"
    unit = "1"
    sign = 0
    plausible = 0.3
    least, largest = -0.95, 0.95
    sentence = "The strain is larger where the sample is soft, and large strain softens (or stiffens) and dissipates."
    helps = "Two strain amplitudes at one temperature."
    source = (
        "Rayleigh's law of hysteresis (IEC 60050, 221-03-32): by the first harmonic of its loops loss is 4/(3 "
        "pi) of the stiffness lost, at constant force; scale assumed"
    )

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Stiffness lost in proportion to the strain, which is one over the modulus at constant force."""
        del shape
        part = strength * state.conditions.softest / jnp.abs(modulus)
        return modulus * (1.0 - part * (1.0 - 1j * HYSTERESIS))
