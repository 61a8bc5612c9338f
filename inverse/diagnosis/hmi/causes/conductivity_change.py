"""Heat conduction other than assumed."""

import equinox as eqx

from arfjax import Model
from arfjax.laws import Scaled
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause


class ConductivityChange(HmiCause):
    """Heat conduction other than assumed."""

    name = "conductivity-change"
    place = "tissue: heat"
    unit = "1"
    sign = 0
    plausible = 0.3
    least = -0.95
    sentence = (
        "Heat spreads faster or slower than assumed, so that the lesion is wider or narrower at the same temperature."
    )
    helps = "A slow and a fast sonication to the same temperature, or the temperature followed while it cools."
    source = "Guntur et al. (2013), porcine liver: 0.575, 0.520 and 0.754 W/(m K) at 20, 35 and 90 degC; scale assumed"

    def model(self, model: Model, strength: Strength, shape: Strength) -> Model:
        """Conductivity times one plus the strength."""
        del shape
        law = model.liver.conductivity
        more = Scaled(law=law, factor=1.0 + strength, unit=law.unit, source=law.source, valid_range=law.valid_range)
        return eqx.tree_at(lambda tree: tree.liver.conductivity, model, more)
