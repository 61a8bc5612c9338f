"""From constants and causes to the logarithm of the displacement that the instrument reports, by the fast model."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from arfjax import FastCurve, Heating, Model, StepwiseProtocol, focal_temperature_at
from arfjax.laws import Scaled, Shifted, TemperatureLaw, ViscoelasticLaw
from arfjax.media import Scalar
from arfjax.model import DoseSize
from arfjax.protocols.fast_curve import features
from arfjax.protocols.stepwise import heating_by, lesion_at
from arfjax.thermal.dose import cumulative_equivalent_minutes
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange, unchanged

_FASTEST_FALL = 1e-6
"""Part of the coldest state's displacement that a report is held above, so that its logarithm exists."""


class Course(eqx.Module):
    """Sonications of one protocol, and the states in which they were looked at.

    Attributes:
        protocol: Of the sonications.
        conditions: Of each state; the last is the end of the sonication, which no row was measured in.
        rows: Rows that the course predicts.
        places: State of each of those rows.
        in_time: Whether states are known by their time alone.
    """

    protocol: StepwiseProtocol
    conditions: HmiConditions
    rows: Int[np.ndarray, " row"]
    places: Int[np.ndarray, " row"]
    in_time: bool = eqx.field(static=True)


def log_reported(
    curve: FastCurve,
    courses: Sequence[Course],
    model: Model,
    extensions: Sequence[Extension[HmiCause]],
    strengths: Float[Array, " extension"],
    *,
    n_rows: int,
) -> Float[Array, " row"]:
    """Logarithm of what the instrument reports for every row, but for a factor of each sonication.

    Args:
        curve: The fast model; closed over under `jit`.
        courses: Of all sonications.
        model: Constants.
        extensions: Causes, each in its shape.
        strengths: Of the causes.
        n_rows: Of all courses together.
    """
    found = jnp.zeros(n_rows)
    for course in courses:
        displacement, _ = _states(curve, course, model, extensions, strengths)
        relative = displacement / displacement[jnp.argmin(course.conditions.temperature)]
        for extension, strength in zip(extensions, strengths, strict=True):
            relative = extension.cause.measured(relative, course.conditions, strength, extension.shape)
        reported = jnp.log(jnp.maximum(relative, _FASTEST_FALL))
        found = found.at[course.rows].set(reported[course.places])
    return found


def largest_excess(
    curve: FastCurve,
    courses: Sequence[Course],
    model: Model,
    extensions: Sequence[Extension[HmiCause]],
    strengths: Float[Array, " extension"],
) -> Float[Array, ""]:
    """How far the farthest state lies from the middle of what the fast model was trained on; covered up to 1."""
    worst = [jnp.max(_states(curve, course, model, extensions, strengths)[1]) for course in courses]
    return jnp.max(jnp.stack(worst))


def _states(curve, course, model, extensions, strengths) -> tuple[Float[Array, " state"], Float[Array, " state"]]:
    """Displacement [m] in every state, and how far it is from the middle of what is covered."""
    for extension, strength in zip(extensions, strengths, strict=True):
        model = extension.cause.model(model, strength, extension.shape)
    conditions = course.conditions
    heating = heating_by(model, curve.heat(model, course.protocol), course.protocol, curve.settings)
    shown = focal_temperature_at(heating, conditions.time) if course.in_time else conditions.temperature
    temperature, change = shown, unchanged(len(shown))
    for extension, strength in zip(extensions, strengths, strict=True):
        temperature = extension.cause.temperature(temperature, conditions, strength, extension.shape)
        change = extension.cause.tissue(change, conditions, model, strength, extension.shape)
    heating = _reaching(heating, temperature[-1], course.protocol)

    def state(temperature: Array, change: TissueChange) -> tuple[Array, Array]:
        here = changed(model, temperature, change)
        share = curve.share(here, temperature, heating)
        share = share + change.rim * share * (1.0 - share)
        size = lesion_at(here, heating, temperature, curve.settings)
        values, present = features(here, temperature, size, course.protocol.push_duration)
        excess = curve.box.excess(jax.lax.stop_gradient(values), present)
        return change.force * curve.push(here, temperature, share, course.protocol), excess

    return jax.vmap(state)(temperature, change)


def changed(model: Model, temperature: Scalar, change: TissueChange) -> Model:
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


def _reaching(heating: Heating, final: Scalar, protocol: StepwiseProtocol) -> Heating:
    """The same sonication, with as much more power as takes the focus to another final temperature [degC]."""
    start = protocol.start_temperature
    factor = (final - start) / (protocol.final_temperature - start)
    temperature = start + factor * (heating.temperature - start)
    return Heating(
        time=heating.time,
        focal_temperature=start + factor * (heating.focal_temperature - start),
        temperature=temperature,
        dose=cumulative_equivalent_minutes(temperature, heating.time),
        acoustic_power=factor * heating.acoustic_power,
    )
