"""One small fast simulation for all tests of the diagnosis of displacement."""

import dataclasses

import numpy as np
import pytest

from arfjax import discretise, read_experiment
from benchmarks.calibration_cases import SMALL
from inverse.datasets.shipped import shipped
from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.hmi.prepare import hmi_problem_of, prepare_hmi
from inverse.inference.experiment import inference_settings
from tests.inverse.diagnosis.hmi.cases import TEMPERATURES, curves


@pytest.fixture(scope="session")
def described():
    return read_experiment(shipped("suomi2016_experiment"))


@pytest.fixture(scope="session")
def settings(described):
    return inference_settings(described, "suomi2016_experiment")


@pytest.fixture(scope="session")
def prepared(described, settings):
    coarse = discretise(described.model(), refinement=0.5)
    coarse = dataclasses.replace(coarse, n_heat_steps=SMALL.n_heat_steps, n_push_steps=SMALL.n_push_steps)
    blank = curves(np.full(len(TEMPERATURES), 100.0))
    return prepare_hmi(described, settings, blank, effort=SMALL, discretisation=coarse, heat_settings=coarse)


@pytest.fixture(scope="session")
def problem(prepared, described, settings):
    blank = curves(np.full(len(TEMPERATURES), 100.0))
    return hmi_problem_of(prepared, blank, described, settings, HMI_CAUSES)
