"""What a medium is at one temperature: plain numbers with units, as frozen pytrees that the solvers take."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.errors import InputError
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


LARGEST_MODULUS = 1e13
"""[Pa], or [Pa s] of a viscosity: ten times diamond. Fits that data leave open say tens of GPa of a polymer."""


class Elastic(eqx.Module):
    """An elastic solid.

    Attributes:
        modulus: At every frequency [Pa].
    """

    modulus: Values

    def __check_init__(self) -> None:
        """Refuse constants that no tissue has."""
        _check("modulus", self.modulus, "Pa")


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

    def __check_init__(self) -> None:
        """Refuse constants that no tissue has."""
        _check_zener(self)


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

    def __check_init__(self) -> None:
        """Refuse constants that no tissue has."""
        _check_zener(self)
        _check("fractional_order", self.fractional_order, "", largest=1.0)


class KelvinVoigt(eqx.Module):
    """A spring beside a dashpot: complex modulus $M_0 + i omega eta$.

    Attributes:
        relaxed_modulus: Modulus at zero frequency [Pa].
        viscosity: [Pa s].
    """

    relaxed_modulus: Values
    viscosity: Values

    def __check_init__(self) -> None:
        """Refuse constants that no tissue has."""
        _check("relaxed_modulus", self.relaxed_modulus, "Pa")
        _check("viscosity", self.viscosity, "Pa s")


class FractionalKelvinVoigt(eqx.Module):
    """A spring beside a spring-pot: complex modulus $M_0 + eta (i omega)^alpha$; order 1 is Kelvin and Voigt's.

    Attributes:
        relaxed_modulus: Modulus at zero frequency [Pa]; 0 is a spring-pot alone.
        viscosity: Of the spring-pot [Pa s^fractional_order].
        fractional_order: Order of the derivative, above 0 and up to 1 [1].
    """

    relaxed_modulus: Values
    viscosity: Values
    fractional_order: Values

    def __check_init__(self) -> None:
        """Refuse constants that no tissue has."""
        _check("relaxed_modulus", self.relaxed_modulus, "Pa")
        _check("viscosity", self.viscosity, "Pa s^order")
        _check("fractional_order", self.fractional_order, "", largest=1.0)
        if _is_numeric(self.fractional_order) and np.any(np.asarray(self.fractional_order) == 0.0):
            raise InputError("`fractional_order` of a spring-pot must be above 0; at 0 it is a spring: `Elastic`.")


class Prony(eqx.Module):
    """Several relaxations: a relaxation modulus that is a sum of exponentials, of a point or of a field.

    A branch's modulus may be negative where the sum is a solid all the same: in the pair that stands for a viscosity.

    Attributes:
        relaxed_modulus: Modulus after all has relaxed [Pa].
        branch_moduli: Modulus that each branch adds at first [Pa].
        relaxation_times: Of each branch [s].
    """

    relaxed_modulus: Values
    branch_moduli: Float[Array, "branch *space"] | Float[np.ndarray, "branch *space"]
    relaxation_times: Float[Array, "time *space"] | Float[np.ndarray, "time *space"]

    def __check_init__(self) -> None:
        """Refuse constants that no tissue has, and branches without a relaxation time."""
        _check("relaxed_modulus", self.relaxed_modulus, "Pa")
        _check("relaxation_times", self.relaxation_times, "s", largest=np.inf)
        if self.branch_moduli.shape[0] != self.relaxation_times.shape[0]:
            raise InputError(
                f"`branch_moduli` has {self.branch_moduli.shape[0]} branches and `relaxation_times` "
                f"{self.relaxation_times.shape[0]}: give one of each a branch, along the first axis."
            )
        _check("relaxed_modulus` plus `branch_moduli", self.relaxed_modulus + self.branch_moduli.sum(0), "Pa")

    def relaxation_modulus(self, time: Scalar) -> Float[Array, "*space"]:
        """Modulus [Pa] a time [s] after a step of strain."""
        return self.relaxed_modulus + jnp.sum(self.branch_moduli * jnp.exp(-time / self.relaxation_times), axis=0)


Solid = Elastic | Zener | FractionalZener | KelvinVoigt | FractionalKelvinVoigt | Prony
"""What a viscoelastic medium may be. Constants may be numbers, or fields of one shape."""


def _check_zener(solid: Zener | FractionalZener) -> None:
    _check("relaxed_modulus", solid.relaxed_modulus, "Pa")
    _check("unrelaxed_modulus", solid.unrelaxed_modulus, "Pa")
    _check("relaxation_time", solid.relaxation_time, "s", largest=np.inf)
    both = [solid.relaxed_modulus, solid.unrelaxed_modulus]
    if not all(_is_numeric(each) for each in both):
        return
    relaxed, unrelaxed = np.broadcast_arrays(*both)
    below = unrelaxed < relaxed
    if np.any(below):
        raise InputError(
            "`unrelaxed_modulus` must not be below `relaxed_modulus`, or the solid would make energy, got "
            f"{unrelaxed[below][0]:g} and {relaxed[below][0]:g} Pa. Have they changed places?"
        )


def _is_numeric(values: object) -> bool:
    # Traced values cannot be looked at, and neither can what a transformation puts in their place.
    return not isinstance(values, Tracer) and np.issubdtype(np.asarray(values).dtype, np.number)


def _check(
    name: str, values: Values | Float[np.ndarray, "..."], unit: str, *, largest: float = LARGEST_MODULUS
) -> None:
    if not _is_numeric(values):
        return
    numbers = np.asarray(values)
    bad = numbers[~((numbers >= 0.0) & (numbers <= largest) & np.isfinite(numbers))]
    if bad.size:
        bounds = "be finite and not negative" if np.isinf(largest) else f"lie in 0 to {largest:g} {unit}".rstrip()
        raise InputError(f"`{name}` must {bounds}, got {bad.flat[0]:g} {unit}".rstrip() + ". Is its unit right?")
