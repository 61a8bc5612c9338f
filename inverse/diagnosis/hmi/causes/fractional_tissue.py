"""Tissue that creeps by a power law within a push."""

import math

import equinox as eqx
import jax.numpy as jnp

from arfjax import Model
from arfjax.laws import ViscoelasticLaw
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States, TissueChange

FIRST_TERM = 2.0 / math.sqrt(math.pi)
"""Of the Mittag-Leffler function of order one half: 1 / Gamma(3/2)."""


class FractionalTissue(HmiCause):
    """Tissue that creeps by a power law within a push."""

    name = "fractional-tissue"
    place = "tissue: viscoelasticity"
    unit = "1"
    sign = 1
    plausible = 0.5
    sentence = (
        "Tissue relaxes by a power of time, so that it gives way within half a millisecond where a single "
        "relaxation time has not begun to."
    )
    helps = "Pushes of several durations, or several modulation frequencies."
    source = (
        "Suomi et al. (2016), fractional against conventional Zener solid; strength 1 is a power of one half in full"
    )

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Moduli at the end of the push, by the first term of a power law of order one half.

        A modulated push counts as long as it is: its force acts half as long before the reading on average, as that of
        a constant one does.
        """
        del shape

        def lost(law: ViscoelasticLaw) -> States:
            time = law.relaxation_time.evaluate(conditions.temperature)
            return 1.0 / (1.0 + strength * FIRST_TERM * jnp.sqrt(conditions.push_duration / time))

        liver = model.liver.viscoelasticity
        assert liver is not None  # `Model` checks it
        return eqx.tree_at(
            lambda each: (each.liver_modulus, each.lesion_modulus),
            change,
            (change.liver_modulus * lost(liver), change.lesion_modulus * lost(model.lesion.viscoelasticity)),
        )
