"""What a cause may change between the constants of a solid and the modulus that an instrument reports."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Int

from arfjax import FractionalZener, complex_modulus
from inverse.diagnosis.cause import Cause, Extension, Strength


class DmaConditions(eqx.Module):
    """What each row of a dynamic mechanical analysis was measured under.

    Attributes:
        angular_frequency: [rad/s].
        temperature: [degC].
        time: Since the first row of the sample [s], or in rows where the file gives no time.
        time_in_sweep: Share of the visit's duration that had passed, 0 to 1.
        exposure: Share of the water that saturated vapour took away until then, 0 to 1 over the sample's measurement.
        level: Geometric mean of the measured modulus of the sweep [Pa].
        softest: Lowest measured modulus of all rows [Pa].
        stiffest: Highest measured modulus of all rows [Pa].
        sweep: Index of the row's sweep: the rows of one sample at one temperature, which share their constants.
        visit: Index of the row's visit: a sweep whose temperature was measured again later has two.
        sweep_before: Index of the sweep of the same sample that was visited before; its own for the first visit.
    """

    angular_frequency: Float[Array, " row"]
    temperature: Float[Array, " row"]
    time: Float[Array, " row"]
    time_in_sweep: Float[Array, " row"]
    exposure: Float[Array, " row"]
    level: Float[Array, " row"]
    softest: Float[Array, ""]
    stiffest: Float[Array, ""]
    sweep: Int[Array, " row"]
    visit: Int[Array, " row"]
    sweep_before: Int[Array, " row"]

    @property
    def highest(self) -> Float[Array, ""]:
        """Highest angular frequency [rad/s]."""
        return jnp.max(self.angular_frequency)

    @property
    def lowest(self) -> Float[Array, ""]:
        """Lowest angular frequency [rad/s]."""
        return jnp.min(self.angular_frequency)


class DmaState(eqx.Module):
    """What a cause may look at beside the modulus that it changes.

    Attributes:
        conditions: Of each row.
        before: Modulus of the material at the temperature of the sweep before, at the row's frequency [Pa].
    """

    conditions: DmaConditions
    before: Complex[Array, " row"]


class DmaCause(Cause):
    """A named cause of misfit of a dynamic mechanical analysis.

    A cause overrides `material` (it changes the constants of the solid) or `measured` (it changes the modulus that the
    instrument reports), and is nothing at strength 0. To add one, copy a file of `inverse/diagnosis/dma/causes` and put
    it into the library there.
    """

    def material(self, constants: Float[Array, "sweep 4"], strength: Strength) -> Float[Array, "sweep 4"]:
        """Constants of the solid of each sweep with the cause in it.

        Args:
            constants: Without it, or as other causes left them: relaxed and unrelaxed modulus [Pa], relaxation time
                [s], fractional order.
            strength: Of the cause, in its unit; at 0 nothing changes.
        """
        del strength
        return constants

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Modulus that the instrument reports [Pa].

        Args:
            modulus: Of the material, or as other causes left it [Pa].
            state: What each row was measured under.
            strength: Of the cause, in its unit; at 0 nothing changes.
            shape: Its second parameter; 0 for a cause without one.
        """
        del state, strength, shape
        return modulus


def predicted_modulus(
    constants: Float[Array, "sweep 4"],
    conditions: DmaConditions,
    extensions: tuple[Extension[DmaCause], ...] = (),
    strengths: Float[Array, " extension"] | None = None,
) -> Complex[Array, " row"]:
    """Modulus of every row [Pa] from the constants of every sweep and the strengths of the extensions."""
    strengths = jnp.zeros(len(extensions)) if strengths is None else strengths
    for extension, strength in zip(extensions, strengths, strict=True):
        constants = extension.cause.material(constants, strength)

    def row_modulus(row: Float[Array, " 4"], angular_frequency: Float[Array, ""]) -> Complex[Array, ""]:
        return complex_modulus(FractionalZener(*row), angular_frequency)

    of_rows = jax.vmap(row_modulus)
    modulus = of_rows(constants[conditions.sweep], conditions.angular_frequency)
    before = of_rows(constants[conditions.sweep_before], conditions.angular_frequency)
    state = DmaState(conditions, before)
    for extension, strength in zip(extensions, strengths, strict=True):
        modulus = extension.cause.measured(modulus, state, strength, extension.shape)
    return modulus
