"""Blood flow other than assumed."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax import Model
from arfjax.laws import Scalar, Shifted, Temperature
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause

PERFUSED = 15.2 / 1050.0
"""Volume of blood per volume of liver and time, in life [1/s]."""


class _Flow(Shifted):
    """Another flow with some added, but none where that would be negative."""

    def evaluate(self, temperature: Temperature) -> Scalar | Float[Array, "..."]:
        """The sum, or none."""
        return _flowing(super().evaluate(temperature))

    def after(self, temperature: Temperature, dose: Temperature) -> Scalar | Float[Array, "..."]:
        """The sum after a dose, or none."""
        return _flowing(super().after(temperature, dose))


def _flowing(rate: Scalar | Float[Array, "..."]) -> Float[Array, "..."]:
    # Where nothing flows the derivative is that of what is added: `maximum` has half of it there.
    return jnp.where(jnp.asarray(rate) < 0.0, 0.0, rate)


class Perfusion(HmiCause):
    """Blood flow other than assumed."""

    name = "perfusion"
    place = "tissue: heat"
    unit = "1"
    sign = 0
    plausible = 1.0
    least = -1.0
    sentence = (
        "More or less blood flow than assumed: the temperature comes to rest earlier or later, and the lesion has "
        "another shape and dose."
    )
    helps = "The same sonication with and without flow, or the temperature followed while it cools."
    source = (
        "Pennes (1948); Wu & Du (1990), Ultrasound Med. Biol. 16, 489: what it takes of a focused beam's rise; change "
        "over the flow of perfused liver (0.0145 1/s), 15.2 kg/(m^3 s) as in the model; scale assumed, all of it"
    )

    def model(self, model: Model, strength: Strength, shape: Strength) -> Model:
        """Perfusion rate with a part of that of perfused liver added, where that leaves any."""
        del shape
        law = model.liver.perfusion_rate
        more = _Flow(law=law, shift=strength * PERFUSED, unit=law.unit, source=law.source)
        return eqx.tree_at(lambda tree: tree.liver.perfusion_rate, model, more)
