"""Two sonications, the states that they are looked at in, and data that the simulation under test makes of them."""

import dataclasses
from pathlib import Path

import numpy as np

from inverse.datasets.hmi import HmiData
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.noise_size import noise_size
from inverse.diagnosis.hmi.refit import fit_hmi
from inverse.diagnosis.hmi.rough_fit import rough_fits

FINAL = (64.0, 80.0)
STATES = [np.linspace(37.0, final, 13) for final in FINAL]
TEMPERATURES = np.concatenate(STATES)
LABELS = ("1",) * 13 + ("2",) * 13


def curves(percent: np.ndarray, time: np.ndarray | None = None) -> HmiData:
    return HmiData(Path("simulated"), LABELS, TEMPERATURES, time, percent, True, None, ())


def measured_with(problem, name, strength, *, seed=0, noise=0.0, spread=0.3):
    """The problem with data of its own simulation, other constants and a cause in it."""
    program, rng = problem.program, np.random.default_rng(seed)
    unknowns = program.null()
    unknowns[program.constants] += spread * 0.3 * rng.standard_normal(len(program.start))
    if name:
        unknowns[program.place(name)] = strength
    logarithm = program.predict(unknowns) + noise * rng.standard_normal(len(problem.rows))
    # Another factor of each sonication, as a curve that is divided by one of its readings has.
    logarithm = logarithm + problem.factors @ np.array([0.3, -0.7])
    return dataclasses.replace(problem, rows=dataclasses.replace(problem.rows, log_displacement=logarithm)), unknowns


def white(problem):
    return problem.noise_family()[0]


def fitted_with(problem, name, strength, noise, **given):
    """Data with a cause in it, of a strength in plausible ones, fitted with it."""
    hidden, _ = measured_with(problem, name, strength, noise=noise, **given)
    cause = next(cause for cause in problem.program.causes if cause.name == name)
    guess = np.array([strength * cause.plausible])
    return fit_hmi(hidden, (Extension(cause, cause.shapes[0]),), white(hidden), size=noise, strengths=guess)


def at_strength(problem, cause, strength, shape=None):
    """Prediction with a strength in plausible ones, centred in each sonication."""
    program = problem.program
    unknowns = program.null()
    unknowns[program.place(cause.name)] = strength
    unknowns[len(program.causes) + program.place(cause.name)] = cause.shapes[0] if shape is None else shape
    return unknowns, program.predict(unknowns)


def looked_for_in(problem, name, strength, noise):
    """Data with a cause in them, the fit without it, and the rough fits of that cause."""
    hidden, _ = measured_with(problem, name, strength, noise=noise, seed=6)
    null = fit_hmi(hidden, (), white(hidden), size=noise)
    spread = noise_size(null)
    effects = [one for one in hidden.alternatives(null.unknowns, null.directions, spread) if one.name == name]
    return hidden, null, effects, rough_fits(null, white(hidden), effects, size=noise, spread=spread)


def strength_and_shape(problem, name, strength, shape):
    unknowns = problem.program.null()
    unknowns[problem.program.constants] += 0.1
    place = problem.program.place(name)
    unknowns[[place, place + len(problem.program.causes)]] = strength, shape
    return unknowns


def bare(kind, **fields):
    """One of a frozen class with some of its fields, unchecked."""
    made = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made
