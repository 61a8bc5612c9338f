"""What a named cause of misfit of a curve of displacement is: an extension of one link of the chain.

The chain goes from the constants of the model over the temperature at the focus and the state of the tissue there to
the displacement, and from that to what the instrument reports. A cause overrides one link and is nothing at strength 0.
To add one, copy a file of `inverse/diagnosis/hmi/causes` and put it into the library there.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from arfjax import Model
from inverse.diagnosis.cause import Cause, Strength

States = Float[Array, " state"]
OFF_AXIS_REACH = 1.25e-3
"""Distance from the axis up to which the fall of temperature is known [m]."""


class HmiConditions(eqx.Module):
    """What the tissue had gone through in each state, in the simulation before any fit.

    Attributes:
        temperature: That the thermometer showed [degC].
        time: Since the start of the sonication [s]: as measured, or where the simulation gets to that temperature.
        share: Part of the sonication that had passed, 0 to 1.
        rise_rate: Of the temperature at the focus [K/s].
        age: Time before each state, from 0 to the start of the sonication, closer the more recent [s].
        past_rise_rate: Of the temperature at the focus, so long before [K/s].
        coagulated: Part of the tissue at the focus that had coagulated, 0 to 1.
        since_coagulation: Time since half of it had [s]; 0 before.
        off_axis_fall: Logarithm of the rise of temperature on the axis over that beside it, as a polynomial of the
            distance squared without a constant [1/m^2, 1/m^4, 1/m^6], as far out as `OFF_AXIS_REACH`.
        is_reference: Whether it is the reading that a curve in percent was divided by.
        start_temperature: Of the sonication [degC].
        push_duration: [s].
    """

    temperature: States
    time: States
    share: States
    rise_rate: States
    age: Float[Array, "state age"]
    past_rise_rate: Float[Array, "state age"]
    coagulated: States
    since_coagulation: States
    off_axis_fall: Float[Array, "state 3"]
    is_reference: Bool[Array, " state"]
    start_temperature: Float[Array, ""]
    push_duration: Float[Array, ""]

    @property
    def rise(self) -> States:
        """Of the temperature since the start [K]."""
        return self.temperature - self.start_temperature


class TissueChange(eqx.Module):
    """How the tissue differs from what the model's laws say, in each state.

    Attributes:
        attenuation: Factor of the liver's.
        sound_speed: Added to the liver's [m/s].
        liver_modulus: Factor of all moduli of liver.
        lesion_modulus: Factor of all moduli of the lesion.
        rim: Added to the lesion's share, times share times what lacks to 1.
        threshold: Factor of the dose that coagulates.
        force: Factor of the radiation force.
    """

    attenuation: States
    sound_speed: States
    liver_modulus: States
    lesion_modulus: States
    rim: States
    threshold: States
    force: States


def unchanged(count: int) -> TissueChange:
    """Tissue as the laws say."""
    one, none = jnp.ones(count), jnp.zeros(count)
    return TissueChange(one, none, one, one, none, one, one)


class HmiCause(Cause):
    """A named cause of misfit of a curve of displacement."""

    def model(self, model: Model, strength: Strength, shape: Strength) -> Model:
        """The model with its constants changed throughout.

        Args:
            model: As it is, or as other causes left it.
            strength: Of the cause, in its unit; at 0 nothing changes.
            shape: Its second parameter; 0 for a cause without one.
        """
        del strength, shape
        return model

    def temperature(
        self, temperature: States, conditions: HmiConditions, strength: Strength, shape: Strength
    ) -> States:
        """The temperature that the focus has where the thermometer shows `conditions.temperature` [degC].

        Args:
            temperature: What other causes make of it [degC].
            conditions: Of the states.
            strength: Of the cause, in its unit; at 0 nothing changes.
            shape: Its second parameter; 0 for a cause without one.
        """
        del conditions, strength, shape
        return temperature

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        """How the tissue departs from its laws in each state.

        Args:
            change: What other causes make of it.
            conditions: Of the states.
            model: With what other causes changed throughout.
            strength: Of the cause, in its unit; at 0 nothing changes.
            shape: Its second parameter; 0 for a cause without one.
        """
        del conditions, model, strength, shape
        return change

    def measured(self, displacement: States, conditions: HmiConditions, strength: Strength, shape: Strength) -> States:
        """The displacement that the instrument reports.

        Args:
            displacement: Of the tissue, in units of that of the coldest state.
            conditions: Of the states.
            strength: Of the cause, in its unit; at 0 nothing changes.
            shape: Its second parameter; 0 for a cause without one.
        """
        del conditions, strength, shape
        return displacement
