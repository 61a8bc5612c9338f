"""Measurements: what data in percent say of their reference, and what two of them say together."""

import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from scipy import stats

from arfjax import FractionalZener, complex_modulus, read_experiment
from inverse.datasets.dma import dma_data, group_sweeps
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.inference.dma import FIRST_DEVIATION, dma_measurement, dma_problem, of_liver
from inverse.inference.experiment import (
    ParameterSection,
    PriorSection,
    anchored,
    free_parameters,
    inference_problem,
    inference_settings,
)
from inverse.inference.fit import fit
from inverse.inference.hmi import FIRST_RELATIVE_DEVIATION, hmi_measurement, used_rows
from inverse.inference.noise import NoiseModel, unordered
from inverse.inference.parameter_set import ParameterSet, parameter
from inverse.inference.problem import Measurement, Problem, State
from inverse.transforms import Positive

TEMPERATURE = np.array([37.0, 50.0, 70.0, 37.0, 60.0])
PERCENT = np.array([100.0, 98.0, 80.0, 100.0, 95.0])


def hmi(*, sd: np.ndarray | None = None, in_percent: bool = True) -> HmiData:
    labels = ("a", "a", "a", "b", "b")
    return HmiData(Path("hmi.csv"), labels, TEMPERATURE, None, PERCENT, in_percent, sd, ())


def nothing(model) -> jnp.ndarray:
    return jnp.asarray(PERCENT) * model["size"]


def test_rows_at_the_reference_say_nothing_and_are_left_out():
    measured = hmi_measurement(hmi(), nothing, reference_temperature=37.0)
    np.testing.assert_array_equal(measured.measured, [98.0, 80.0, 95.0])
    np.testing.assert_array_equal(measured.predict({"size": 2.0}), [196.0, 160.0, 190.0])
    assert measured.series.n_groups == 2 and list(measured.series.group) == [0, 0, 1]
    assert list(measured.series.previous) == [-1, 0, -1]
    assert len(used_rows(hmi(in_percent=False), 37.0)) == 5


def in_time(percent, *, in_percent: bool = True) -> HmiData:
    """Two sonications, the first of which was divided by its own reading at 5 s, the other by one that is not here."""
    seconds = np.array([0.0, 5.0, 20.0, 40.0, 5.0, 30.0])
    labels = ("a", "a", "a", "a", "b", "b")
    return HmiData(Path("hmi.csv"), labels, None, seconds, np.asarray(percent), in_percent, None, ())


def test_the_reading_that_a_curve_over_time_was_divided_by_is_no_datum():
    """Its row is left out, the others are predicted in percent of the prediction for it."""
    data = in_time([99.0, 100.0, 100.0, 70.0, 98.0, 80.0])
    curve = jnp.asarray([110.0, 80.0, 60.0, 40.0, 90.0, 50.0])
    measured = hmi_measurement(data, lambda model: curve * model["size"], reference_temperature=37.0)
    np.testing.assert_array_equal(measured.measured, [99.0, 100.0, 70.0, 98.0, 80.0])
    # The size of the curve cancels where its own reading is the divisor, and only there.
    for size in (1.0, 1.3):
        expected = [137.5, 75.0, 50.0, 90.0 * size, 50.0 * size]
        np.testing.assert_allclose(measured.predict({"size": size}), expected, rtol=1e-12)
    assert list(measured.series.group) == [0, 0, 0, 1, 1] and list(measured.series.previous) == [-1, 0, 1, -1, 3]
    # Of the gaps of 20, 20 and 25 s the usual one is 20.
    np.testing.assert_allclose(measured.series.gap, [1.0, 1.0, 1.0, 1.0, 1.25])
    in_metres = hmi_measurement(
        in_time(1e-8 * np.full(6, 100.0), in_percent=False), lambda model: curve, reference_temperature=37.0
    )
    assert len(in_metres.measured) == 6
    np.testing.assert_array_equal(in_metres.predict({}), curve)


def test_curves_in_percent_share_the_error_of_their_reference():
    """Covariance of two readings of one sonication: the reference's variance times both; of two sonications, none."""
    measured = hmi_measurement(hmi(), nothing, reference_temperature=37.0)
    assert measured.noise.tie_reference and float(measured.noise.relative) == FIRST_RELATIVE_DEVIATION
    with_sd = hmi_measurement(hmi(sd=0.03 * PERCENT), nothing, reference_temperature=37.0)
    np.testing.assert_allclose(with_sd.noise.reference_relative, 0.03, rtol=1e-12)
    apart = hmi_measurement(hmi(sd=np.full(5, 1e-6), in_percent=False), nothing, reference_temperature=37.0)
    assert not apart.noise.normalised
    prediction = np.asarray(measured.predict({"size": 1.1}))
    covariance = np.diag((FIRST_RELATIVE_DEVIATION * prediction) ** 2)
    same = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    covariance = covariance + FIRST_RELATIVE_DEVIATION**2 * same * np.outer(prediction, prediction)
    expected = stats.multivariate_normal(prediction, covariance).logpdf(np.asarray(measured.measured))
    found = measured.noise.log_likelihood(measured.measured, jnp.asarray(prediction), measured.series)
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_sweeps_are_series_of_their_own_with_all_moduli_before_all_phases():
    """Of two sweeps, three and two frequencies: neighbours within each, deviations beside what they are of."""
    frequency, temperature = np.array([1.0, 2.0, 4.0, 3.0, 6.0]), np.array([20.0, 20.0, 20.0, 50.0, 50.0])
    moduli = np.array([[3.0, 4.0], [5.0, 2.0], [6.0, 1.0], [2.0, 2.0], [4.0, 3.0]])
    data = dma_data(frequency, temperature, moduli)
    known = dataclasses.replace(data, storage_modulus_sd=0.1 * moduli[:, 0], loss_modulus_sd=0.1 * moduli[:, 1])
    solids = {20.0: FractionalZener(1.0, 7.0, 0.1, 0.5), 50.0: FractionalZener(2.0, 5.0, 0.2, 0.5)}
    measured = dma_measurement(group_sweeps(known), lambda model, sweep, at: model[sweep])
    modulus = moduli[:, 0] + 1j * moduli[:, 1]
    np.testing.assert_allclose(measured.measured, [*np.log(np.abs(modulus)), *np.angle(modulus)], rtol=1e-12)
    np.testing.assert_array_equal(measured.series.previous, [-1, 0, 1, -1, 3, -1, 5, 6, -1, 8])
    np.testing.assert_array_equal(measured.series.coordinate, np.tile(frequency, 2))
    predicted = np.concatenate([np.asarray(complex_modulus(s, 2.0 * np.pi * f)) for s, f in (
        (solids[20.0], frequency[:3]), (solids[50.0], frequency[3:]),
    )])  # fmt: skip
    found = measured.predict(tuple(solids.values()))
    np.testing.assert_allclose(found, [*np.log(np.abs(predicted)), *np.angle(predicted)], rtol=1e-9)
    # Ten percent of each part: d log |M| = (S dS + L dL) / |M|^2, and the phase has S dL - L dS.
    squared, (storage, loss) = np.abs(modulus) ** 2, moduli.T
    along, across = 0.1 * np.hypot(storage**2, loss**2) / squared, 0.1 * np.sqrt(2.0) * storage * loss / squared
    np.testing.assert_allclose(measured.noise.known, [*along, *across], rtol=1e-12)
    assert float(dma_measurement(group_sweeps(data), lambda *_: None).noise.additive) == FIRST_DEVIATION


def test_anchors_leave_the_attenuation_as_it_is_and_a_factor_is_believed_to_be_one():
    described = read_experiment(shipped("suomi2016_experiment"))
    settings = inference_settings(described, "suomi2016_experiment")
    model, before = anchored(described.model(), settings), described.model().liver.attenuation
    np.testing.assert_allclose(model.liver.attenuation.evaluate(58.0), before.evaluate(58.0), rtol=1e-9)
    np.testing.assert_allclose(model.liver.attenuation.values[1], before.evaluate(45.0), rtol=1e-12)
    prior = PriorSection(kind="log-normal", log_sd=0.3)
    place = "model.lesion.viscoelasticity.branch_modulus.value"
    for relative, median in ((True, 1.0), (False, float(model.lesion.viscoelasticity.branch_modulus.value))):
        section = ParameterSection(name="a", place=place, relative=relative, prior=prior)
        free = free_parameters(settings.model_copy(update={"parameters": (section,)}), model, {})
        assert float(free.entries[0].parameter.prior.median) == median
        changed = free.write(State(model, {}), jnp.asarray([1.5 * median])).model
        expected = 1.5 * float(model.lesion.viscoelasticity.branch_modulus.value)
        np.testing.assert_allclose(changed.lesion.viscoelasticity.branch_modulus.value, expected, rtol=1e-12)


def test_what_one_measurement_leaves_open_another_closes():
    """The product of two constants from one measurement, their ratio from another: both, from both."""
    entries = tuple(parameter(name, f"model.{name}", "Pa", transform=Positive()) for name in ("a", "b"))

    def measurement(name: str, sign: float, value: float) -> Measurement:
        return Measurement(
            name,
            lambda model: jnp.log(model["a"]) + sign * jnp.log(model["b"]) + jnp.zeros(4),
            jnp.full(4, value),
            unordered(4),
            NoiseModel(additive=0.02),
        )

    product, ratio = measurement("product", 1.0, np.log(6.0)), measurement("ratio", -1.0, np.log(1.5))
    alone = Problem(ParameterSet(entries), {"a": 1.0, "b": 1.0}, (product,))
    both = Problem(ParameterSet(entries), {"a": 1.0, "b": 1.0}, (product, ratio))
    assert fit(alone, n_starts=2).uncertainty.remarks
    found = fit(both, n_starts=2)
    np.testing.assert_allclose(found.values, [3.0, 2.0], rtol=1e-6)
    # Half the sum of two logarithms, each known to 0.02 / 2.
    np.testing.assert_allclose(found.uncertainty.standard_errors / found.values, 0.01 / np.sqrt(2.0), rtol=1e-5)


def test_the_scatter_of_sweeps_is_free_with_an_experiment():
    """Sweeps without deviations: their scatter is fitted to what it was made with, from another first guess."""
    described = read_experiment(shipped("suomi2016_experiment"))
    settings = inference_settings(described, "suomi2016_experiment")
    model, frequency = anchored(described.model(), settings), np.geomspace(1.0, 100.0, 200)
    modulus = np.asarray(complex_modulus(model.liver.viscoelasticity(37.0), jnp.asarray(2.0 * np.pi * frequency)))
    scatter = 0.06 * np.random.default_rng(6).standard_normal((2, len(frequency)))
    modulus = modulus * np.exp(scatter[0] + 1j * scatter[1])
    data = dma_data(frequency, np.full(len(frequency), 37.0), np.stack([modulus.real, modulus.imag], axis=1))
    sweeps = dma_measurement(group_sweeps(data), of_liver)
    problem = inference_problem(settings, model, (sweeps,))
    assert "dma_noise" in problem.parameters.names
    free = problem.with_parameters(problem.parameters.only(["liver_stiffness", "dma_noise"]))
    found = fit(free, n_starts=3)
    stiffness, noise = found.values
    assert found.converged and FIRST_DEVIATION == 0.02
    assert abs(noise - 0.06) < 4.0 * 0.06 / np.sqrt(2.0 * 400.0)
    error = found.uncertainty.standard_errors[0]
    assert abs(stiffness - float(model.liver.viscoelasticity.branch_modulus.value)) < 4.0 * error
    # Deviations that come with the file are taken as they are.
    known = dma_measurement(group_sweeps(data), of_liver, noise=NoiseModel(known=jnp.full(400, 0.05)))
    assert "dma_noise" not in inference_problem(settings, model, (known,)).parameters.names


def test_deviations_that_a_file_states_are_scaled_and_not_replaced():
    """Half a percent in each of fourteen readings but one, which states fifty and is that far off."""
    frequency = np.geomspace(0.1, 300.0, 14)
    modulus = np.array(complex_modulus(FractionalZener(2e3, 7e3, 1e-3, 0.6), 2.0 * np.pi * frequency))
    share = np.where(np.arange(14) == 3, 0.5, 0.005)
    modulus[3] *= 1.5
    both = np.stack([modulus.real, modulus.imag], axis=1)
    deviations = {"storage_modulus_sd": share * np.abs(modulus), "loss_modulus_sd": share * np.abs(modulus)}
    data = dataclasses.replace(dma_data(frequency, np.full(14, 37.0), both), **deviations)
    problem = dma_problem(group_sweeps(data))
    assert problem.parameters.names[-1] == "noise_scale" and problem.measurements[0].noise.known is not None
    relaxed = fit(problem).values[0]
    np.testing.assert_allclose(relaxed, 2e3, rtol=1e-3)
    plain = dma_problem(group_sweeps(dma_data(frequency, np.full(14, 37.0), both)))
    assert plain.parameters.names[-1] == "noise" and plain.measurements[0].noise.known is None
    assert abs(fit(plain).values[0] - 2e3) > 50.0
