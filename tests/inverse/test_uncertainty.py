"""Standard errors of least squares against linear regression, and sentences about what is not fixed."""

import jax.numpy as jnp
import numpy as np
import pytest

from inverse.parameters import Parameter
from inverse.transforms import Identity, Positive
from inverse.uncertainty import assess, delta_method

X = np.linspace(1.0, 2.0, 40)
LINE = np.stack([np.ones_like(X), X], axis=-1)
PARAMETERS = (Parameter("intercept", "Pa", Identity()), Parameter("slope", "Pa/s", Identity()))


def judge(jacobian, residuals, values, parameters=PARAMETERS, **settings):
    return assess(jacobian, residuals, np.asarray(values), parameters, ends=[None] * len(parameters), **settings)


def test_linear_regression_in_closed_form():
    residuals = 0.1 * np.random.default_rng(1).normal(size=len(X))
    result = judge(LINE, residuals, [5.0, 3.0])
    variance = residuals @ residuals / 38.0
    np.testing.assert_allclose(result.covariance, variance * np.linalg.inv(LINE.T @ LINE), rtol=1e-10)
    np.testing.assert_allclose(result.correlation[0, 1], -np.mean(X) / np.sqrt(np.mean(X**2)), rtol=1e-10)
    assert result.residual_variance == pytest.approx(variance)
    assert not result.not_identified and not result.remarks
    known = judge(LINE / 0.1, residuals / 0.1, [5.0, 3.0], in_standard_deviations=True)
    np.testing.assert_allclose(known.covariance, 0.01 * np.linalg.inv(LINE.T @ LINE), rtol=1e-10)


def test_units_do_not_matter():
    residuals = np.random.default_rng(2).normal(size=len(X))
    plain = judge(LINE, residuals, [5.0, 3.0])
    scaled = judge(LINE * np.array([1e-9, 1e9]), residuals, [5.0e9, 3.0e-9])
    np.testing.assert_allclose(scaled.standard_errors, plain.standard_errors * [1e9, 1e-9], rtol=1e-8)


def test_what_is_not_fixed_is_said():
    residuals = 0.1 * np.random.default_rng(3).normal(size=len(X))
    unfelt = judge(LINE * np.array([1.0, 0.0]), residuals, [5.0, 3.0])
    assert "has no effect" in unfelt.not_identified["slope"] and np.isinf(unfelt.standard_errors[1])
    assert np.isfinite(unfelt.standard_errors[0])
    loose = judge(LINE * np.array([1.0, 1e-3]), residuals, [5.0, 3.0])
    assert list(loose.not_identified) == ["slope"] and "standard error" in loose.not_identified["slope"]
    bound = assess(LINE, residuals, np.array([5.0, 3.0]), PARAMETERS, ends=["lower", None])
    assert "lower end" in bound.not_identified["intercept"] and "bound" in bound.not_identified["intercept"]


@pytest.mark.parametrize(
    ("end", "said"), [("lower", "ran to zero, with which they are compatible"), ("upper", "upper end")]
)
def test_a_positive_constant_has_no_lower_end_but_zero(end, said):
    positive = (Parameter("intercept", "m", Positive()), PARAMETERS[1])
    residuals = 0.1 * np.random.default_rng(3).normal(size=len(X))
    found = assess(LINE, residuals, np.array([4.68e-4, 3.0]), positive, ends=[end, None])
    assert said in found.not_identified["intercept"] and "0.000468 m" in found.not_identified["intercept"]


def test_a_free_combination_is_named():
    twin = np.stack([X, -2.0 * X * (1.0 + 1e-6 * np.sin(40.0 * X))], axis=-1)
    result = judge(twin, 1e-9 * np.cos(90.0 * X), [1.0, 1.0])
    assert "intercept by +1 %, slope by +0.5 %" in result.remarks[0]


def test_no_degrees_of_freedom():
    result = judge(LINE[:2], np.zeros(2), [5.0, 3.0])
    assert "nothing is left over" in result.remarks[0] and set(result.not_identified) == {"intercept", "slope"}


def test_delta_method():
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    value, spread = delta_method(lambda p: jnp.stack([p[0] * p[1], jnp.exp(p[0])]), np.array([1.0, 2.0]), covariance)
    np.testing.assert_allclose(value, [2.0, np.e])
    np.testing.assert_allclose(spread[0, 0], 4.0 * 0.04 + 2.0 * 2.0 * 0.01 + 0.09, rtol=1e-12)
    np.testing.assert_allclose(spread[1, 1], np.e**2 * 0.04, rtol=1e-12)


def test_a_constant_that_is_not_told_by_itself_is_no_joint_change():
    """Of those that do the same one is felt so little that the other need not move for it."""
    bend = 1e-9 * (X + 1e-5 * X**2)
    three = (*PARAMETERS, Parameter("bend", "Pa", Identity()))
    found = judge(np.column_stack([LINE, bend]), 0.1 * np.sin(40.0 * X), [5.0, 3.0, 1.0], three)
    assert found.remarks == ("The data hardly tell bend: changed by itself, it leaves the fit all but the same.",)


def test_fewer_data_than_constants_leave_a_direction_open():
    """Two data feel a + c and b + c: nothing is known of (1, 1, -1), however small their deviations."""
    jacobian = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]) / 1e-3
    three = (*PARAMETERS, Parameter("bend", "Pa", Identity()))
    found = judge(jacobian, np.zeros(2), [1.0, 1.0, 0.5], three, in_standard_deviations=True)
    assert np.all(found.standard_errors > 1e3) and set(found.not_identified) == {"intercept", "slope", "bend"}
    # In percent of the values, of which the last is half as large.
    assert "a joint change of intercept by -0.5 %, slope by -0.5 %, bend by +1 %" in found.remarks[0]
