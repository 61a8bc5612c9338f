"""Drainage of fluid from the pores."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState


class PoroelasticDrainage(DmaCause):
    """Drainage of fluid from the pores."""

    name = "poroelastic-drainage"
    place = "material: fluid in its pores"
    unit = "1"
    sign = 1
    plausible = 0.5
    sentence = (
        "Fluid drains from the sample at low frequency and is locked in at high: stiffness rises as the root of "
        "frequency."
    )
    helps = "A sample of another width: the drainage time grows with its square."
    source = "Biot (1941), a column confined at its sides and drained at one end; scale assumed: half the modulus"
    shapes: ClassVar[tuple[float, ...]] = tuple(round(0.04 * n, 2) for n in range(26))
    shape_means: ClassVar[str] = "place in the sweep: 0 drains at the lowest frequency, 1 at the highest"

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Stiffness that locked-in fluid adds, in proportion to the sweep's modulus."""
        time = state.conditions.lowest ** -(1.0 - shape) * state.conditions.highest**-shape
        root = jnp.sqrt(1j * state.conditions.angular_frequency * time)
        decay = jnp.exp(-2.0 * root)
        drained = (1.0 - decay) / (1.0 + decay) / root
        return modulus + strength * state.conditions.level * (1.0 - drained)
