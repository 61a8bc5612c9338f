"""From constants and causes to the logarithm of the displacement that the instrument reports, fast or in full."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from arfjax import Heating, Model, StepwiseProtocol, focal_temperature_at
from arfjax.media import Scalar
from arfjax.thermal.dose import cumulative_equivalent_minutes
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, TissueChange, unchanged
from inverse.diagnosis.hmi.simulation import Simulation

_ANY_RISE = 30.0
"""Of the sonication that those to other temperatures are scaled from [K]."""
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
        immune: Places of the chain that no cause can reach in these sonications, such as a thermocouple's where the
            temperature comes from somewhere else.
        motion: Displacement of the coldest state over that of sonications whose displacement causes are told in: those
            of an instrument do not change with the push.
    """

    protocol: StepwiseProtocol
    conditions: HmiConditions
    rows: Int[Array, " row"] | Int[np.ndarray, " row"]
    places: Int[Array, " row"] | Int[np.ndarray, " row"]
    in_time: bool = eqx.field(static=True)
    immune: tuple[str, ...] = eqx.field(static=True, default=())
    motion: float = 1.0

    @property
    def kind(self) -> tuple:
        """What courses that are simulated by one program have in common; power is scaled to the end of each."""
        final = self.protocol.start_temperature + _ANY_RISE
        return dataclasses.replace(self.protocol, final_temperature=final), self.in_time, self.immune


class Courses(eqx.Module):
    """Several courses as one, each filled up with its end to as many states as the longest has.

    What is compiled for one of them then serves all: it takes a third of the time for three. Only states that a row
    was measured in are pushed.

    Attributes:
        protocol: Of all, but for the temperature of their end.
        conditions: Arrays by course and state.
        course: Of each state that is pushed.
        place: Of that state in its course.
        coldest: Of the states that are pushed, the coldest of the same course.
        pushed: For each row, its state among those that are pushed.
        motion: Of each course.
        in_time: Whether states are known by their time alone.
        immune: Places of the chain that no cause can reach.
    """

    protocol: StepwiseProtocol
    conditions: HmiConditions
    course: Int[Array, " state"]
    place: Int[Array, " state"]
    coldest: Int[Array, " state"]
    pushed: Int[Array, " row"]
    motion: Float[Array, " course"]
    in_time: bool = eqx.field(static=True)
    immune: tuple[str, ...] = eqx.field(static=True)


def together(courses: Sequence[Course]) -> list[tuple[Courses, Int[np.ndarray, " row"]]]:
    """Courses of the same kind as one, and the rows that each of those predicts."""
    kinds: dict[tuple, list[Course]] = {}
    for course in courses:
        kinds.setdefault(course.kind, []).append(course)
    return [(_stacked(members), np.concatenate([np.asarray(c.rows) for c in members])) for members in kinds.values()]


def _stacked(courses: Sequence[Course]) -> Courses:
    count = max(len(course.conditions.temperature) for course in courses)

    def filled(course: Course) -> HmiConditions:
        missing = count - len(course.conditions.temperature)
        return jax.tree.map(
            lambda each: jnp.concatenate([each, jnp.repeat(each[-1:], missing, axis=0)]) if jnp.ndim(each) else each,
            course.conditions,
        )

    conditions = jax.tree.map(lambda *each: jnp.stack(each), *(filled(course) for course in courses))
    of_row = np.repeat(np.arange(len(courses)), [len(course.rows) for course in courses])
    place_of_row = np.concatenate([np.asarray(course.places) for course in courses])
    states, pushed = np.unique(np.stack([of_row, place_of_row], axis=-1), axis=0, return_inverse=True)
    of, place = states.T
    temperature = np.asarray(conditions.temperature)[of, place]
    coldest = [np.flatnonzero(of == one)[np.argmin(temperature[of == one])] for one in of]
    protocol, in_time, immune = courses[0].kind
    return Courses(
        protocol=protocol,
        conditions=conditions,
        course=jnp.asarray(of),
        place=jnp.asarray(place),
        coldest=jnp.asarray(np.array(coldest)),
        pushed=jnp.asarray(pushed.ravel()),
        motion=jnp.asarray([course.motion for course in courses]),
        in_time=in_time,
        immune=immune,
    )


def log_reported(
    simulation: Simulation,
    courses: Courses,
    model: Model,
    extensions: Sequence[Extension[HmiCause]],
    strengths: Float[Array, " extension"],
) -> tuple[Float[Array, " row"], Float[Array, ""], Float[Array, " row"]]:
    """Logarithm of what the instrument reports for every row, but for a factor of each sonication.

    Args:
        simulation: Fast or full; a fast one is closed over under `jit`.
        courses: Of all sonications.
        model: Constants.
        extensions: Causes, each in its shape.
        strengths: Of the causes.

    Returns:
        The logarithm; how far the farthest state lies from the middle of what the simulation covers: covered up to 1;
        and the displacement [m] of the coldest state of each row's course.
    """
    acting = [i for i, extension in enumerate(extensions) if extension.cause.place not in courses.immune]
    extensions, strengths = [extensions[i] for i in acting], strengths[jnp.asarray(acting, dtype=int)]
    for extension, strength in zip(extensions, strengths, strict=True):
        model = extension.cause.model(model, strength, extension.shape)
    heating, start = simulation.heating(model, courses.protocol), courses.protocol.start_temperature

    def heated(conditions: HmiConditions) -> tuple[tuple[Array, TissueChange, Array], Array]:
        nominal = reaching(heating, conditions.temperature[-1], start)
        temperature = focal_temperature_at(nominal, conditions.time) if courses.in_time else conditions.temperature
        change = unchanged(len(temperature))
        for extension, strength in zip(extensions, strengths, strict=True):
            temperature = extension.cause.temperature(temperature, conditions, strength, extension.shape)
            change = extension.cause.tissue(change, conditions, model, strength, extension.shape)
        real = reaching(heating, temperature[-1], start)
        share, excess = simulation.lesion(model, change, temperature, real, courses.protocol)
        return (temperature, change, share), jnp.max(excess)

    states, excess = jax.lax.map(heated, courses.conditions)
    (temperature, change, share), conditions = jax.tree.map(
        lambda each: each[courses.course, courses.place] if each.ndim > 1 else each[courses.course],
        (states, courses.conditions),
    )
    displacement = simulation.displacement(model, change, temperature, share, courses.protocol)
    relative = courses.motion[courses.course] * displacement / displacement[courses.coldest]
    for extension, strength in zip(extensions, strengths, strict=True):
        relative = extension.cause.measured(relative, conditions, strength, extension.shape)
    reported = jnp.log(jnp.maximum(relative, _FASTEST_FALL))[courses.pushed]
    return reported, jnp.max(excess), displacement[courses.coldest][courses.pushed]


def reaching(heating: Heating, final: Scalar, start: float) -> Heating:
    """The same sonication, with as much power as takes the focus from its start to a final temperature [degC]."""
    factor = (final - start) / (heating.focal_temperature[-1] - start)
    temperature = start + factor * (heating.temperature - start)
    return Heating(
        time=heating.time,
        focal_temperature=start + factor * (heating.focal_temperature - start),
        temperature=temperature,
        dose=cumulative_equivalent_minutes(temperature, heating.time),
        acoustic_power=factor * heating.acoustic_power,
    )
