"""Conditions of a measurement and a proposal together, in which causes are what they are in the measurement alone.

Some causes count in what was measured: slip in the highest modulus, a resonance of the frame in the highest frequency,
a second relaxation in the mean modulus of a sweep and in its ends. Further readings move all of these, and would make
another effect of the same strength and shape, in the readings that there are as well.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from inverse.datasets.dma_checks import SWEEP_GAP
from inverse.diagnosis.dma.cause import DmaConditions
from inverse.diagnosis.dma.problem import DmaProblem


class FurtherConditions(DmaConditions):
    """Conditions of more readings than strengths and shapes are told by.

    Attributes:
        first: Of those that they are told by.
    """

    first: DmaConditions

    @property
    def highest(self) -> Float[Array, ""]:
        """Highest angular frequency of the first [rad/s]."""
        return self.first.highest

    @property
    def lowest(self) -> Float[Array, ""]:
        """Lowest angular frequency of the first [rad/s]."""
        return self.first.lowest


def as_at_first(further: DmaProblem, first: DmaProblem) -> DmaProblem:
    """More data as a problem in which strengths and shapes mean what they do in the first; see also `whole_drying`.

    Args:
        further: What was measured, and more.
        first: What was measured.
    """
    now, was = further.conditions, first.conditions
    level = np.array(now.level)
    for index, sweep in enumerate(further.sweeps):
        for place, known in enumerate(first.sweeps):
            if known.sample == sweep.sample and abs(known.temperature_c - sweep.temperature_c) <= SWEEP_GAP:
                level[np.asarray(now.sweep) == index] = float(was.level[int(np.argmax(np.asarray(was.sweep) == place))])
    kept = {field.name: getattr(now, field.name) for field in dataclasses.fields(now)}
    kept |= {"level": jnp.asarray(level), "softest": was.softest, "stiffest": was.stiffest}
    return dataclasses.replace(further, conditions=FurtherConditions(**kept, first=was))
