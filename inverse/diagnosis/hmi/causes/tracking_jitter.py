"""Scatter of tracking that adds to small displacements."""

import jax.numpy as jnp

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States


class TrackingJitter(HmiCause):
    """Scatter of tracking that adds to small displacements."""

    name = "tracking-jitter"
    place = "instruments: tracking"
    unit = "1"
    sign = 1
    plausible = 0.05
    sentence = "An amplitude that is estimated from noisy motion is never smaller than the noise: squares of both add."
    helps = "More averaged pushes: the effect falls with their number."
    source = (
        "Rician bias of an amplitude, Gudbjartsson & Patz (1995); Walker & Trahey (1995) for its size; scale assumed"
    )

    def measured(self, displacement: States, conditions: HmiConditions, strength: Strength, shape: Strength) -> States:
        """The root of the sum of squares."""
        del conditions, shape
        return jnp.sqrt(displacement**2 + strength)
