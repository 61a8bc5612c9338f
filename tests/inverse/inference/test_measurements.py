"""Measurements: what data in percent say of their reference, and what two of them say together."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
from scipy import stats

from inverse.datasets.hmi import HmiData
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
