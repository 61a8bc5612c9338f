"""Many starts of Levenberg-Marquardt: minima found, disagreement and failure reported."""

import gc
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inverse import least_squares
from inverse.least_squares import STATUS, MultiStart, descend, multi_start


def rosenbrock(u, _):
    return jnp.stack([10.0 * (u[1] - u[0] ** 2), 1.0 - u[0]])


def test_rosenbrock_from_every_start():
    starts = np.random.default_rng(0).normal(size=(12, 2))
    result = multi_start(rosenbrock, starts)
    assert result.converged and result.n_agreeing == 12
    np.testing.assert_allclose(result.solutions, np.ones((12, 2)), atol=1e-7)
    assert result.describe() == "converged; 12 of 12 starts reached this minimum"


def test_the_best_of_two_minima_is_taken():
    def two_wells(u, _):
        return jnp.stack([u[0] ** 2 - 1.0, 0.1 * (u[0] - 1.0)])

    result = multi_start(two_wells, np.array([[-1.5], [-0.7], [1.4]]))
    np.testing.assert_allclose(result.solutions[int(result.best)], [1.0], atol=1e-7)
    assert result.n_agreeing == 1 and result.costs[0] > 1e-3


def test_too_few_steps_are_reported():
    result = multi_start(rosenbrock, np.array([[-1.2, 1.0]]), max_steps=3)
    assert not result.converged and "largest number of steps" in result.describe()


def test_values_that_are_not_finite_are_reported_and_never_best():
    def broken_below(u, _):
        return jnp.where(u < 0.0, jnp.nan, u - 2.0)

    result = multi_start(broken_below, np.array([[-1.0], [1.0]]))
    assert int(result.status[0]) == 2 and np.isinf(result.costs[0])
    assert result.converged and result.n_agreeing == 1


def test_batches_of_data():
    def line(u, y):
        return u[0] + u[1] * jnp.arange(3.0) - y

    data = jnp.array([[1.0, 2.0, 3.0], [0.0, -2.0, -4.0]])
    result = jax.jit(jax.vmap(lambda y: multi_start(line, np.zeros((1, 2)), y)))(data)
    np.testing.assert_allclose(result.solutions[:, 0], [[1.0, 1.0], [0.0, -2.0]], atol=1e-7)


def test_of_starts_that_agree_one_that_converged_is_the_best():
    """A cost that is lower by rounding is none that a start which never ended should be taken for."""
    costs = np.array([1.0, 1.0 + 5e-7, 1.0 + 2e-6])
    found = MultiStart(np.zeros((3, 1)), costs, np.array([1, 0, 0]), np.array([500, 12, 9]))
    assert int(found.best) == 1 and found.converged and found.n_agreeing == 2
    assert found.describe() == "converged; 2 of 3 starts reached this minimum"
    lower = MultiStart(np.zeros((2, 1)), np.array([0.9, 1.0]), np.array([1, 0]), np.array([500, 12]))
    assert int(lower.best) == 0 and not lower.converged


def test_one_start_is_told_step_by_step():
    design = np.stack([np.ones(5), np.arange(5.0)], axis=1)
    data = np.array([1.0, 0.5, 2.0, 1.0, 3.0])
    told = []
    found = descend(
        lambda u, y: jnp.asarray(design) @ u - y,
        np.zeros(2),
        jnp.asarray(data),
        rtol=1e-10,
        atol=1e-10,
        on_step=lambda step, cost: told.append((step, cost)),
    )
    best, (left, *_) = np.linalg.lstsq(design, data, rcond=None)[:2]
    assert found.converged and not found.out_of_steps
    np.testing.assert_allclose(found.solution, best, rtol=1e-6)
    np.testing.assert_allclose(found.first_residual, -data)
    np.testing.assert_allclose(found.residual, design @ best - data, atol=1e-6)
    np.testing.assert_allclose(found.jacobian, design, atol=1e-12)
    assert told == list(enumerate(found.costs, start=1)) and found.costs[-1] == pytest.approx(0.5 * left)


def test_a_start_that_the_solver_gave_up_or_that_met_no_number_has_not_converged(monkeypatch):
    """It ended, as one that converged does; what it was ended by is told."""
    lost = descend(lambda u, _: jnp.log(u), np.array([-1.0]))
    assert not lost.converged and lost.message == STATUS[2] and len(lost.costs) == 1
    first, _, jacobian = least_squares._steps(rosenbrock)
    given_up = (first, lambda solver, u, args, state: (u, state, True, True), jacobian)
    monkeypatch.setattr(least_squares, "_steps", lambda residual: given_up)
    given_up = descend(lambda u, _: u - 2.0, np.array([1.0]))
    assert not given_up.converged and given_up.message == STATUS[3] and not given_up.out_of_steps


def test_a_residual_that_nobody_has_any_more_is_freed_with_its_programs():
    """Calibrations one after the other keep the last few alone: programs of all would fill the memory for code."""

    class Data:
        shift = 1.0

    def residual_of(data):
        return lambda u, _: u - data.shift

    seen = []
    for _ in range(least_squares._KEPT + 1):
        data = Data()
        seen.append(weakref.ref(data))
        np.testing.assert_allclose(descend(residual_of(data), np.zeros(1)).solution, 1.0, atol=1e-6)
    del data
    gc.collect()
    assert seen[0]() is None and seen[-1]() is not None
