"""What a cause may change between the constants of a solid and the modulus that an instrument reports."""

from typing import ClassVar

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
        exposure: Share of the water that saturated vapour took away until then, over that of the sample that lost most.
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

    Attributes:
        mixes_rows: Whether `measured` makes a row's modulus of other rows' too. Where no cause does, derivatives in the
            constants of all sweeps are taken at once, which makes refits of many sweeps several times as fast.
    """

    mixes_rows: ClassVar[bool] = False

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
    solids = extended_solids(constants, extensions, strengths)
    return measured_modulus(
        solids[conditions.sweep], solids[conditions.sweep_before], conditions, extensions, strengths
    )


def extended_solids(
    constants: Float[Array, "sweep 4"],
    extensions: tuple[Extension[DmaCause], ...],
    strengths: Float[Array, " extension"],
) -> Float[Array, "sweep 4"]:
    """Constants of the solid of each sweep as the extensions leave them."""
    for extension, strength in zip(extensions, strengths, strict=True):
        constants = extension.cause.material(constants, strength)
    return constants


def measured_modulus(
    solids: Float[Array, "row 4"],
    solids_before: Float[Array, "row 4"],
    conditions: DmaConditions,
    extensions: tuple[Extension[DmaCause], ...],
    strengths: Float[Array, " extension"],
) -> Complex[Array, " row"]:
    """Modulus of every row [Pa], as the instrument reports it.

    Args:
        solids: Constants of the solid that each row is of.
        solids_before: The same of the sweep that was visited before.
        conditions: Of every row.
        extensions: What changes the modulus on its way.
        strengths: Of each of them.
    """

    def row_modulus(row: Float[Array, " 4"], angular_frequency: Float[Array, ""]) -> Complex[Array, ""]:
        return complex_modulus(FractionalZener(*row), angular_frequency)

    of_rows = jax.vmap(row_modulus)
    modulus = of_rows(solids, conditions.angular_frequency)
    state = DmaState(conditions, before=of_rows(solids_before, conditions.angular_frequency))
    for extension, strength in zip(extensions, strengths, strict=True):
        modulus = extension.cause.measured(modulus, state, strength, extension.shape)
    return modulus


def makes_rows_of_others(cause: DmaCause) -> bool:
    """Whether `measured` makes some row's modulus of another row's, asked at three rows: two of one sweep, one more."""
    rows = jnp.arange(1.0, 4.0)
    conditions = DmaConditions(
        angular_frequency=10.0 * rows,
        temperature=jnp.array([30.0, 30.0, 40.0]),
        time=60.0 * rows,
        time_in_sweep=jnp.array([0.0, 1.0, 0.0]),
        exposure=0.25 * rows,
        level=jnp.full(3, 2e4),
        softest=jnp.array(1e4),
        stiffest=jnp.array(3e4),
        sweep=jnp.array([0, 0, 1]),
        visit=jnp.array([0, 0, 1]),
        sweep_before=jnp.array([0, 0, 0]),
    )

    def reported(parts: Float[Array, "4 row"]) -> Float[Array, "2 row"]:
        state = DmaState(conditions, before=parts[2] + 1j * parts[3])
        modulus = cause.measured(parts[0] + 1j * parts[1], state, cause.plausible, cause.shapes[-1])
        return jnp.stack([modulus.real, modulus.imag])

    slope = jax.jacfwd(reported)(1e4 * jnp.outer(jnp.array([1.0, 0.3, 1.1, 0.4]), jnp.sqrt(rows)))
    of_others = jnp.sum(jnp.abs(slope), axis=(0, 2)) * (1.0 - jnp.eye(3))
    return bool(jnp.any(of_others > 0.0))
