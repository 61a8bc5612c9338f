"""Sweeps without noise that a fit meets, and what least squares say of causes in them."""

import dataclasses

import numpy as np
from scipy import optimize

from arfjax import FractionalZener, complex_modulus
from inverse.datasets.dma import dma_data

SOLIDS = {20.0: (1e3, 5e3, 0.02, 0.6), 40.0: (4e3, 3e4, 0.01, 0.5), 60.0: (2e3, 9e3, 1e-3, 0.6)}
FREQUENCY = np.geomspace(0.5, 200.0, 7)


def as_modelled(*temperatures):
    """A sweep at each temperature, a reading a minute and ten more to another temperature."""
    count = len(temperatures)
    modulus = np.array([
        complex(complex_modulus(FractionalZener(*SOLIDS[one]), 2.0 * np.pi * frequency))
        for one in temperatures for frequency in FREQUENCY
    ])  # fmt: skip
    data = dma_data(
        np.tile(FREQUENCY, count), np.repeat(temperatures, 7), np.stack([np.real(modulus), np.imag(modulus)], axis=-1)
    )
    clock = 60.0 * np.arange(7.0 * count) + np.repeat(600.0 * np.arange(count), 7)
    return dataclasses.replace(data, time_s=clock)


def left_by_reading(problem, extensions, strengths):
    """Of either of two causes, what the other one, of its sign, and the constants leave: by row and coordinate."""
    moved = [one.directions[:, 0] for one in problem.directions(extensions)]
    found = []
    for true, other in ((0, 1), (1, 0)):
        columns = np.column_stack([problem.fitted_directions(), moved[other]])
        lengths, target = np.linalg.norm(columns, axis=0), strengths[true] * moved[true]
        lowest = np.full(len(lengths), -np.inf)
        lowest[-1] = 0.0 if extensions[other].cause.sign > 0 else -np.inf
        solved = optimize.lsq_linear(columns / lengths, target, bounds=(lowest, np.inf), tol=1e-14)
        rest = target - columns / lengths @ solved.x
        found.append(rest.reshape(problem.weights.shape) / problem.weights)
    return found
