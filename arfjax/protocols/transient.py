"""A sonication that is watched while it heats: field, heat, dose, modulus and displacement coupled in time.

Where the stepwise protocol takes liver as uniformly warm, here every cell has its own temperature and dose. They set
attenuation and sound speed along the beam, the moduli at every point, and the shape of what has coagulated. The
displacement that a probe measures is computed again whenever tissue has moved by a tolerance, as the field is.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from arfjax.errors import InputError
from arfjax.instruments.speckle_tracking import SpeckleTracker
from arfjax.instruments.thermocouple import Thermocouple
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.material.lesion import at_gauss_points
from arfjax.media import Scalar, Solid
from arfjax.model import DamageEdge, Model
from arfjax.protocols.discretisation import Discretisation
from arfjax.protocols.heated_tissue import force_on, heated_solid, lesion_of, share_of
from arfjax.protocols.probing import Probe, SteadyShaking, on_axis_at
from arfjax.protocols.sonication import (
    AdaptiveSteps,
    FixedSteps,
    Sonication,
    SonicationResult,
    sonicate,
    sonication_field,
)
from arfjax.thermal.bioheat import TemperatureHistory
from arfjax.thermal.feedback import Exposure, movement

_ROUNDING = 1e-6
"""Rounding of a temperature [K]."""


class TransientProtocol(eqx.Module):
    """What is done to the tissue, and how it is watched.

    Attributes:
        sonication: Heating and cooling at the model's power at its strongest; the probe's modulation lowers the heat.
        probe: How displacement is made.
        tolerance: How far any cell's temperature may move before displacement is computed again [K]; doublings of dose
            count as kelvins, as for the field. In between it is linear in time.
        thermocouple: At the geometric focus.
        tracker: What measures displacement there; a perfect point if not given.
    """

    sonication: Sonication
    probe: Probe = SteadyShaking()
    tolerance: float = eqx.field(static=True, default=2.0)
    thermocouple: Thermocouple = Thermocouple()
    tracker: SpeckleTracker = SpeckleTracker()

    def __check_init__(self) -> None:
        """Refuse a tolerance that is none."""
        if not self.tolerance > 0.0:
            raise InputError(f"`tolerance` must be positive [K], got {self.tolerance}.")


class TissueState(eqx.Module):
    """What heat has done by one or by every output time, in the cells of the heat grid.

    Attributes:
        temperature: [degC].
        hottest: Highest so far [degC]: what coagulated tissue remembers.
        focal: Highest so far at the geometric focus [degC].
        dose: CEM43 [equivalent min at 43 degC].
    """

    temperature: Float[Array, "*time r z"]
    hottest: Float[Array, "*time r z"]
    focal: Float[Array, "*time"]
    dose: Float[Array, "*time r z"]

    def at(self, index: int) -> "TissueState":
        """That of one output time."""
        return jax.tree.map(lambda values: values[index], self)


class TransientResult(eqx.Module):
    """A watched sonication, at its output times.

    Attributes:
        time: [s].
        displacement: At the geometric focus, as the probe makes it at the model's power [m].
        tracked: The same as the tracker measures it, without its noise [m]. Of steady shaking it averages the peak to
            peak of every point: as if all moved in phase.
        displacement_map: At the nodes of the probe's mesh [m].
        computed: Where displacement was computed; elsewhere it is interpolated.
        thermocouple_temperature: What the thermocouple shows [degC].
        sonication: Temperature, dose, lesion and heat.
    """

    time: Float[Array, " time"]
    displacement: Float[Array, " time"]
    tracked: Float[Array, " time"]
    displacement_map: Float[Array, "time r z"]
    computed: Bool[Array, " time"]
    thermocouple_temperature: Float[Array, " time"]
    sonication: SonicationResult

    def normalised(self, reference: Scalar) -> Float[Array, " time"]:
        """Tracked displacement over that when the thermocouple first shows `reference` [degC].

        NaN if it never does, or shows more from the beginning.
        """
        return self.tracked / value_when(self.thermocouple_temperature, self.tracked, reference)


def run_transient(
    model: Model,
    protocol: TransientProtocol,
    settings: Discretisation,
    *,
    steps: FixedSteps | AdaptiveSteps = FixedSteps(),  # noqa: B008  frozen and without state
) -> TransientResult:
    """A watched sonication.

    Displacement is that of a beam with the model's power at its strongest at every output time, also where a phase has
    another power or none: what a probe would find there and then.

    Args:
        model: The model; derivatives flow to every leaf of it. Its walls play no part under steady shaking.
        protocol: What is done, and how it is watched.
        settings: Grids, mesh and steps; close over them under `jit`, because their positions must be concrete.
        steps: Of the heating.

    Accuracy: heat as `sonicate`; force and moduli at the output times themselves, not those of the last update of the
        heat. Displacement as `push` of the stepwise protocol or `vibrate` have it, between the times at which it is
        computed up to the square of `tolerance`: below 0.5 percent with 2 K (a test holds it on a coarse case).
    Differentiability: forward and reverse; the times at which something is computed again count as given.
    """
    share = jnp.asarray(protocol.probe.mean_force())
    phases = tuple(dataclasses.replace(each, power=share * each.power) for each in protocol.sonication.phases)
    sonication = dataclasses.replace(protocol.sonication, phases=phases)
    heated = sonicate(model, sonication, settings, steps=steps)
    maps, computed = _probed(model, protocol, sonication, settings, tissue_states(heated), heated.time)
    capacity = settings.thermal_field(model, sonication.start_temperature).heat_capacity
    mesh = protocol.probe.mesh(settings)
    return TransientResult(
        time=heated.time,
        displacement=on_axis_at(maps, mesh, settings.focus),
        tracked=protocol.tracker(maps, mesh.node_r, mesh.node_z, z=settings.focus),
        displacement_map=maps,
        computed=computed,
        thermocouple_temperature=protocol.thermocouple(
            TemperatureHistory(heated.time, heated.temperature),
            settings.heat_grid,
            z=settings.focus,
            heat=heated.heat,
            heat_capacity=capacity,
        ),
        sonication=heated,
    )


def tissue_states(result: SonicationResult) -> TissueState:
    """What heat has done by every output time."""
    hottest, focal = (jax.lax.cummax(values, axis=0) for values in (result.temperature, result.focal_temperature))
    return TissueState(result.temperature, hottest, focal, result.dose)


def probe_at(
    model: Model, probe: Probe, sonication: Sonication, settings: Discretisation, state: TissueState
) -> Float[Array, "r z"]:
    """Displacement [m] at the nodes of the probe's mesh, in tissue of one state."""
    mesh = probe.mesh(settings)
    temperature = at_gauss_points(mesh, settings.heat_grid, state.temperature)
    force = force_on(
        mesh,
        settings,
        lambda r, z: sonication_field(model, sonication, settings, state.temperature, state.dose, r=r, z=z),
    )
    solid = solid_of(model, settings, state, mesh)
    return probe.displacement(model, solid, temperature, force, settings)


def solid_of(model: Model, settings: Discretisation, state: TissueState, mesh: Mesh) -> Solid:
    """Constants at a mesh's Gauss points of tissue of one state.

    Liver has those of its temperature. In an ellipsoid, whose constants hold at its centre, the lesion has those of
    the highest temperature of the focus; in a lesion with the shape of the dose, of the highest that each point saw.
    """
    size = lesion_of(model, state.focal, state.dose, settings)
    share = share_of(model, size, state.dose, settings, mesh)
    by_point = isinstance(model.lesion.edge, DamageEdge)
    hot = at_gauss_points(mesh, settings.heat_grid, state.hottest) if by_point else state.focal
    return heated_solid(model, at_gauss_points(mesh, settings.heat_grid, state.temperature), share, hot)


def value_when(course: Float[Array, " time"], values: Float[Array, " time"], level: Scalar) -> Float[Array, ""]:
    """Value when a course first reaches a level, linear between times; NaN if it never does, or begins above it."""
    after, weight = first_reached(course, level)
    return values[after - 1] + weight * (values[after] - values[after - 1])


def first_reached(course: Float[Array, " time"], level: Scalar) -> tuple[Int[Array, ""], Float[Array, ""]]:
    """Number of the time at or before which a course first reaches a level, and the share of the step to it.

    The share is NaN where the course never reaches the level, or begins above it, but for rounding: the focal
    temperature of uniform tissue, an interpolation, is that of the start to 1e-14 K.
    """
    reached, highest = course >= level, jnp.argmax(course)  # which is not the last where it cools again
    after = jnp.maximum(jnp.where(jnp.any(reached), jnp.argmax(reached), highest), 1)
    low, high = course[after - 1], course[after]
    share = (level - low) / jnp.where(high > low, high - low, 1.0)
    # No `clip`, which halves the derivative at its ends.
    share = jnp.where(share < 0.0, 0.0, jnp.where(share > 1.0, 1.0, share))
    inside = (level >= course[0] - _ROUNDING) & (level <= course[highest] + _ROUNDING)
    return after, jnp.where(inside, share, jnp.nan)


def _probed(
    model: Model,
    protocol: TransientProtocol,
    sonication: Sonication,
    settings: Discretisation,
    states: TissueState,
    time: Float[Array, " time"],
) -> tuple[Float[Array, "time r z"], Bool[Array, " time"]]:
    # Each motion is computed again on the way back: the factors of all would not fit into memory.
    @jax.checkpoint
    def displacement(state: TissueState) -> Float[Array, "r z"]:
        return probe_at(model, protocol.probe, sonication, settings, state)

    first = states.at(0)
    index = jnp.arange(len(time))

    def step(carry: tuple, given: tuple) -> tuple[tuple, tuple]:
        asked, known = carry
        state, is_end = given
        now = Exposure(state.temperature, state.dose)
        moved = is_end | (movement(now, asked) > protocol.tolerance)
        asked, known = jax.lax.cond(moved, lambda: (now, displacement(state)), lambda: (asked, known))
        return (asked, known), (known, moved)

    # The start's motion is computed within the scan, too: outside, the way back computes it again before the others',
    # whose factors then drop its own before they are used.
    nothing = jnp.zeros_like(jax.eval_shape(displacement, first))
    at_ends = (index == 0) | (index == len(time) - 1)
    _, (maps, computed) = jax.lax.scan(step, (Exposure(first.temperature, first.dose), nothing), (states, at_ends))
    return _interpolated(maps, computed, time), computed


def _interpolated(
    held: Float[Array, "time r z"], computed: Bool[Array, " time"], time: Float[Array, " time"]
) -> Float[Array, "time r z"]:
    """Values linear in time between those that were computed."""
    index, last = jnp.arange(len(time)), len(time) - 1
    before = jax.lax.cummax(jnp.where(computed, index, 0))
    after = jax.lax.cummin(jnp.where(computed, index, last), reverse=True)
    weight = (time - time[before]) / jnp.where(after > before, time[after] - time[before], 1.0)
    return held[before] + weight[:, None, None] * (held[after] - held[before])
