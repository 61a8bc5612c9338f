"""Noise floor of the force, rectified into its amplitude."""

import jax.numpy as jnp
from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState


class NoiseFloor(DmaCause):
    """Noise floor of the force, rectified into its amplitude."""

    name = "noise-floor"
    place = "instrument: force reading"
    unit = "Pa^2"
    sign = 1
    plausible = 2.5e5
    sentence = (
        "Noise of the force adds to its amplitude in quadrature, which raises the modulus where the sample is soft."
    )
    helps = "A larger strain amplitude at the softest temperatures."
    source = (
        "Rice (1944): the mean square of an amplitude has that of its noise added; Suomi et al. (2016) "
        "suspect it below 0.3 Hz at 21 degC; scale: (500 Pa)^2, assumed"
    )

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Magnitudes of signal and noise added in quadrature, phase kept."""
        del state, shape
        squared = modulus.real**2 + modulus.imag**2
        return modulus * jnp.sqrt(1.0 + strength / squared)
