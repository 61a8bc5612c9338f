"""Data of harmonic motion imaging as rows of a diagnosis, and what the tissue had gone through in each."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import CubicSpline

from arfjax import Discretisation, Heating, InputError, Model, StepwiseProtocol
from arfjax.laws import LETHAL_DOSE_MINUTES, coagulated_fraction
from arfjax.protocols.stepwise import simulate_heating
from arfjax.tissues import COAGULATION_WIDTH
from inverse.datasets.hmi import HmiData
from inverse.diagnosis.hmi.cause import OFF_AXIS_REACH, HmiConditions
from inverse.diagnosis.hmi.chain import Course, reaching
from inverse.hmi_model import plan_sweeps, require_no_fall
from inverse.inference.hmi import SAME_TEMPERATURE_K

_LEAST_RISE = 1e-6
"""Taken instead of less, so that it has a logarithm [K]."""
_FALL_TERMS = 3
"""Terms of the fall of temperature beside the axis: within 3e-3 of the rise from the first second on."""

_AGES = np.expm1(np.linspace(0.0, 8.0, 49)) / np.expm1(8.0)
"""Of the time since the start, at which the past of a state is kept: from a ten-thousandth of it on."""
_OFTEN = 3001
"""Times among which that of a temperature is looked for: steps of heat are too long for the first seconds."""


@dataclasses.dataclass(frozen=True)
class HmiRows:
    """What is compared with the simulation, a row a reading: those of the file, then those that curves were divided by.

    Attributes:
        log_displacement: Logarithm of the displacement, in any unit of its sonication.
        sonication: Index of the sonication.
        labels: Of the sonications.
        temperature: That the thermometer showed [degC]; NaN where only times are known.
        time: Since the start [s], as measured or simulated.
        is_reference: Whether the row is a reading that its curve was divided by.
        deviation: Relative standard deviation, where the file gives it.
        file_row: Row of the file, or -1.
        lateness: Time measured less that at which the simulated heating gets to the temperature [s], once that is
            known; NaN where either is not measured.
        dose: Thermal dose at the focus by then, of the simulated heating before any fit [min], once that is known.
    """

    log_displacement: Float[np.ndarray, " row"]
    sonication: Int[np.ndarray, " row"]
    labels: tuple[str, ...]
    temperature: Float[np.ndarray, " row"]
    time: Float[np.ndarray, " row"]
    is_reference: Bool[np.ndarray, " row"]
    deviation: Float[np.ndarray, " row"] | None
    file_row: Int[np.ndarray, " row"]
    lateness: Float[np.ndarray, " row"] | None = None
    dose: Float[np.ndarray, " row"] | None = None

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.sonication)


def hmi_rows(data: HmiData, reference_temperature: float) -> HmiRows:
    """Readings of a file, and for a curve in percent the reading that it was divided by, where it is not in the file.

    Dividing by a reading says nothing of the model but carries that reading's error into all others. With the reading
    among the rows and a factor of each sonication free, that is what it is: one more reading. A curve that is 100
    percent at its coldest reading was divided by that one, whatever its temperature.

    Args:
        data: What was measured.
        reference_temperature: At which curves in percent are 100 [degC].

    Raises:
        InputError: if a displacement is not positive, or readings were taken while it cooled.
    """
    require_no_fall(data)
    measured = np.asarray(data.displacement, dtype=float)
    if not np.all(measured > 0.0):
        row = int(np.flatnonzero(~(measured > 0.0))[0])
        raise InputError(
            f"{data.place(row)}: the displacement is {measured[row]:g}; a diagnosis compares logarithms and "
            "needs positive amplitudes. Leave the row out."
        )
    index = {label: number for number, label in enumerate(data.labels)}
    sonication = np.array([index[label] for label in data.sonication])
    temperature = np.full(len(measured), np.nan) if data.temperature is None else np.asarray(data.temperature, float)
    time = np.full(len(measured), np.nan) if data.time is None else np.asarray(data.time, float)
    deviation = None if data.sd is None else np.asarray(data.sd) / measured
    reference = np.abs(temperature - reference_temperature) < SAME_TEMPERATURE_K
    reference &= measured == 100.0 if data.in_percent else False
    rows = HmiRows(
        np.log(measured), sonication, data.labels, temperature, time, reference, deviation, np.arange(len(measured))
    )
    if not data.in_percent or data.temperature is None:
        return rows
    for number in range(len(data.labels)):
        mine = np.flatnonzero(sonication == number)
        coldest = mine[np.argmin(temperature[mine])]
        reference[coldest] |= not np.any(reference[mine]) and measured[coldest] == 100.0
    missing = [number for number in range(len(data.labels)) if not np.any(reference[sonication == number])]
    return _with_references(rows, missing, reference_temperature)


def _with_references(rows: HmiRows, missing: list[int], temperature: float) -> HmiRows:
    count = len(missing)
    usual = None if rows.deviation is None else np.full(count, np.median(rows.deviation))
    return HmiRows(
        log_displacement=np.append(rows.log_displacement, np.full(count, np.log(100.0))),
        sonication=np.append(rows.sonication, np.array(missing, dtype=int)),
        labels=rows.labels,
        temperature=np.append(rows.temperature, np.full(count, temperature)),
        time=np.append(rows.time, np.full(count, np.nan)),
        is_reference=np.append(rows.is_reference, np.ones(count, dtype=bool)),
        deviation=None if rows.deviation is None or usual is None else np.append(rows.deviation, usual),
        file_row=np.append(rows.file_row, np.full(count, -1)),
    )


def plan_courses(
    data: HmiData,
    rows: HmiRows,
    model: Model,
    protocol: StepwiseProtocol,
    settings: Discretisation,
    reference_temperature: float,
) -> tuple[tuple[Course, ...], HmiRows]:
    """Courses of the sonications, and the rows with the times at which the simulation gets to them.

    Args:
        data: What was measured.
        rows: What `hmi_rows` makes of it.
        model: Before any fit.
        protocol: Of the sonications.
        settings: Grids of heat.
        reference_temperature: At which curves in percent are 100 [degC].

    Raises:
        InputError: if temperatures lie below the protocol's start; see `inverse.hmi_model.require_during` for its end.
    """
    courses, time, lateness, dose = [], rows.time.copy(), np.full(len(rows), np.nan), np.zeros(len(rows))
    temperature = rows.temperature.copy()
    sweeps = plan_sweeps(data, protocol, reference_temperature)
    # Sonications differ in their end alone, and with it in power.
    first = simulate_heating(model, sweeps[0].protocol, settings)
    for sweep in sweeps:
        members = np.unique([rows.labels.index(data.sonication[row]) for row in sweep.rows])
        mine = np.flatnonzero(np.isin(rows.sonication, members))
        heating = reaching(first, sweep.protocol.final_temperature, protocol.start_temperature)
        clock, focal = np.asarray(heating.time), np.asarray(heating.focal_temperature)
        if sweep.in_time:
            temperature[mine] = np.interp(time[mine], clock, focal)
        often = np.linspace(0.0, clock[-1], _OFTEN)
        simulated = np.interp(temperature[mine], CubicSpline(clock, focal)(often), often)
        lateness[mine] = np.nan if sweep.in_time else time[mine] - simulated
        time[mine] = np.where(np.isnan(time[mine]), simulated, time[mine])
        dose[mine] = np.exp(np.interp(time[mine], clock, _log(_focal_dose(heating, settings))))
        keys = np.stack([temperature[mine], time[mine], rows.is_reference[mine]], axis=-1)
        states, places = np.unique(keys, axis=0, return_inverse=True)
        end = [sweep.protocol.final_temperature, sweep.protocol.duration, 0.0]
        conditions = _conditions(np.vstack([states, end]), heating, sweep.protocol, settings)
        courses.append(Course(sweep.protocol, conditions, mine, places.ravel(), sweep.in_time))
    found = dataclasses.replace(rows, time=time, temperature=temperature, lateness=lateness, dose=dose)
    return tuple(courses), found


def _conditions(
    states: Float[np.ndarray, "state 3"], heating: Heating, protocol: StepwiseProtocol, settings: Discretisation
) -> HmiConditions:
    temperature, time, reference = states.T
    clock, focal = np.asarray(heating.time), np.asarray(heating.focal_temperature)
    at_focus = _focal_dose(heating, settings)
    lethal = float(np.interp(_log(LETHAL_DOSE_MINUTES), _log(at_focus), clock, right=np.inf))
    share = np.asarray(coagulated_fraction(jnp.asarray(at_focus), LETHAL_DOSE_MINUTES, width=COAGULATION_WIDTH))
    fall = _off_axis_fall(heating, protocol, settings, _focus(settings))
    # What was read just after the sonication ended is taken for its end.
    held = np.clip(time, 0.0, clock[-1])
    course, age = CubicSpline(clock, focal), held[:, None] * _AGES
    return HmiConditions(
        temperature=jnp.asarray(temperature),
        time=jnp.asarray(time),
        share=jnp.asarray(time / protocol.duration),
        rise_rate=jnp.asarray(course(held, 1)),
        age=jnp.asarray(age),
        past_rise_rate=jnp.asarray(course(held[:, None] - age, 1)),
        coagulated=jnp.asarray(np.interp(time, clock, share)),
        since_coagulation=jnp.asarray(np.maximum(time - lethal, 0.0)),
        off_axis_fall=jnp.asarray(CubicSpline(clock[1:], fall)(held)),
        is_reference=jnp.asarray(reference > 0.5),
        start_temperature=jnp.asarray(protocol.start_temperature),
        push_duration=jnp.asarray(protocol.push_duration),
    )


def _focus(settings: Discretisation) -> int:
    """Cell of the focus along the axis."""
    return int(np.argmin(np.abs(np.asarray(settings.heat_grid.z) - settings.focus)))


def _focal_dose(heating: Heating, settings: Discretisation) -> Float[np.ndarray, " time"]:
    return np.asarray(heating.dose)[:, 0, _focus(settings)]


def _log(dose):
    """Logarithm, held where there is no dose."""
    return np.log(np.maximum(dose, 1e-30))


def _off_axis_fall(
    heating: Heating, protocol: StepwiseProtocol, settings: Discretisation, z: int
) -> Float[np.ndarray, "time 3"]:
    """Logarithm of the rise on the axis over that beside it, over the cells, from the first step on."""
    r = np.asarray(settings.heat_grid.r)
    near = r < OFF_AXIS_REACH
    rise = np.asarray(heating.temperature)[1:, near, z] - protocol.start_temperature
    powers = np.vander((r[near] / OFF_AXIS_REACH) ** 2, _FALL_TERMS + 1, increasing=True)
    fit = np.linalg.lstsq(powers, np.log(np.maximum(rise, _LEAST_RISE)).T, rcond=None)[0]
    return -fit[1:].T / OFF_AXIS_REACH ** (2.0 * np.arange(1, _FALL_TERMS + 1))
