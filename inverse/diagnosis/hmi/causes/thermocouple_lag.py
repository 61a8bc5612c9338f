"""Thermocouple that follows late."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.media import Scalar
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States

_SHORTEST = 1e-9
"""Of times that are divided by [s]."""


class ThermocoupleLag(HmiCause):
    """Thermocouple that follows late."""

    name = "thermocouple-lag"
    place = "instruments: thermocouple"
    unit = "s"
    sign = 1
    plausible = 1.0
    sentence = (
        "The thermocouple follows with a time constant: the tissue is hotter than it shows, by about the rise within "
        "the last time constant."
    )
    helps = "Sonications of other durations to the same temperature, or a temperature held before a reading."
    source = (
        "Int. J. Hyperthermia 8 (1992), 395, doi 10.3109/02656739209021793: heat of a probe decays with a time "
        "constant of its own, there 7 s; first-order lag, and scale, assumed for a wire"
    )

    def temperature(
        self, temperature: States, conditions: HmiConditions, strength: Strength, shape: Strength
    ) -> States:
        """The tissue's, warmer than the wire by what of each past rise the wire has not yet followed."""
        del shape
        return temperature + not_followed(conditions.age, conditions.past_rise_rate, strength)


def not_followed(
    age: Float[Array, "state age"], rate: Float[Array, "state age"], time_constant: Scalar
) -> Float[Array, " state"]:
    """The integral of a rate over its past, what is old forgotten with a time constant.

    Exact for a rate that is linear between the ages, however short the time constant is: at 0 it is 0, and its
    derivative there the present rate.

    Args:
        age: From 0 upwards [s].
        rate: So long ago [K/s].
        time_constant: [s].

    Returns:
        In kelvin.
    """
    forgotten = jnp.exp(-age / jnp.maximum(time_constant, _SHORTEST))
    change = jnp.diff(rate) / jnp.maximum(jnp.diff(age), _SHORTEST)
    bent = jnp.sum(change * -jnp.diff(forgotten), axis=-1)
    ends = rate[..., 0] - rate[..., -1] * forgotten[..., -1]
    return time_constant * (ends + time_constant * bent)
