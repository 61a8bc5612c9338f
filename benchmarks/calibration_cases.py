"""The two posteriors whose calibration is checked by simulation: a sweep of DMA, and the chain of an HMI curve."""

import dataclasses
from pathlib import Path

import numpy as np

import arfjax as ax
from inverse.datasets.dma import group_sweeps, read_dma
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.hmi_problem import hmi_problem
from inverse.inference.dma import ZenerConstants, dma_measurement
from inverse.inference.experiment import DEFAULTS, ParameterSection, PriorSection, inference_settings
from inverse.inference.noise import NoiseModel
from inverse.inference.parameter_set import ParameterSet, parameter
from inverse.inference.problem import Problem
from inverse.priors import LogNormal, Uniform

SWEEP = 18
"""85 degC of the polymer: every constant is informed."""
TEMPERATURES = (37.0, 45.0, 52.0, 58.0, 64.0, 70.0)

SMALL = ax.Effort(
    n_pushes=24, n_modes=20, n_terms=8, tolerance=2e-3, n_combinations=300, n_push_steps=10, n_heat_steps=30
)
"""The fast setting: data come from the same model, so that its distance from the full one is no matter."""


_NOISE = ParameterSection(
    name="noise",
    place="noise.hmi.relative",
    prior=PriorSection(kind="log-normal", median=0.05, log_sd=0.4),
)
"""Scatter of a reading as a fraction of it: about that of the paper's three sonications."""


def _one_solid(model: ZenerConstants, sweep: int, temperature: object) -> ax.FractionalZener:
    return model.solid


def dma_case() -> Problem:
    """The frequencies and moduli of a real sweep, its constants believed within a factor of about two."""
    sweep = group_sweeps(read_dma(shipped("pyvisco_polymer")))[SWEEP]
    model = ZenerConstants(2e6, 2e9, 1e-4, 0.5)
    source = "assumed for this check"
    free = (
        parameter("relaxed_modulus", "model.relaxed_modulus", "Pa", LogNormal(2e6, 0.7, source=source)),
        parameter("branch_modulus", "model.branch_modulus", "Pa", LogNormal(2e9, 0.7, source=source)),
        parameter("relaxation_time", "model.relaxation_time", "s", LogNormal(1e-4, 0.7, source=source)),
        parameter("fractional_order", "model.fractional_order", "1", Uniform(0.2, 0.8, source=source)),
        parameter("noise", "noise.dma.additive", "1", LogNormal(0.03, 0.5, source=source)),
    )
    measurement = dma_measurement([sweep], _one_solid, noise=NoiseModel(additive=0.03))
    return Problem(ParameterSet(free), model, (measurement,))


def hmi_case(seed: int = 0) -> Problem:
    """Two sonications at six temperatures, in percent of the reading at 37 degC; free is what is free by default."""
    described = ax.read_experiment(shipped("suomi2016_experiment"))
    temperatures = np.asarray(TEMPERATURES)
    labels = ("1",) * len(temperatures) + ("2",) * len(temperatures)
    data = HmiData(
        Path("simulated"), labels, np.tile(temperatures, 2), None, np.full(2 * len(temperatures), 100.0), True, None, ()
    )
    settings = inference_settings(described, "suomi2016_experiment")
    settings = settings.model_copy(update={"parameters": (*DEFAULTS, _NOISE)})
    coarse = ax.discretise(described.model(), refinement=0.5)
    coarse = dataclasses.replace(coarse, n_heat_steps=SMALL.n_heat_steps, n_push_steps=SMALL.n_push_steps)
    made = hmi_problem(
        described, settings, data, seed=seed, focus=False, effort=SMALL, discretisation=coarse, heat_settings=coarse
    )
    return made.problem
