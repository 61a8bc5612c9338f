"""Sample colder than its bath."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState


class TemperatureLag(DmaCause):
    """Sample colder than its bath."""

    name = "temperature-lag"
    place = "sample: temperature"
    unit = "1"
    sign = 1
    plausible = 0.3
    largest = 1.0
    sentence = "The sample is still on its way from the temperature before when the sweep begins."
    helps = "Longer waiting before each sweep, or the sweep repeated at the same temperature."
    source = (
        "Alves & Mano (2000), Thermochim. Acta 346, 133: a sample in a DMA is not at the temperature that is shown; "
        "first-order heating, and scale, assumed: a third of the step is still to go"
    )
    shapes: ClassVar[tuple[float, ...]] = (0.2, 0.5)
    shape_means: ClassVar[str] = "time constant over the duration of a sweep"

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Modulus on its way from that of the temperature before to that of this one."""
        remaining = strength * jnp.exp(-state.conditions.time_in_sweep / shape)
        return modulus * jnp.exp(remaining * (jnp.log(state.before) - jnp.log(modulus)))
