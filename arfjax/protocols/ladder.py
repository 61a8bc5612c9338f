"""What the transient protocol changes against the stepwise one, one cause after the other.

Both heat the focus over the same temperatures. The stepwise protocol's assumptions are then dropped one by one, in an
order in which each rung keeps what the one before has changed:

1. `stepwise`: liver uniformly at the temperature of the focus, path cold, lesion by the dose of heat that scales;
2. `heating`: the lesion by the dose of a sonication whose field and tissue feed back;
3. `local absorption`: each point absorbs at its own temperature, in the pressure of cold tissue;
4. `path`: and the beam runs through tissue of these temperatures, which attenuate and refract it;
5. `lesion shape`: what has coagulated has the shape of the dose, not of an ellipsoid, and each point its own moduli;
6. `shaking`: motion is that of steady shaking, not of a short push;
7. `fractional solid`: with other laws of the solids, if they are given.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.acoustics.field import HarmonicField
from arfjax.errors import InputError
from arfjax.laws import ViscoelasticLaw
from arfjax.media import Scalar, Solid
from arfjax.model import DamageEdge, DoseSize, Model
from arfjax.protocols.discretisation import Discretisation
from arfjax.protocols.heated_tissue import force_on, heated_solid, lesion_of, share_of
from arfjax.protocols.probing import Probe, ShortPush, SteadyShaking, on_axis_at
from arfjax.protocols.sonication import Sonication, SonicationResult, sonication_field
from arfjax.protocols.stepwise import StepwiseProtocol, layered_field, run_stepwise
from arfjax.protocols.transient import TissueState, first_reached, solid_of, tissue_states

_Force = Callable[[TissueState], Float[Array, "rq zq"]]
_Solid = Callable[[TissueState], Solid]


class Rung(eqx.Module):
    """One more assumption dropped.

    Attributes:
        name: What the protocol now has.
        displacement: At the geometric focus [m], at every temperature: at the end of a push, or peak to peak.
    """

    name: str = eqx.field(static=True)
    displacement: Float[Array, " step"]

    def percent(self) -> Float[Array, " step"]:
        """Displacement as percent of that at the first temperature."""
        return 100.0 * self.displacement / self.displacement[0]


def protocol_ladder(
    model: Model,
    heated: SonicationResult,
    sonication: Sonication,
    protocol: StepwiseProtocol,
    settings: Discretisation,
    temperatures: Float[Array, " step"],
    *,
    shaking: SteadyShaking,
    fractional: tuple[ViscoelasticLaw, ViscoelasticLaw] | None = None,
) -> tuple[Rung, ...]:
    """Displacement over the temperature of the focus on every rung.

    Args:
        model: Its lesion's size must come from the dose.
        heated: A sonication of that model by `sonicate`, which reaches the last temperature.
        sonication: Its plan, from the protocol's start temperature.
        protocol: The stepwise protocol.
        settings: Grids, mesh and steps.
        temperatures: Of the focus [degC], rising, from the start temperature.
        shaking: How tissue is shaken.
        fractional: Laws of liver and lesion for the last rung; the rung is left out if not given.

    Raises:
        InputError: if the lesion's size comes from a table.
    """
    if not isinstance(model.lesion.size, DoseSize):
        raise InputError("the ladder follows the dose, so that `model.lesion.size` must be a `DoseSize`.")
    states = states_when(heated, temperatures)
    by_dose = dataclasses.replace(model, lesion=dataclasses.replace(model.lesion, edge=DamageEdge()))
    push = ShortPush(protocol.push_duration, protocol.modulation)
    start = protocol.start_temperature

    def uniform_force(state: TissueState) -> Float[Array, "rq zq"]:
        return force_on(
            settings.mesh, settings, lambda r, z: layered_field(model, state.focal, protocol, settings, r=r, z=z)
        )

    def uniform_solid(state: TissueState) -> Solid:
        size = lesion_of(model, state.focal, state.dose, settings)
        return heated_solid(model, state.focal, share_of(model, size, state.dose, settings, settings.mesh))

    def run(force: _Force, solid: _Solid, probe: Probe, model: Model = model) -> Float[Array, " step"]:
        mesh = probe.mesh(settings)

        @jax.checkpoint
        def displacement(state: TissueState) -> Array:
            moved = probe.displacement(model, solid(state), start, force(state), settings)
            return on_axis_at(moved, mesh, settings.focus)

        return jax.lax.map(displacement, states)

    def local_force(state: TissueState) -> Float[Array, "rq zq"]:
        return _force(model, sonication, settings, state, push, cold_pressure=True)

    def coupled_force(probe: Probe) -> _Force:
        return lambda state: _force(model, sonication, settings, state, probe)

    def by_point(probe: Probe, model: Model = by_dose) -> _Solid:
        return lambda state: solid_of(model, settings, state, probe.mesh(settings))

    rungs = {
        "stepwise": run_stepwise(model, temperatures, protocol, settings).displacement,
        "heating": run(uniform_force, uniform_solid, push),
        "local absorption": run(local_force, uniform_solid, push),
        "path": run(coupled_force(push), uniform_solid, push),
        "lesion shape": run(coupled_force(push), by_point(push), push),
        "shaking": run(coupled_force(shaking), by_point(shaking), shaking),
    }
    if fractional is not None:
        other = eqx.tree_at(lambda m: (m.liver.viscoelasticity, m.lesion.viscoelasticity), by_dose, fractional)
        rungs["fractional solid"] = run(coupled_force(shaking), by_point(shaking, other), shaking, other)
    return tuple(Rung(name, values) for name, values in rungs.items())


def states_when(heated: SonicationResult, temperatures: Float[Array, " step"]) -> TissueState:
    """What heat has done when the focus first reaches each temperature [degC], linear between output times.

    NaN for temperatures that are not reached, or below that of the start, but for rounding.
    """
    states = tissue_states(heated)

    def state_at(temperature: Scalar) -> TissueState:
        after, weight = first_reached(states.focal, temperature)
        return jax.tree.map(lambda values: values[after - 1] + weight * (values[after] - values[after - 1]), states)

    return jax.vmap(state_at)(temperatures)


def _force(
    model: Model,
    sonication: Sonication,
    settings: Discretisation,
    state: TissueState,
    probe: Probe,
    *,
    cold_pressure: bool = False,
) -> Float[Array, "rq zq"]:
    def field_at(r: Float[np.ndarray, " r"], z: Float[np.ndarray, " z"]) -> HarmonicField:
        field = sonication_field(model, sonication, settings, state.temperature, state.dose, r=r, z=z)
        if not cold_pressure:
            return field
        cold = jnp.full_like(state.temperature, sonication.start_temperature)
        before = sonication_field(model, sonication, settings, cold, jnp.zeros_like(cold), r=r, z=z)
        return eqx.tree_at(lambda each: each.pressure, field, before.pressure)

    return force_on(probe.mesh(settings), settings, field_at)
