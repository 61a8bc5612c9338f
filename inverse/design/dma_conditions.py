"""Conditions of a measurement and a proposal together, in which causes are what they are in the measurement alone.

Some causes count in what was measured: slip in the highest modulus, a resonance of the frame in the highest frequency,
a second relaxation in the mean modulus of a sweep and in its ends, drift in the duration of a sweep. Further readings
move all of these, and would make another effect of the same strength and shape, in the readings that there are as well.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from inverse.datasets.dma_checks import SWEEP_GAP
from inverse.diagnosis.dma.cause import DmaConditions
from inverse.diagnosis.dma.problem import DmaProblem


class FurtherConditions(DmaConditions):
    """Conditions of more readings than strengths and shapes are told by.

    Attributes:
        first: Of those that they are told by.
    """

    first: DmaConditions

    @property
    def highest(self) -> Float[Array, ""]:
        """Highest angular frequency of the first [rad/s]."""
        return self.first.highest

    @property
    def lowest(self) -> Float[Array, ""]:
        """Lowest angular frequency of the first [rad/s]."""
        return self.first.lowest


def as_at_first(further: DmaProblem, first: DmaProblem) -> DmaProblem:
    """More data as a problem in which strengths and shapes mean what they do in the first; see also `whole_drying`.

    Args:
        further: What was measured, and more.
        first: What was measured.
    """
    now, was = further.conditions, first.conditions
    level = np.array(now.level)
    for index, sweep in enumerate(further.sweeps):
        for place, known in enumerate(first.sweeps):
            if known.sample == sweep.sample and abs(known.temperature_c - sweep.temperature_c) <= SWEEP_GAP:
                level[np.asarray(now.sweep) == index] = float(was.level[int(np.argmax(np.asarray(was.sweep) == place))])
    kept = {field.name: getattr(now, field.name) for field in dataclasses.fields(now)}
    kept |= {
        "level": jnp.asarray(level),
        "softest": was.softest,
        "stiffest": was.stiffest,
        "time_in_sweep": jnp.asarray(_time_in_sweep(further, first)),
    }
    return dataclasses.replace(further, conditions=FurtherConditions(**kept, first=was))


def _time_in_sweep(further: DmaProblem, first: DmaProblem) -> Float[np.ndarray, " row"]:
    """Share that has passed: of the readings that there are as it was; what goes on at their temperature runs past 1.

    A diagnosis of all of them takes both for one sweep, and what drifts or is on its way for going on.
    """
    now, was = further.conditions, first.conditions
    share, visit, time = np.array(now.time_in_sweep), np.asarray(now.visit), np.asarray(now.time)
    known = np.zeros(further.rows, dtype=bool)
    for sample in {sweep.sample for sweep in first.sweeps}:
        rows, before = (_rows_of(problem, sample) for problem in (further, first))
        rows = rows[time[rows] <= np.max(np.asarray(was.time)[before])]
        share[rows] = np.asarray(was.time_in_sweep)[before]
        known[rows] = True
    for one in np.unique(visit[~known]):
        measured, more = (np.flatnonzero((visit == one) & which) for which in (known, ~known))
        lasted = np.ptp(time[measured]) if len(measured) else 0.0
        if lasted > 0.0:
            share[more] = (time[more] - time[measured].min()) / lasted
    return share


def _rows_of(problem: DmaProblem, sample: str) -> Int[np.ndarray, " row"]:
    """Rows of a sample, in the order in which they were read."""
    conditions, labels = problem.conditions, np.array([sweep.sample for sweep in problem.sweeps])
    mine = np.flatnonzero(labels[np.asarray(conditions.sweep)] == sample)
    return mine[np.lexsort([np.asarray(conditions.angular_frequency)[mine], np.asarray(conditions.time)[mine]])]
