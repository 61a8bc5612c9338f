"""Calibration to HMI data: recovers what made the data, and says what the data cannot tell."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import InputError, discretise, read_experiment, run_stepwise
from inverse import hmi_fit, hmi_model
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.hmi_fit import AttenuationPrior, CalibrationSettings, constants_of, fit_hmi
from inverse.hmi_model import plan_sweeps, predict, require_heating
from inverse.hmi_problem import hmi_problem
from inverse.inference.experiment import InferenceSettings

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


REFERENCE_ROWS = 3
CURVE = np.concatenate([np.full(REFERENCE_ROWS, 37.0), np.linspace(40.0, 70.0, 12)])
EFFECT = np.random.default_rng(4).normal(size=(15, 8)) * [30.0, 30.0, 30.0, 30.0, 3.0, 30.0, 3.0, 0.3]
"""Of the logarithm of each constant on each row, in a model that is linear in them; none at the reference."""
EFFECT[:REFERENCE_ROWS] = 0.0
METRES = 2.5e-8  # of a percent


@pytest.fixture
def linear(described, monkeypatch):
    """The model's constants, and a simulation that is linear in their logarithms, whose posterior is known."""
    constants = constants_of(described.model(), CalibrationSettings())
    centre = np.asarray([float(parameter.transform.forward(0.0)) for parameter in constants.parameters])

    def simulated(model, sweeps, settings, *, n_rows, in_percent):
        lesion = model.lesion.viscoelasticity
        rest = (lesion.branch_modulus.value, lesion.branch_modulus.rate, lesion.relaxation_time.value)
        now = jnp.stack([*model.liver.attenuation.percent(jnp.asarray(constants.anchors)), *map(jnp.asarray, rest)])
        rows = 100.0 + jnp.asarray(EFFECT) @ jnp.log(now / centre)
        return rows if in_percent else METRES * rows

    monkeypatch.setattr(hmi_fit, "predict", simulated)
    return centre


def posterior(percent, sd):
    """Of the logarithms over the prior's centre: prior covariance, posterior mean and covariance."""
    prior = np.diag([0.25**2] * 5 + [0.5**2] * 3)
    prior[:5, :5] += 0.25**2
    covariance = np.linalg.inv(np.linalg.inv(prior) + EFFECT.T @ (EFFECT / sd[:, None] ** 2))
    return prior, covariance @ EFFECT.T @ ((percent - 100.0) / sd**2), covariance


@pytest.mark.parametrize("in_percent", [True, False])
def test_a_linear_model_has_its_posterior_in_closed_form(described, linear, tmp_path, in_percent):
    """Values, errors, and what is left of each prior, with deviations that differ from row to row."""
    random = np.random.default_rng(9)
    sd = random.uniform(1.0, 4.0, len(CURVE))
    percent = 100.0 + EFFECT @ (0.3 * random.normal(size=8)) + sd * random.normal(size=len(CURVE))
    prior, mean, covariance = posterior(percent, sd)
    unit = 1.0 if in_percent else METRES
    data = data_of(tmp_path / "x.csv", CURVE, unit * percent, unit * sd)
    data = dataclasses.replace(data, in_percent=in_percent)
    model = described.model()
    found = fit_hmi(model, data, described.stepwise(), discretise(model, refinement=0.4), CalibrationSettings())
    spread = np.sqrt(np.diag(covariance))
    assert found.descent.converged and not found.noise_estimated and found.noise_settled
    np.testing.assert_allclose((np.log(found.values / linear) - mean) / spread, 0.0, atol=0.02)
    np.testing.assert_allclose(found.standard_errors / found.values, spread, rtol=1e-6)
    np.testing.assert_allclose(found.correlation, covariance / np.outer(spread, spread), atol=1e-8)
    np.testing.assert_allclose(found.shrinkage, spread / np.sqrt(np.diag(prior)), rtol=1e-6)
    level = np.sqrt(covariance[:5, :5].sum() / prior[:5, :5].sum())
    np.testing.assert_allclose(found.level_shrinkage, level, rtol=1e-6)
    np.testing.assert_allclose(found.determined, 8.0 - np.trace(np.linalg.solve(prior, covariance)), rtol=1e-6)
    np.testing.assert_allclose(found.noise_sd, unit * sd, rtol=1e-12)
    np.testing.assert_allclose(found.before, unit * 100.0, rtol=1e-9)
    np.testing.assert_allclose(found.after, unit * (100.0 + EFFECT @ np.log(found.values / linear)), rtol=1e-6)
    names = [parameter.name for parameter in found.constants.parameters]
    free = [name for name, ratio in zip(names, spread / np.sqrt(np.diag(prior)), strict=True) if ratio > 0.9]
    assert list(found.not_identified) == ["attenuation_level"] * int(level > 0.9) + free and free
    # Errors of the coefficients are those of the values at the anchors, carried through the polynomial.
    inverse = np.linalg.inv(np.vander(found.constants.anchors, increasing=True))
    at_anchors = np.outer(found.values[:5], found.values[:5]) * covariance[:5, :5]
    np.testing.assert_allclose(found.coefficient_errors, np.sqrt(np.diag(inverse @ at_anchors @ inverse.T)), rtol=1e-5)


@pytest.mark.parametrize("in_time", [False, True])
def test_unknown_noise_is_what_the_differences_speak_for(described, linear, tmp_path, in_time):
    """s^2 = sum of squares / (n - g), of the rows that say something, to the percent at which it counts as settled.

    Of a curve over time these are all: it is over the simulated displacement at a temperature that no row need have.
    """
    random = np.random.default_rng(6)
    percent = 100.0 + EFFECT @ (0.3 * random.normal(size=8))
    percent[REFERENCE_ROWS:] += 2.0 * random.normal(size=12)
    expected = 5.0
    for _ in range(200):
        prior, mean, covariance = posterior(percent, np.full(15, expected))
        determined = 8.0 - np.trace(np.linalg.solve(prior, covariance))
        left = (percent - 100.0 - EFFECT @ mean)[0 if in_time else REFERENCE_ROWS :]
        expected = float(np.sqrt(left @ left / (len(left) - determined)))
    model, data = described.model(), data_of(tmp_path / "x.csv", CURVE, percent, None)
    if in_time:
        data = dataclasses.replace(data, temperature=None, time=np.linspace(0.0, 60.0, 15))
    found = fit_hmi(model, data, described.stepwise(), discretise(model, refinement=0.4), CalibrationSettings())
    assert found.noise_estimated and found.noise_settled
    np.testing.assert_allclose(found.noise_sd, expected, rtol=0.03)
    np.testing.assert_allclose(found.determined, determined, atol=0.1)
    # Before the first of the fits, not before the last.
    np.testing.assert_allclose(found.before, 100.0, rtol=1e-9)


def test_readings_that_no_model_can_miss_are_no_data(described, linear, tmp_path):
    """Of noise they say nothing, and there would be none in the end."""
    model, only = described.model(), np.full(len(CURVE), 37.0)
    given = (model, described.stepwise(), discretise(model, refinement=0.4), CalibrationSettings())
    data = data_of(tmp_path / "x.csv", only, np.full(len(CURVE), 100.0), None)
    with pytest.raises(InputError, match="x.csv: no row says anything of the model"):
        fit_hmi(given[0], data, *given[1:])


@pytest.fixture
def ramp(monkeypatch):
    """Heating by half a kelvin a second, and a displacement that falls with temperature, steeper in hotter ones."""
    monkeypatch.setattr(hmi_model, "simulate_heating", lambda model, protocol, settings: protocol)
    monkeypatch.setattr(hmi_model, "focal_temperature_at", lambda heating, time: 35.0 + 0.5 * time)
    monkeypatch.setattr(
        hmi_model,
        "stepwise_displacement",
        lambda model, at, protocol, settings, *, heating: micrometres(at, heating.final_temperature) * 1e-6,
    )


def micrometres(temperature, final):
    return 10.0 - 0.001 * final * (temperature - 35.0)


def test_every_row_is_predicted_in_its_own_sonication(described, ramp, tmp_path):
    """Rows out of order and of two final temperatures, in percent of 37 degC and in metres; and by time."""
    temperature = np.asarray([70.0, 40.0, 60.0, 40.0, 50.0])
    labels = ("a", "b", "a", "a", "b")
    final = np.asarray([70.0, 50.0, 70.0, 70.0, 50.0])
    data = data_of(tmp_path / "x.csv", temperature, np.full(5, 99.0), None, sonication=labels)
    model, settings = described.model(), discretise(described.model(), refinement=0.4)
    plan = plan_sweeps(data, described.stepwise(), 37.0)
    metres = predict(model, plan, settings, n_rows=5, in_percent=False)
    np.testing.assert_allclose(metres, 1e-6 * micrometres(temperature, final), rtol=1e-12)
    percent = predict(model, plan, settings, n_rows=5, in_percent=True)
    expected = 100.0 * micrometres(temperature, final) / micrometres(37.0, final)
    np.testing.assert_allclose(percent, expected, rtol=1e-12)
    time = np.asarray([30.0, 2.0, 30.0])
    timed = data_of(tmp_path / "x.csv", None, np.full(3, 99.0), None, sonication=("a", "b", "b"), time=time)
    plan = plan_sweeps(timed, described.stepwise(), 37.0)
    expected = 100.0 * micrometres(35.0 + 0.5 * time, 70.0) / micrometres(37.0, 70.0)
    np.testing.assert_allclose(predict(model, plan, settings, n_rows=3, in_percent=True), expected, rtol=1e-12)


def test_prior_is_centred_on_the_model(described):
    constants = constants_of(described.model(), CalibrationSettings())
    model = constants.apply(described.model(), constants.values(jnp.zeros(8)))
    original = described.model()
    np.testing.assert_allclose(model.liver.attenuation.coefficients, original.liver.attenuation.coefficients, rtol=1e-6)
    stiffness = model.lesion.viscoelasticity.branch_modulus
    np.testing.assert_allclose(stiffness.value, original.lesion.viscoelasticity.branch_modulus.value, rtol=1e-12)


@pytest.mark.parametrize("anchors", [(35.0, 45.0, 45.5, 65.0, 84.0), (35.0, 55.0, 45.0, 65.0, 84.0)])
def test_temperatures_of_attenuation_rise_by_a_kelvin_each(anchors):
    """Else five values make no polynomial, or one that nothing holds between two of them."""
    with pytest.raises(ValueError, match="must rise by 1 K or more"):
        CalibrationSettings(attenuation=AttenuationPrior(anchor_temperatures_c=anchors))


def test_attenuation_that_is_not_positive_at_one_of_its_temperatures_is_refused(described):
    """A polynomial that is positive at four of them: a logarithm that there is not has no prior."""
    law = described.model().liver.attenuation
    rest = law.percent(np.asarray(CalibrationSettings().attenuation.anchor_temperatures_c))
    sunk = law.coefficients - np.eye(len(law.coefficients))[0] * (np.sort(rest)[0] + 0.5)
    model = eqx.tree_at(lambda one: one.liver.attenuation.coefficients, described.model(), jnp.asarray(sunk))
    with pytest.raises(InputError, match="the polynomial is not positive there"):
        constants_of(model, CalibrationSettings())


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
    # Read just after the end, as a clock that is a little late has it: taken for the end.
    (just_after,) = plan_sweeps(dataclasses.replace(data, time=np.asarray([2.0, 60.6])), described.stepwise(), 37.0)
    assert just_after.states.tolist() == [2.0, 60.0]
    late = dataclasses.replace(data, time=np.asarray([2.0, 62.0]))
    with pytest.raises(InputError, match="62 s lies after the sonication's end at 60 s"):
        plan_sweeps(late, described.stepwise(), 37.0)


def test_temperatures_below_the_start_are_refused(described, tmp_path):
    data = data_of(tmp_path / "x.csv", np.asarray([22.0, 60.0]), np.asarray([100.0, 101.0]), None)
    with pytest.raises(InputError, match="22 degC is below the protocol's start at 35 degC"):
        plan_sweeps(data, described.stepwise(), 37.0)


COOLING = np.asarray([40.0, 50.0, 72.0, 71.0, 60.0])
TIMES = np.asarray([5.0, 20.0, 60.0, 61.0, 75.0])


def test_readings_while_it_cools_are_refused(described, tmp_path):
    """The state of 60 degC while it cools is not that of 60 degC while it heats."""
    path, displacement = tmp_path / "x.csv", np.asarray([100.0, 98.0, 80.0, 79.0, 70.0])
    cooling = data_of(path, COOLING, displacement, None, time=TIMES)
    said = "row 5: 60 degC after 72 in sonication 1; .*leave out readings while it cools"
    model, protocol = described.model(), described.stepwise()
    with pytest.raises(InputError, match=f"{said}.$"):
        fit_hmi(model, cooling, protocol, discretise(model, refinement=0.4), CalibrationSettings())
    with pytest.raises(InputError, match=f"{said}.$"):
        hmi_problem(described, InferenceSettings(), cooling)
    with pytest.raises(InputError, match=f"{said}, or sort the rows by temperature"):
        require_heating(dataclasses.replace(cooling, time=None), 60.0)
    held = dataclasses.replace(cooling, temperature=np.full(5, 72.0))
    with pytest.raises(InputError, match="row 5: 75 s is after the sonication's end at 60 s"):
        require_heating(held, 60.0)
    require_heating(cooling.select(np.arange(4)), 60.0)
