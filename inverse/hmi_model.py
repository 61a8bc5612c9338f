"""What a set of HMI data should show according to a model: the forward side of a calibration."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from arfjax import (
    Discretisation,
    InputError,
    Model,
    StepwiseProtocol,
    focal_temperature_at,
    simulate_heating,
    stepwise_displacement,
)
from inverse.datasets.hmi import HmiData

_FALL = 2.0
"""Fall of the temperature within a sonication that a thermometer's noise may explain [K]."""
_STILL = 0.02
"""Part of the sonication after its end in which a reading is still taken for one at the end."""


class Sweep(eqx.Module):
    """Sonications that reach the same final temperature, and the states in which they were looked at.

    Attributes:
        protocol: Their protocol.
        reference_temperature: At which the displacement is 100 percent [degC].
        states: Distinct temperatures [degC], or distinct times [s] where the data give only times.
        in_time: Whether `states` are times.
        rows: Rows of the data that the sweep predicts.
        places: For each of those rows, its place in `states`.
    """

    protocol: StepwiseProtocol
    reference_temperature: float = eqx.field(static=True)
    states: Float[np.ndarray, " state"]
    in_time: bool = eqx.field(static=True)
    rows: Int[np.ndarray, " row"]
    places: Int[np.ndarray, " row"]


def require_heating(data: HmiData, duration: float) -> None:
    """Refuse readings while it cools: the state that belongs to a temperature is that of the heating.

    Args:
        data: What was measured.
        duration: Of the sonications [s].

    Raises:
        InputError: if the temperature falls within a sonication, or a time lies after its end.
    """
    require_no_fall(data)
    require_during(data, duration)


def require_no_fall(data: HmiData) -> None:
    """Refuse temperatures that fall within a sonication.

    Raises:
        InputError: if there are any.
    """
    if data.temperature is None:
        return
    for label in data.labels:
        rows = data.rows_of(label)
        temperature = np.asarray(data.temperature)[rows]
        fallen = np.flatnonzero(temperature < np.maximum.accumulate(temperature) - _FALL)
        if not fallen.size:
            continue
        first = int(fallen[0])
        order = "" if data.time is not None else ", or sort the rows by temperature if all are of the heating"
        raise InputError(
            f"{data.place(rows[first])}: {temperature[first]:g} degC after {np.max(temperature[:first]):g} in "
            f"sonication {label}; a curve is that of the heating: leave out readings while it cools{order}."
        )


def require_during(data: HmiData, duration: float) -> None:
    """Refuse readings after the sonication's end [s].

    Raises:
        InputError: if there are any.
    """
    if data.time is None:
        return
    late = np.flatnonzero(data.time > (1.0 + _STILL) * duration)
    if late.size:
        raise InputError(
            f"{data.place(int(late[0]))}: {data.time[late[0]]:g} s is after the sonication's end at {duration:g} s; "
            "change `protocol.sonication_s` in the experiment file, or leave out what was read later."
        )


def plan_sweeps(data: HmiData, protocol: StepwiseProtocol, reference_temperature: float) -> tuple[Sweep, ...]:
    """Group the sonications of a data set by the temperature that each reaches at its end.

    That is the highest one measured in it. Where the data give only times it is the protocol's final temperature, and
    the temperature of each row is that of the simulated heating at its time.

    Raises:
        InputError: if a temperature lies below the protocol's start, or a time after its end.
    """
    if reference_temperature < protocol.start_temperature:
        raise InputError(
            f"{data.path}: cannot be normalised at `reference_temperature_c` = {reference_temperature:g} "
            f"degC, below the protocol's start at {protocol.start_temperature:g} degC; change one of the two in the "
            "experiment file."
        )
    if data.temperature is None:
        return (_sweep_in_time(data, protocol, reference_temperature),)
    coldest = float(data.temperature.min())
    if coldest < protocol.start_temperature:
        raise InputError(
            f"{data.path}: {coldest:g} degC is below the protocol's start at {protocol.start_temperature:g} degC; "
            "lower the first of `protocol.temperatures_c`."
        )
    temperature = np.asarray(data.temperature)
    final = {label: float(temperature[data.rows_of(label)].max()) for label in data.labels}
    sweeps = []
    for highest in sorted(set(final.values())):
        if highest < reference_temperature or highest <= protocol.start_temperature:
            raise InputError(
                f"{data.path}: a sonication ends at {highest:g} degC, below the {reference_temperature:g} degC at "
                "which it is normalised; leave it out or lower `reference_temperature_c`."
            )
        rows = np.flatnonzero([final[label] == highest for label in data.sonication])
        states, places = np.unique(temperature[rows], return_inverse=True)
        ending = dataclasses.replace(protocol, final_temperature=highest)
        sweeps.append(Sweep(ending, reference_temperature, states, False, rows, places))
    return tuple(sweeps)


def _sweep_in_time(data: HmiData, protocol: StepwiseProtocol, reference_temperature: float) -> Sweep:
    assert data.time is not None  # the reader asks for time or temperature
    last = int(np.argmax(data.time))
    if data.time[last] > (1.0 + _STILL) * protocol.duration:
        raise InputError(
            f"{data.place(last)}: {data.time[last]:g} s lies after the sonication's end at {protocol.duration:g} s; "
            "set `protocol.sonication_s`, or leave out what was read later."
        )
    if not protocol.start_temperature <= reference_temperature <= protocol.final_temperature:
        raise InputError(
            f"{data.path}: gives times only, so the displacement is normalised to the simulated one at "
            f"`reference_temperature_c`; {reference_temperature:g} degC must lie in the protocol's "
            f"{protocol.start_temperature:g} to {protocol.final_temperature:g} degC."
        )
    # What was read just after the sonication ended is taken for its end.
    states, places = np.unique(np.minimum(data.time, protocol.duration), return_inverse=True)
    return Sweep(protocol, reference_temperature, states, True, np.arange(len(data.time)), places)


def sweeps_of_each(sweeps: tuple[Sweep, ...], data: HmiData) -> tuple[tuple[Sweep, ...], ...]:
    """The same sweeps taken apart, so that each sonication has its own."""
    return tuple(
        tuple(part for sweep in sweeps if (part := _only(sweep, np.asarray(data.rows_of(label)))) is not None)
        for label in data.labels
    )


def _only(sweep: Sweep, rows: Int[np.ndarray, " some"]) -> Sweep | None:
    kept = np.isin(sweep.rows, rows)
    if not np.any(kept):
        return None
    used, places = np.unique(sweep.places[kept], return_inverse=True)
    return dataclasses.replace(sweep, states=sweep.states[used], rows=sweep.rows[kept], places=places)


def predict(
    model: Model, sweeps: tuple[Sweep, ...], settings: Discretisation, *, n_rows: int, in_percent: bool
) -> Float[Array, " n"]:
    """Displacement for every row of the data, in percent of the reference or in metres."""
    prediction = jnp.zeros(n_rows)
    for sweep in sweeps:
        heating = simulate_heating(model, sweep.protocol, settings)
        states = jnp.asarray(sweep.states)
        temperatures = focal_temperature_at(heating, states) if sweep.in_time else states
        with_reference = jnp.concatenate([jnp.asarray([sweep.reference_temperature]), temperatures])
        displacement = stepwise_displacement(model, with_reference, sweep.protocol, settings, heating=heating)
        values = displacement[1:][sweep.places]
        prediction = prediction.at[sweep.rows].set(100.0 * values / displacement[0] if in_percent else values)
    return prediction
