"""Inference of HMI data with the fast model in it: focused on the posterior, alone and together with DMA."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import complex_modulus, discretise, read_experiment
from benchmarks.calibration_cases import SMALL
from inverse.datasets.dma import dma_data, group_sweeps
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.hmi_model import plan_sweeps, predict
from inverse.hmi_problem import hmi_problem
from inverse.inference.audit import audit
from inverse.inference.dma import dma_measurement, of_liver
from inverse.inference.experiment import anchored, free_parameters, inference_settings
from inverse.inference.fit import Method, fit
from inverse.inference.noise import NoiseModel
from inverse.inference.problem import State
from inverse.sampling import laplace

DESCRIBED = read_experiment(shipped("suomi2016_experiment"))
SETTINGS = inference_settings(DESCRIBED, "suomi2016_experiment")
TEMPERATURES = np.array([37.0, 45.0, 52.0, 58.0, 64.0, 70.0])
FREQUENCY = np.geomspace(1.0, 100.0, 10)
STIFFER = 1.3
"""Of the liver that data are simulated with, over what the experiment says: 1.2 standard deviations of the prior."""

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


@pytest.fixture(scope="module")
def coarse():
    settings = discretise(DESCRIBED.model(), refinement=0.5)
    return dataclasses.replace(settings, n_heat_steps=SMALL.n_heat_steps, n_push_steps=SMALL.n_push_steps)


@pytest.fixture(scope="module")
def truth():
    """The experiment with a stiffer liver, and a lesion softer than what it says."""
    model = anchored(DESCRIBED.model(), SETTINGS)
    free = free_parameters(SETTINGS, model, {"hmi": NoiseModel(relative=0.02)}).without(["noise"])
    state = State(model, {})
    values = np.array(free.values(free.start(state)))
    values[free.names.index("liver_stiffness")] *= STIFFER
    values[free.names.index("lesion_stiffness")] *= 0.8
    return jax.tree.map(jnp.asarray, free.write(state, jnp.asarray(values)).model)


@pytest.fixture(scope="module")
def curve(truth, coarse):
    """Two sonications by the full model, with 2 percent of noise."""
    rows = 2 * len(TEMPERATURES)
    labels = ("1",) * len(TEMPERATURES) + ("2",) * len(TEMPERATURES)
    blank = HmiData(Path("simulated"), labels, np.tile(TEMPERATURES, 2), None, np.full(rows, 100.0), True, None, ())
    plan = plan_sweeps(blank, DESCRIBED.stepwise(), SETTINGS.reference_temperature_c)
    shown = np.asarray(jax.jit(lambda m: predict(m, plan, coarse, n_rows=rows, in_percent=True))(truth))
    noisy = shown * (1.0 + 0.02 * np.random.default_rng(5).standard_normal(rows))
    noisy[np.tile(TEMPERATURES, 2) == SETTINGS.reference_temperature_c] = 100.0
    return dataclasses.replace(blank, displacement=noisy)


@pytest.fixture(scope="module")
def sweep(truth):
    """Complex moduli of the same liver at 37 degC, with 1 percent of noise."""
    modulus = np.asarray(complex_modulus(truth.liver.viscoelasticity(37.0), jnp.asarray(2.0 * np.pi * FREQUENCY)))
    scatter = 0.01 * np.random.default_rng(6).standard_normal((2, len(FREQUENCY)))
    modulus = modulus * np.exp(scatter[0] + 1j * scatter[1])
    data = dma_data(FREQUENCY, np.full(len(FREQUENCY), 37.0), np.stack([modulus.real, modulus.imag], axis=1))
    return dma_measurement(group_sweeps(data), of_liver, noise=NoiseModel(additive=0.01))


@pytest.fixture(scope="module")
def alone(curve, coarse):
    return hmi_problem(
        DESCRIBED, SETTINGS, curve, focus=False, effort=SMALL, discretisation=coarse, heat_settings=coarse
    )


@pytest.fixture(scope="module")
def joint(curve, sweep, coarse):
    return hmi_problem(
        DESCRIBED, SETTINGS, curve, [sweep], focus=False, effort=SMALL, discretisation=coarse, heat_settings=coarse
    )


def test_dma_informs_hmi(alone, joint, truth):
    """A curve in percent says nothing of the liver's stiffness; a sweep of the same liver does, and it is found."""
    place = joint.problem.parameters.names.index("liver_stiffness")
    spreads = {}
    for name, made in (("alone", alone), ("joint", joint)):
        normal = laplace(made.problem, n_starts=2)
        assert normal.converged and normal.positive_definite
        spreads[name] = normal.sd[place]
        found = np.log(float(made.problem.values(jnp.asarray(normal.mode))[place]))
    assert spreads["alone"] > 0.2 and spreads["joint"] < 0.05 * spreads["alone"]
    expected = np.log(STIFFER * float(DESCRIBED.model().liver.viscoelasticity.branch_modulus.value))
    assert abs(found - expected) < 4.0 * spreads["joint"]


def test_the_fit_says_what_a_curve_leaves_open(alone):
    found = fit(alone.problem, n_starts=2)
    assert found.method is Method.NEWTON and found.converged
    looked_at = audit(found)
    assert any("liver_stiffness is not determined" in each for each in looked_at.identification.sentences)


def test_learning_where_the_posterior_is_brings_the_model_nearer(alone, curve, coarse):
    focused = hmi_problem(
        DESCRIBED, SETTINGS, curve, effort=SMALL, focused_effort=SMALL, discretisation=coarse, heat_settings=coarse
    )
    assert not focused.remark
    normal = laplace(focused.problem, n_starts=2)
    points = normal.draw(jax.random.key(1), 6)
    before, after = (np.median(each.verify(points).errors) for each in (alone, focused))
    assert after < 0.6 * before and after < 0.01
