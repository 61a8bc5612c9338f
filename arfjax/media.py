"""What a medium is at one temperature: plain numbers with units, as frozen pytrees that the solvers take."""

import equinox as eqx
from jaxtyping import Array, Float

from arfjax.units import REFERENCE_FREQUENCY

Scalar = float | Float[Array, ""]
"""A number or a traced scalar: what a leaf of a medium may be."""

Values = float | Float[Array, "..."]
"""A number or an array of them: constants that may vary from point to point."""


class AcousticMedium(eqx.Module):
    """Acoustic constants of a homogeneous medium.

    Attributes:
        density: [kg/m^3].
        sound_speed: Speed of small waves at the reference frequency of 1 MHz [m/s].
        attenuation: Amplitude attenuation coefficient at 1 MHz [Np/m].
        absorption_exponent: Power of frequency with which attenuation grows, y in alpha f^y [1].
        nonlinearity_parameter: B/A [1].
        absorption_fraction: Share of attenuation that is absorption and heats; the rest scatters [1].
    """

    density: Scalar
    sound_speed: Scalar
    attenuation: Scalar
    absorption_exponent: Scalar
    nonlinearity_parameter: Scalar
    absorption_fraction: Scalar = 1.0

    def attenuation_at(self, frequency: Scalar) -> Scalar:
        """Amplitude attenuation coefficient [Np/m] at a frequency [Hz]."""
        return self.attenuation * (frequency / REFERENCE_FREQUENCY) ** self.absorption_exponent


class ThermalMedium(eqx.Module):
    """Thermal constants of a homogeneous medium.

    Attributes:
        conductivity: [W/(m K)].
        heat_capacity: Density times specific heat [J/(m^3 K)].
        perfusion_conductance: Heat that blood takes away per kelvin above arterial temperature: perfusion rate times
            density times specific heat of blood [W/(m^3 K)].
        metabolic_heat: Heat that tissue makes itself [W/m^3].
    """

    conductivity: Values
    heat_capacity: Values
    perfusion_conductance: Values
    metabolic_heat: Values = 0.0


class Zener(eqx.Module):
    """Constants of the conventional Zener (standard linear) solid.

    Attributes:
        relaxed_modulus: Modulus at zero frequency, the paper's M_0 [Pa].
        unrelaxed_modulus: Modulus at infinite frequency, the paper's M_inf [Pa].
        relaxation_time: The paper's tau [s].
    """

    relaxed_modulus: Values
    unrelaxed_modulus: Values
    relaxation_time: Values


class FractionalZener(eqx.Module):
    """Constants of the fractional Zener solid; order 1 is the conventional one.

    Attributes:
        relaxed_modulus: Modulus at zero frequency, the paper's M_0 [Pa].
        unrelaxed_modulus: Modulus at infinite frequency, the paper's M_inf [Pa].
        relaxation_time: The paper's tau [s].
        fractional_order: Order of the derivative, the paper's alpha, from 0 to 1 [1].
    """

    relaxed_modulus: Values
    unrelaxed_modulus: Values
    relaxation_time: Values
    fractional_order: Values
