"""Bubbles that scatter and push more."""

from typing import ClassVar

import equinox as eqx
import jax

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange


class Cavitation(HmiCause):
    """Bubbles that scatter and push more."""

    name = "cavitation"
    place = "acoustics: field"
    unit = "1"
    sign = 0
    plausible = 0.3
    least = -0.95
    sentence = (
        "Above some temperature gas comes out of solution, and bubbles take sound up and push, or shield the focus."
    )
    helps = "A passive cavitation detector: broadband noise or subharmonics."
    source = (
        "Coussios et al. (2007): bubbles heat, scatter and shield; Suomi et al. (2016): in 4 of 7 "
        "sonications; onset by a logistic 2 K wide, and scale, assumed"
    )
    shapes: ClassVar[tuple[float, ...]] = tuple(60.0 + 1.2 * step for step in range(16))
    shape_means: ClassVar[str] = "temperature of the onset [degC]"

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """Force changed above an onset."""
        del model
        grown = jax.nn.sigmoid((conditions.temperature - shape) / 2.0)
        return eqx.tree_at(lambda each: each.force, change, change.force * (1.0 + strength * grown))
