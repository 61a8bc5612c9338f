"""What moves tissue that causes have changed: the fast simulation, and the full one that it is corrected to."""

import dataclasses
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax import Discretisation, FastCurve, Heating, Model, StepwiseProtocol, simulate_heating
from arfjax.laws import Scaled, Shifted, TemperatureLaw, ViscoelasticLaw
from arfjax.media import Scalar
from arfjax.model import DoseSize
from arfjax.numerics.batches import map_in_batches
from arfjax.numerics.derivatives import forward_by_reverse
from arfjax.protocols.fast_curve import features
from arfjax.protocols.stepwise import force_at, heating_by, lesion_at, lesion_share, push
from inverse.diagnosis.hmi.cause import TissueChange

_Share = Float[Array, "..."]


_AT_ONCE = 20
"""Pushes at a time. The fast simulation is a quarter faster than with 60, which fill the cache; the full one is a
third faster than one by one, and all at once would fill the memory."""


@runtime_checkable
class Simulation(Protocol):
    """Heat and pushes of tissue that is another one in every state."""

    def heating(self, model: Model, protocol: StepwiseProtocol) -> Heating:
        """The sonication."""
        ...

    def lesion(
        self,
        model: Model,
        change: TissueChange,
        temperature: Float[Array, " state"],
        heating: Heating,
        protocol: StepwiseProtocol,
    ) -> tuple[Float[Array, "state ..."], Float[Array, " state"]]:
        """Share of the lesion in every state of one sonication, wherever `displacement` wants it.

        And how far each state is from the middle of what is covered, up to 1.

        Args:
            model: Before the change.
            change: Of the tissue, by state.
            temperature: Of liver and focus [degC].
            heating: What they have gone through.
            protocol: For the push.
        """
        ...

    def displacement(
        self,
        model: Model,
        change: TissueChange,
        temperature: Float[Array, " state"],
        share: Float[Array, "state ..."],
        protocol: StepwiseProtocol,
    ) -> Float[Array, " state"]:
        """Displacement [m] in every state of any sonications.

        Args:
            model: Before the change.
            change: Of the tissue, by state.
            temperature: Of liver and focus [degC].
            share: What `lesion` gives.
            protocol: For the push.
        """
        ...


@dataclasses.dataclass(frozen=True)
class FastSimulation:
    """By tables of sound and shapes of motion; see `FastCurve`."""

    curve: FastCurve

    def heating(self, model: Model, protocol: StepwiseProtocol) -> Heating:
        """The sonication."""
        return heating_by(model, self.curve.heat(model, protocol), protocol, self.curve.settings)

    def lesion(
        self,
        model: Model,
        change: TissueChange,
        temperature: Float[Array, " state"],
        heating: Heating,
        protocol: StepwiseProtocol,
    ) -> tuple[Float[Array, "state point"], Float[Array, " state"]]:
        """At the points of the reduced solid."""
        curve = self.curve

        def state(temperature: Array, change: TissueChange) -> tuple[Array, Array]:
            here = changed(model, change)
            share = _with_rim(curve.share(here, temperature, heating), change)
            size = lesion_at(here, heating, temperature, curve.settings)
            values, present = features(here, temperature, size, protocol.push_duration)
            return share, curve.box.excess(jax.lax.stop_gradient(values), present)

        return jax.vmap(state)(temperature, change)

    def displacement(
        self,
        model: Model,
        change: TissueChange,
        temperature: Float[Array, " state"],
        share: Float[Array, "state point"],
        protocol: StepwiseProtocol,
    ) -> Float[Array, " state"]:
        """Many states at once."""

        def state(argument: tuple[Array, TissueChange, Array]) -> Array:
            temperature, change, share = argument
            return change.force * self.curve.push(changed(model, change), temperature, share, protocol)

        return map_in_batches(state, (temperature, change, share), _AT_ONCE)


@dataclasses.dataclass(frozen=True)
class FullSimulation:
    """By sound, heat and motion on their grids."""

    settings: Discretisation

    def heating(self, model: Model, protocol: StepwiseProtocol) -> Heating:
        """The sonication."""
        return simulate_heating(model, protocol, self.settings)

    def lesion(
        self,
        model: Model,
        change: TissueChange,
        temperature: Float[Array, " state"],
        heating: Heating,
        protocol: StepwiseProtocol,
    ) -> tuple[Float[Array, "state rq zq"], Float[Array, " state"]]:
        """At the Gauss points."""
        del protocol
        settings = self.settings

        def state(temperature: Array, change: TissueChange) -> Array:
            here = changed(model, change)
            size = lesion_at(here, heating, temperature, settings)
            return _with_rim(lesion_share(here, heating, temperature, size, settings, settings.mesh), change)

        return jax.vmap(state)(temperature, change), jnp.zeros(len(temperature))

    def displacement(
        self,
        model: Model,
        change: TissueChange,
        temperature: Float[Array, " state"],
        share: Float[Array, "state rq zq"],
        protocol: StepwiseProtocol,
    ) -> Float[Array, " state"]:
        """Some states at once."""
        settings = self.settings

        def force(temperature: Array, change: TissueChange) -> Array:
            return force_at(changed(model, change), temperature, protocol, settings)

        def moved(argument: tuple[Model, Array, Array, Array]) -> Array:
            return push(*argument, protocol, settings).at_focus(settings.focus)[-1]

        def state(argument: tuple[Array, TissueChange, Array, Array]) -> Array:
            temperature, change, share, force = argument
            here = jax.tree.map(jnp.asarray, changed(model, change))
            return change.force * forward_by_reverse(moved)((here, temperature, share, force))

        # As one batch, because the field up to the liver is then computed once.
        forces = jax.vmap(force)(temperature, change)
        return map_in_batches(state, (temperature, change, share, forces), _AT_ONCE)


def changed(model: Model, change: TissueChange) -> Model:
    """The model in one state."""
    liver, lesion = model.liver, model.lesion
    model = eqx.tree_at(
        lambda tree: (tree.liver.attenuation, tree.liver.sound_speed),
        model,
        (_scaled(liver.attenuation, change.attenuation), Shifted(
            law=liver.sound_speed, shift=change.sound_speed, unit=liver.sound_speed.unit,
            source=liver.sound_speed.source, valid_range=liver.sound_speed.valid_range,
        )),
    )  # fmt: skip
    assert liver.viscoelasticity is not None  # `Model` checks it
    model = eqx.tree_at(
        lambda tree: (tree.liver.viscoelasticity, tree.lesion.viscoelasticity),
        model,
        (
            _stiffened(liver.viscoelasticity, change.liver_modulus),
            _stiffened(lesion.viscoelasticity, change.lesion_modulus),
        ),
    )
    if isinstance(lesion.size, DoseSize):
        threshold = lesion.size.threshold * change.threshold
        model = eqx.tree_at(lambda tree: tree.lesion.size.threshold, model, threshold)
    return model


def _scaled(law: TemperatureLaw, factor: Scalar) -> TemperatureLaw:
    return Scaled(law=law, factor=factor, unit=law.unit, source=law.source, valid_range=law.valid_range)


def _stiffened(law: ViscoelasticLaw, factor: Scalar) -> ViscoelasticLaw:
    return eqx.tree_at(
        lambda each: (each.relaxed_modulus, each.branch_modulus),
        law,
        (_scaled(law.relaxed_modulus, factor), _scaled(law.branch_modulus, factor)),
    )


def _with_rim(share: _Share, change: TissueChange) -> _Share:
    return share + change.rim * share * (1.0 - share)
