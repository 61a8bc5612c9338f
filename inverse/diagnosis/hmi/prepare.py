"""The fast simulation that a diagnosis of curves of displacement uses: it has to follow causes, not only constants."""

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import numpy as np

from arfjax import Discretisation, Effort, Experiment, InputError, Model, Shifted, discretise
from inverse.datasets.copies import said_of_copies
from inverse.datasets.hmi import HmiData
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.courses import HmiRows, hmi_rows, plan_courses
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.program import HmiProgram
from inverse.fast_hmi import FastHmi, prepare_fast
from inverse.hmi_model import Sweep, plan_sweeps
from inverse.inference.experiment import InferenceSettings, anchored, free_parameters
from inverse.inference.hmi import SAME_TEMPERATURE_K
from inverse.inference.parameter_set import ParameterSet
from inverse.inference.problem import State
from inverse.inference.widened import widened

OnStep = Callable[[str], None]

LEARNT = Effort(n_pushes=500, n_modes=60, n_combinations=500, small_lesions=True)
"""How much goes into the fast simulation of a diagnosis. It has to follow the first millimetre of a lesion, on which
nearly all causes that change temperature or dose act, and constants other than those of the fit.

How far it is from the full one, at the constants that six development sets were made with, in 57 readings at 1 % (as
d', without a cause; with one of d' 4.5): 5.3 to 5.5; 4.8 to 6.6 with 200 pushes and heat at refinement 1. With 500
pushes and heat at `_HEAT` 2.8 to 3.7; 2.5 to 6.1. No better with 1000 pushes, 1000 combinations, heat at refinement 2,
or heat as the full simulation has it (2.8 to 3.7). With 120 shapes 1.9 to 3.1; 1.8 to 3.5, and a prediction takes three
times as long. What is left sits where a lesion is first felt, and at the hottest readings.

A regression of what is left on the constants, over 45 draws of the priors, takes it to 0.6 to 2.2 without a cause; with
one it stays at 1.3 to 4.5. Fits that are compared have to be equally wrong, so it is not done."""
_HEAT = 1.5
"""Refinement of sound and heat in the fast simulation."""
_FINER = 2.0
"""Refinement of the mesh that tells how far the usual one is wrong."""
_DRAWS = 100
_WIDER = 4.0 / 3.0
_LATE = 0.1
"""Part of the sonication by which measured times may differ from simulated ones without a word."""
_SOUND_SPEED = 25.0
"""Change of the liver's sound speed that the fast simulation follows either way [m/s]."""


@dataclasses.dataclass(frozen=True)
class PreparedHmi:
    """An experiment's fast simulation of some sonications, for all data measured in the same states.

    Attributes:
        fast: The fast simulation.
        sweeps: Sonications.
        model: The experiment's, its attenuation by anchors.
        parameters: What is free in it.
        fine: Mesh of the pushes that the fast simulation learnt from, and of what it is corrected to.
        finer: Tells how far that mesh is wrong; None if it was chosen by somebody who knows.
    """

    fast: FastHmi
    sweeps: tuple[Sweep, ...]
    model: Model
    parameters: ParameterSet
    fine: Discretisation
    finer: Discretisation | None = None


def prepare_hmi(
    described: Experiment,
    settings: InferenceSettings,
    data: HmiData,
    *,
    seed: int = 0,
    effort: Effort = LEARNT,
    discretisation: Discretisation | None = None,
    heat_settings: Discretisation | None = None,
    on_step: OnStep = lambda what: None,
) -> PreparedHmi:
    """Prepare the fast simulation from draws of priors a third wider than those of the inference.

    Args:
        described: The experiment.
        settings: Its section `[inference]`.
        data: What was measured: in which sonications, up to which temperatures.
        seed: Of the draws.
        effort: How much goes into it.
        discretisation: Of the full simulation; the usual mesh, and heat at refinement 2, if not given.
        heat_settings: Of sound and heat in the fast simulation; refinement 1.5 if not given.
        on_step: Told what is being done.

    Raises:
        InputError: if data, experiment and settings do not go together.
    """
    model = _with_shift(anchored(described.model(), settings))
    sweeps = plan_sweeps(data, described.stepwise(), settings.reference_temperature_c)
    fine = of_full_simulation(model) if discretisation is None else discretisation
    parameters = free_constants(described, settings)
    draws = _draws(_trained(settings, model, parameters), model, seed)
    heat = discretise(model, refinement=_HEAT) if heat_settings is None else heat_settings
    fast = prepare_fast(
        draws, sweeps, fine, heat_settings=heat, effort=effort,
        on_step=lambda step, done, of: on_step(f"fast simulation: {step} {done} of {of}"),
    )  # fmt: skip
    finer = of_full_simulation(model, _FINER) if discretisation is None else None
    return PreparedHmi(fast, sweeps, model, parameters, fine, finer)


def of_full_simulation(model: Model, refinement: float = 1.0) -> Discretisation:
    """The usual mesh, or one refined, and heat at refinement 2, on which a lesion's beginning depends most.

    Seven effects of d' 0.5 to 7, at a noise of 1 % in three sonications of 57 readings, are then within d' 0.6 of those
    with mesh and heat at refinement 3; with both at refinement 2 they are within 1.1 in three times the time, with both
    at 1 within 0.9 (one set of constants). That holds for effects. Derivatives are worse: where a lesion begins, the
    displacement turns from +2 to -1.5 % a kelvin within a kelvin, and the usual mesh has that wavy by 0.25 % a kelvin.
    """
    mesh, heat = discretise(model, refinement=refinement), discretise(model, refinement=2.0)
    return dataclasses.replace(
        mesh, heat_grid=heat.heat_grid, layer_of_cell=heat.layer_of_cell, n_heat_steps=heat.n_heat_steps
    )


def free_constants(described: Experiment, settings: InferenceSettings) -> ParameterSet:
    """What is free in the model; the noise is none of the model.

    Raises:
        InputError: if a place does not exist, or nothing of the model is free.
    """
    model = _with_shift(anchored(described.model(), settings))
    kept = tuple(one for one in settings.parameters if not one.place.startswith("noise."))
    if settings.parameters and not kept:
        raise InputError("[inference] frees no constant of the model: a diagnosis fits one at least.")
    return free_parameters(settings.model_copy(update={"parameters": kept}), model, {})


def hmi_problem_of(
    prepared: PreparedHmi,
    data: HmiData,
    described: Experiment,
    settings: InferenceSettings,
    causes: Sequence[HmiCause],
    *,
    program: HmiProgram | None = None,
) -> HmiDiagnosisProblem:
    """Data and simulation together.

    Args:
        prepared: The fast simulation.
        data: What was measured.
        described: The experiment.
        settings: Its section `[inference]`.
        causes: The library.
        program: Compiled for other data of the same states, with these causes or more.
    """
    reference = settings.reference_temperature_c
    curve = prepared.fast.curve
    kept = data.without_copies()
    copies, data = said_of_copies(kept.n_copies - data.n_copies), kept
    rows = hmi_rows(data, reference)
    courses, rows = plan_courses(data, rows, prepared.model, described.stepwise(), curve.settings, reference)
    if program is None:
        program = HmiProgram(
            curve, courses, prepared.parameters, State(prepared.model, {}), causes, prepared.fine, prepared.finer
        )
    else:
        program = program.on(courses)
    notes = (*copies, *_notes(data, rows, reference))
    if settings.across_sonications:
        differing = ", ".join(settings.across_sonications)
        notes = (
            *notes,
            f"Constants are common to all sonications here, {differing} too: see `arfjax infer` for those.",
        )
    return HmiDiagnosisProblem(rows, program, notes)


def _with_shift(model: Model) -> Model:
    """The model with a sound speed of liver that can be shifted."""
    law = model.liver.sound_speed
    shifted = Shifted(law=law, shift=0.0, unit=law.unit, source=law.source, valid_range=law.valid_range)
    return eqx.tree_at(lambda tree: tree.liver.sound_speed, model, shifted)


def _trained(settings: InferenceSettings, model: Model, parameters: ParameterSet) -> ParameterSet:
    """What the fast simulation has to follow: all that is free by default, although it may be fixed, and what is free.

    Causes change attenuation and moduli also where those are not fitted.
    """
    try:
        usual = free_parameters(settings.model_copy(update={"parameters": ()}), model, {})
    except InputError:  # a model of other laws has no such places
        return parameters
    places = {entry.parameter.place for entry in usual.entries}
    return ParameterSet(
        (*usual.entries, *(entry for entry in parameters.entries if entry.parameter.place not in places))
    )


def _draws(parameters: ParameterSet, model: Model, seed: int) -> list[Model]:
    wide = widened(parameters, _WIDER)
    keys = jax.random.split(jax.random.key(seed + 1), _DRAWS)
    points = jax.vmap(lambda key: wide.values(wide.draw(key)))(keys)
    shifts = np.random.default_rng(seed).uniform(-_SOUND_SPEED, _SOUND_SPEED, _DRAWS)
    drawn = [wide.write(State(model, {}), point).model for point in points]
    return [
        eqx.tree_at(lambda tree: tree.liver.sound_speed.shift, one, float(shift))
        for one, shift in zip(drawn, shifts, strict=True)
    ]


def _notes(data: HmiData, rows: HmiRows, reference: float) -> tuple[str, ...]:
    notes = []
    if data.time is None:
        notes.append("The file gives no times: those are taken from the simulated heating.")
    if data.temperature is None:
        notes.append(
            "The file gives no temperatures: those are taken from the simulated heating, in every sonication up to the "
            "last of `protocol.temperatures_c`."
        )
        if data.in_percent:
            notes.append(
                "Which reading a curve was divided by is not known without temperatures: its error is not counted, and "
                "`normalisation-temperature` has nothing to act on."
            )
    if len(rows) > len(data.displacement):
        count = len(rows) - len(data.displacement)
        notes.append(
            f"Of {count} sonications the reading that the curve was divided by is not in the file; it counts as one "
            "more reading, 100 percent at the reference temperature, with an error like the others'."
        )
    elsewhere = rows.is_reference & (np.abs(rows.temperature - reference) >= SAME_TEMPERATURE_K)
    if np.any(elsewhere):
        at = ", ".join(
            f"{rows.labels[rows.sonication[i]]} at {rows.temperature[i]:g}" for i in np.flatnonzero(elsewhere)
        )
        notes.append(
            f"Sonications that are 100 percent at their coldest reading were divided by that, not by one at "
            f"{reference:g} degC: {at} degC."
        )
    late = np.zeros(0) if rows.lateness is None else rows.lateness[np.isfinite(rows.lateness)]
    if late.size and abs(np.median(late)) > _LATE * float(np.max(rows.time)):
        notes.append(
            f"Readings come {abs(np.median(late)):.2g} s {'later' if np.median(late) > 0.0 else 'earlier'} than the "
            "simulated heating gets to their temperatures (median); thermal dose is that of the simulated heating. Are "
            "`protocol.sonication_s` and the temperatures right?"
        )
    notes.append("A factor of each sonication is free: absolute displacement says nothing here.")
    return tuple(notes)
