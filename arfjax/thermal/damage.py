r"""Damage laws: how fast tissue coagulates at a temperature, and what a temperature history has done to it.

A law gives the logarithm of its rate, because rates span forty decades between 37 and 120 degC and their frequency
factors do not fit into float32. Damage is the integral of the rate over time; tissue counts as coagulated where it
reaches the law's threshold.
"""

import abc
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.laws import LETHAL_DOSE_MINUTES as LETHAL_DOSE_MINUTES
from arfjax.laws import Temperature
from arfjax.laws import coagulated_fraction as coagulated_fraction
from arfjax.laws import log_excess as log_excess
from arfjax.media import Scalar
from arfjax.numerics.decay import mean_decay
from arfjax.thermal.history import require_course
from arfjax.units import SECONDS_PER_MINUTE, ZERO_CELSIUS_IN_KELVIN

REFERENCE_TEMPERATURE = 43.0
"""Temperature [degC] at which dose is counted, and where its rate breaks."""

DOUBLINGS_PER_KELVIN_ABOVE = 1.0
"""R = 0.5: a kelvin more halves the time for the same effect. Sapareto & Dewey, IJROBP 10 (1984) 787."""

DOUBLINGS_PER_KELVIN_BELOW = 2.0
"""R = 0.25 below the break. Sapareto & Dewey, IJROBP 10 (1984) 787."""

GAS_CONSTANT = 8.314462618
"""[J/(mol K)], exact in the SI of 2019."""

LOG_BOLTZMANN_OVER_PLANCK = math.log(1.380649e-23 / 6.62607015e-34)
"""ln of k_B / h in 1/(s K), exact in the SI of 2019; as a logarithm, because h is no number of float32."""


class DamageLaw(eqx.Module):
    """How fast tissue is damaged at a temperature.

    Attributes:
        threshold: Damage at which tissue counts as coagulated, in the law's unit of damage.
    """

    threshold: eqx.AbstractVar[Scalar]

    @abc.abstractmethod
    def log_rate(self, temperature: Temperature) -> Float[Array, "..."]:
        """Natural logarithm of the damage per second at a temperature [degC]."""


class ThermalDose(DamageLaw):
    """CEM43: damage is counted in equivalent minutes at 43 degC.

    Attributes:
        doublings_per_kelvin_below: Of the rate, below 43 degC: 2 is R = 0.25; 1 is R = 0.5 throughout, for comparison
            with codes that do so.
        threshold: [equivalent min].

    Differentiability: everywhere; at 43 degC itself the upper slope.
    Source: Sapareto & Dewey, IJROBP 10 (1984) 787.
    """

    doublings_per_kelvin_below: Scalar = DOUBLINGS_PER_KELVIN_BELOW
    threshold: Scalar = LETHAL_DOSE_MINUTES

    def log_rate(self, temperature: Temperature) -> Float[Array, "..."]:
        """Logarithm of R^(43 - T) / 60, equivalent minutes per second."""
        excess = jnp.asarray(temperature) - REFERENCE_TEMPERATURE
        doublings = jnp.where(excess >= 0.0, DOUBLINGS_PER_KELVIN_ABOVE, self.doublings_per_kelvin_below)
        return math.log(2.0) * doublings * excess - math.log(SECONDS_PER_MINUTE)


class ArrheniusDamage(DamageLaw):
    r"""A reaction of first order, $A e^{-E/(R T)}$: a damage of D leaves the fraction exp(-D) of the tissue as it was.

    Attributes:
        log_frequency_factor: ln of A in 1/s.
        activation_energy: E [J/mol].
        threshold: 1 stands for 63 percent coagulated.

    Source of the default: human liver, A = 7.39e39 1/s and E = 2.577e5 J/mol, of the material library of COMSOL's
    Bioheat module, as its documentation states them.
    """

    log_frequency_factor: Scalar = math.log(7.39) + 39.0 * math.log(10.0)
    activation_energy: Scalar = 2.577e5
    threshold: Scalar = 1.0

    def log_rate(self, temperature: Temperature) -> Float[Array, "..."]:
        """Logarithm of the rate in 1/s: ln A - E / (R T)."""
        kelvin = jnp.asarray(temperature) + ZERO_CELSIUS_IN_KELVIN
        return self.log_frequency_factor - self.activation_energy / (GAS_CONSTANT * kelvin)


class TransitionStateDamage(DamageLaw):
    r"""A reaction of first order at Eyring's rate, $\frac{k_B T}{h} e^{\Delta S / R - \Delta H / (R T)}$.

    Attributes:
        activation_entropy: Delta S [J/(mol K)].
        activation_enthalpy: Delta H [J/mol].
        threshold: ln 2 stands for half coagulated, which is what was measured.

    Source of the default: whiteness of pig liver after water baths, Jacques, Newman & He (ASME winter meeting 1991) as
    Jacques retells it from memory at omlc.org/news/may06/livercoag (2006); there, coagulation really began ten times
    sooner and ended ten times later than one such rate says.
    """

    activation_entropy: Scalar = 553.5
    activation_enthalpy: Scalar = 2.768e5
    threshold: Scalar = math.log(2.0)

    def log_rate(self, temperature: Temperature) -> Float[Array, "..."]:
        """Logarithm of Eyring's rate in 1/s."""
        kelvin = jnp.asarray(temperature) + ZERO_CELSIUS_IN_KELVIN
        barrier = (self.activation_entropy - self.activation_enthalpy / kelvin) / GAS_CONSTANT
        return LOG_BOLTZMANN_OVER_PLANCK + jnp.log(kelvin) + barrier


def damage_increment(
    law: DamageLaw,
    before: Float[Array, "*space"] | Float[np.ndarray, "*space"],
    after: Float[Array, "*space"] | Float[np.ndarray, "*space"],
    duration: Scalar,
) -> Float[Array, "*space"]:
    r"""Damage of an interval of time, the logarithm of whose rate is taken to change linearly.

    $$ \Delta t \, \frac{e^{l_1} - e^{l_0}}{l_1 - l_0} $$

    Args:
        law: Of damage.
        before: Temperature at the start [degC].
        after: Temperature at the end [degC].
        duration: [s].

    Accuracy: that of `accumulated_damage`. No overflow while the law's rate itself has none.
    Differentiability: everywhere, to any order, also where `before` equals `after`.
    """
    start, end = jnp.broadcast_arrays(law.log_rate(before), law.log_rate(after))
    return duration * _mean_rate(start, end)


def accumulated_damage(
    law: DamageLaw,
    temperature: Float[Array, "time *space"] | Float[np.ndarray, "time *space"],
    time: Float[Array, " time"] | Float[np.ndarray, " time"],
) -> Float[Array, "time *space"]:
    r"""Damage of a temperature history, at each of its times.

    Args:
        law: Of damage.
        temperature: Tissue temperature [degC].
        time: When it was sampled, ascending, evenly or not [s].

    Returns:
        Damage in the law's unit, 0 at the first time.

    Raises:
        InputError: if there is not one time for each temperature; of concrete input, if times do not ascend, or
            temperatures start above 200 degC and must be in kelvin.

    Accuracy: second order in the sampling interval dt, and exact for a temperature that is linear in time where the
    law's logarithm is linear in temperature, as that of thermal dose on either side of 43 degC. Else the relative
    error is dt^2 / 12 times the second derivative of the logarithm of the rate: the default Arrhenius law at 60 degC
    comes out 1.4e-4 too low where temperature changes linearly by 1 K between samples, 45 times closer than by the
    trapezoidal rule. An interval in which thermal dose crosses 43 degC by a change of d kelvin loses at most
    dt d ln(2) / 8, 0.0014 min at 1 K and 1 s. A sonication that is switched off has a sharp peak of the rate, which
    this meets 20 times closer than trapezia do (1 s of heat sampled every 0.1 s: dose 0.3 % instead of 9 %); a peak as
    round as the sampling is fine is met closer by trapezia, whose errors cancel there. In float32, 1e-5.
    Differentiability: in temperature, time and the law's constants; at 43 degC the upper slope. Values and slopes of
    all laws here are finite to 120 degC in float32 and beyond.
    """
    require_course(temperature, time)
    temperature = jnp.asarray(temperature)
    increments = jax.vmap(lambda before, after, duration: damage_increment(law, before, after, duration))(
        temperature[:-1], temperature[1:], jnp.diff(jnp.asarray(time))
    )
    nothing = jnp.zeros_like(increments, shape=increments.shape[1:])
    # Half the time of `cumsum` on a processor, which computes every increment several times over.
    _, damage = jax.lax.scan(lambda total, more: (total + more, total + more), nothing, increments)
    return jnp.concatenate([nothing[None], damage])


@jax.custom_jvp
def _mean_rate(start: Float[Array, "*space"], end: Float[Array, "*space"]) -> Float[Array, "*space"]:
    """Mean of a rate whose logarithm goes in a straight line from `start` to `end`."""
    return _mean_of_exponential(start, end)


@_mean_rate.defjvp
def _mean_rate_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    # The slopes in both ends once, in however many directions: there are millions of intervals, and a series in each.
    mean, pull = jax.vjp(_mean_of_exponential, *primals)
    at_start, at_end = pull(jnp.ones_like(mean))
    return mean, at_start * tangents[0] + at_end * tangents[1]


def _mean_of_exponential(start: Float[Array, "*space"], end: Float[Array, "*space"]) -> Float[Array, "*space"]:
    rising = end >= start
    higher, lower = jnp.where(rising, end, start), jnp.where(rising, start, end)
    return jnp.exp(higher) * mean_decay(higher - lower)  # from the higher end: nothing can overflow
