"""Measurements: what data in percent say of their reference, and what two of them say together."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
from scipy import stats

from arfjax import complex_modulus, read_experiment
from inverse.datasets.dma import dma_data, group_sweeps
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.inference.dma import FIRST_DEVIATION, dma_measurement, of_liver
from inverse.inference.experiment import anchored, inference_problem, inference_settings
from inverse.inference.fit import fit
from inverse.inference.hmi import FIRST_RELATIVE_DEVIATION, hmi_measurement, used_rows
from inverse.inference.noise import NoiseModel, unordered
from inverse.inference.parameter_set import ParameterSet, parameter
from inverse.inference.problem import Measurement, Problem
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
