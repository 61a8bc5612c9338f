"""Calibration to HMI data: recovers what made the data, and says what the data cannot tell."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import InputError, discretise, read_experiment, run_stepwise
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.hmi_fit import CalibrationSettings, constants_of, fit_hmi
from inverse.hmi_model import plan_sweeps

TEMPERATURES = np.asarray([37.0, 45.0, 52.0, 58.0, 64.0, 70.0])
TRUTH = {"attenuation": 1.10, "stiffness": 0.7}
"""Factors on the attenuation at 55 degC and on the lesion's stiffness that the data are made with."""


@pytest.fixture(scope="module")
def described():
    return read_experiment(shipped("suomi2016_experiment"))


def data_of(path, temperature, displacement, sd, *, sonication=None, time=None) -> HmiData:
    labels = sonication or ("1",) * len(displacement)
    return HmiData(path, labels, temperature, time, displacement, True, sd, ())


@pytest.fixture(scope="module")
def calibrated(described, tmp_path_factory):
    """Twin data on a finer mesh than the fit's, and the fit."""
    model, protocol = described.model(), described.stepwise()
    settings = CalibrationSettings()
    constants = constants_of(model, settings)
    values = np.asarray([float(parameter.transform.forward(0.0)) for parameter in constants.parameters])
    truth = values * np.asarray([1.0, 1.0, TRUTH["attenuation"], 1.0, 1.0, TRUTH["stiffness"], 1.0, 1.0])
    finer = discretise(model, refinement=0.8)
    run = eqx.filter_jit(lambda model: run_stepwise(model, jnp.asarray(TEMPERATURES), protocol, finer).displacement)
    displacement = np.asarray(run(constants.apply(model, jnp.asarray(truth))))
    percent = 100.0 * displacement / displacement[0]
    sd = 0.3
    noisy = percent[1:] + sd * np.random.default_rng(11).normal(size=len(percent) - 1)
    data = data_of(tmp_path_factory.mktemp("hmi") / "twin.csv", TEMPERATURES[1:], noisy, np.full(len(noisy), sd))
    steps = []
    fit = fit_hmi(
        model,
        data,
        protocol,
        discretise(model, refinement=0.5),
        settings,
        on_step=lambda step, cost: steps.append((step, cost)),
    )
    return truth, data, fit, steps


@pytest.mark.slow
def test_the_fit_explains_the_data_and_recovers_what_they_determine(calibrated):
    truth, data, fit, _ = calibrated
    assert fit.descent.converged
    assert not fit.noise_estimated
    # Differences of the discretisations are below 0.2 percent points, less than the noise of 0.3.
    assert np.sqrt(np.mean((fit.after - data.displacement) ** 2)) < 3.0 * 0.3
    assert np.sqrt(np.mean((fit.before - data.displacement) ** 2)) > 3.0
    informed = fit.shrinkage < 0.8
    assert np.any(informed)
    shift = np.log(fit.values / truth) / (fit.standard_errors / fit.values)
    assert np.all(np.abs(shift[informed]) < 3.5)


@pytest.mark.slow
def test_what_the_data_do_not_fix_is_said(calibrated):
    _, _, fit, _ = calibrated
    # The push lasts 0.5 ms, a thousandth of the relaxation time, and no temperature is near 84 degC.
    assert "lesion_relaxation_time_at_65_degc" in fit.not_identified
    assert "lesion_relaxation_time_at_65_degc is not fixed by these data" in " ".join(fit.not_identified.values())
    # With a prior no error can exceed the prior's, and none is zero.
    # A curve in percent of itself knows next to nothing of a factor on the attenuation.
    assert "attenuation_level (a factor common to all temperatures)" in fit.not_identified["attenuation_level"]
    assert fit.level_shrinkage > 0.9
    assert np.all(fit.shrinkage > 0.0) and np.all(fit.shrinkage <= 1.0 + 1e-12)
    assert 0.0 < fit.determined < len(fit.values)


@pytest.mark.slow
def test_coefficients_and_anchor_values_are_the_same_curve(calibrated):
    _, _, fit, steps = calibrated
    curve = np.polynomial.Polynomial(fit.coefficients)
    np.testing.assert_allclose(curve(fit.constants.anchors), fit.values[:5], rtol=1e-8)
    np.testing.assert_allclose(fit.model.liver.attenuation.coefficients, fit.coefficients, rtol=1e-8)
    costs = [cost for _, cost in steps]
    assert costs == sorted(costs, reverse=True)  # told step by step, and never uphill


@pytest.mark.slow
def test_readings_that_no_model_can_miss_are_no_evidence_of_noise(described, tmp_path):
    """Those of 100 percent at the reference temperature: with them in the file, noise and errors stay the same."""
    model, protocol = described.model(), described.stepwise()
    temperature, percent = np.asarray([45.0, 52.0, 58.0, 64.0, 70.0]), np.asarray([97.0, 100.0, 93.0, 80.0, 62.0])
    coarse = discretise(model, refinement=0.4)
    found = []
    for readings in (0, 3):
        data = data_of(
            tmp_path / "hmi.csv",
            np.concatenate([np.full(readings, 37.0), temperature]),
            np.concatenate([np.full(readings, 100.0), percent]),
            None,
        )
        found.append(fit_hmi(model, data, protocol, coarse, CalibrationSettings()))
    np.testing.assert_allclose(found[1].noise_sd[-5:], found[0].noise_sd, rtol=1e-6)
    np.testing.assert_allclose(found[1].standard_errors, found[0].standard_errors, rtol=1e-4)


def test_prior_is_centred_on_the_model(described):
    constants = constants_of(described.model(), CalibrationSettings())
    model = constants.apply(described.model(), constants.values(jnp.zeros(8)))
    original = described.model()
    np.testing.assert_allclose(model.liver.attenuation.coefficients, original.liver.attenuation.coefficients, rtol=1e-6)
    stiffness = model.lesion.viscoelasticity.branch_modulus
    np.testing.assert_allclose(stiffness.value, original.lesion.viscoelasticity.branch_modulus.value, rtol=1e-12)


def test_sonications_are_grouped_by_the_temperature_that_they_reach(described, tmp_path):
    data = data_of(
        tmp_path / "x.csv",
        np.asarray([40.0, 60.0, 84.0, 40.0, 70.0, 50.0, 84.0]),
        np.full(7, 100.0),
        None,
        sonication=("a", "a", "a", "b", "b", "c", "c"),
    )
    sweeps = plan_sweeps(data, described.stepwise(), 37.0)
    assert [sweep.protocol.final_temperature for sweep in sweeps] == [70.0, 84.0]
    assert sweeps[1].rows.tolist() == [0, 1, 2, 5, 6]
    np.testing.assert_allclose(sweeps[1].states[sweeps[1].places], data.temperature[sweeps[1].rows])


def test_times_alone_are_placed_on_the_simulated_heating(described, tmp_path):
    data = data_of(tmp_path / "x.csv", None, np.asarray([99.0, 105.0]), None, time=np.asarray([2.0, 30.0]))
    (sweep,) = plan_sweeps(data, described.stepwise(), 37.0)
    assert sweep.in_time and sweep.states.tolist() == [2.0, 30.0]
    late = dataclasses.replace(data, time=np.asarray([2.0, 61.0]))
    with pytest.raises(InputError, match="61 s lies after the sonication's end at 60 s"):
        plan_sweeps(late, described.stepwise(), 37.0)


def test_temperatures_below_the_start_are_refused(described, tmp_path):
    data = data_of(tmp_path / "x.csv", np.asarray([22.0, 60.0]), np.asarray([100.0, 101.0]), None)
    with pytest.raises(InputError, match="22 degC is below the protocol's start at 35 degC"):
        plan_sweeps(data, described.stepwise(), 37.0)
