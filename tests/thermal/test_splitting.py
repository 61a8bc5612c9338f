"""The step along r and z in turn: its matrix, its march and the march's derivatives, its order."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from arfjax.grid import AxisymmetricGrid
from arfjax.thermal.conduction import (
    Conductances,
    Convective,
    FixedTemperature,
    Insulated,
    ThermalField,
    Walls,
    cell_conductances,
    cell_geometry,
)
from arfjax.thermal.splitting import advance, march, split_operator
from tests.checks import assert_order, observed_order

GRID = AxisymmetricGrid(6e-3 * np.linspace(0.0, 1.0, 6) ** 1.3, 9e-3 * np.linspace(0.0, 1.0, 8) ** 1.1)
WALLS = Walls(Convective(300.0, 1.0), FixedTemperature(2.0), Insulated())
RNG = np.random.default_rng(11)
FIELD = ThermalField(*(jnp.asarray(RNG.uniform(*ends, GRID.shape)) for ends in ((0.2, 1.0), (3e6, 5e6), (0.0, 5e4))))
CAPACITY = jnp.asarray(FIELD.heat_capacity * GRID.volumes)
POWER = jnp.asarray(RNG.uniform(0.0, 5e6, GRID.shape) * GRID.volumes)
START = jnp.asarray(RNG.uniform(-1.0, 1.0, GRID.shape))
SOME, OTHER = (jnp.asarray(RNG.normal(size=GRID.shape)) for _ in range(2))


def conductances(walls=WALLS) -> Conductances:
    return cell_conductances(FIELD, cell_geometry(GRID), walls)[0]


def plain_march(operator, right, power, rise, time_step, n_steps):
    """As the module's docstring has it, with the conductances `right` on the right side, whatever the operator has."""

    def step(rise, _):
        first = operator.solve(power - right.leaving(rise))
        leaving = right.leaving(rise + time_step * first)
        second = operator.solve(power - leaving - 2.0 * operator.capacity * first)
        rise = advance(rise, first, second, time_step)
        return rise, rise

    return jax.lax.scan(step, rise, length=n_steps)[1]


def test_matrix_and_its_inverse():
    operator = split_operator(CAPACITY, conductances(), 4.0)
    np.testing.assert_allclose(operator.multiply(operator.solve(SOME)), SOME, rtol=1e-11, atol=1e-13)
    by_autodiff = jax.linear_transpose(operator.solve, SOME)(OTHER)[0]
    np.testing.assert_allclose(by_autodiff, operator.substitute_transposed(OTHER), rtol=1e-11)
    np.testing.assert_allclose(jnp.vdot(OTHER, operator.substitute(SOME)), jnp.vdot(by_autodiff, SOME), rtol=1e-11)


def test_matrix_is_the_one_of_the_docstring():
    """(C + w K_r) C^-1 (C + w K_z), made from what leaves the cells of a unit rise."""
    parts, operator = conductances(), split_operator(CAPACITY, conductances(), 4.0)
    units = jnp.eye(CAPACITY.size).reshape(-1, *GRID.shape)
    along_r, along_z, whole = (
        np.asarray(jax.vmap(each)(units)).reshape(CAPACITY.size, -1).T
        for each in (parts.leaving_along_r, parts.leaving_along_z, operator.multiply)
    )
    capacity, weight = np.diag(np.ravel(CAPACITY)), (1.0 - np.sqrt(0.5)) * 4.0
    expected = (capacity + weight * along_r) @ np.linalg.inv(capacity) @ (capacity + weight * along_z)
    np.testing.assert_allclose(whole, expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max())
    for part in (along_r, along_z):
        np.testing.assert_allclose(part, part.T, atol=1e-14 * np.abs(part).max())


def test_march_and_its_derivatives_are_those_of_a_plain_loop():
    n_steps, weights = 4, jnp.asarray(RNG.normal(size=(4, *GRID.shape)))

    def value(loop, given):
        capacity, parts, power, rise, step = given
        operator = split_operator(capacity, parts, step)
        if loop:
            rises = plain_march(operator, parts, power, rise, step, n_steps)
        else:
            rises = march(operator, power, rise, step, n_steps)
        return jnp.vdot(weights, rises), rises

    given = (CAPACITY, conductances(), POWER, START, jnp.asarray(3.0))
    (_, fast), by_march = jax.jit(jax.value_and_grad(lambda at: value(False, at), has_aux=True))(given)
    (_, slow), by_loop = jax.jit(jax.value_and_grad(lambda at: value(True, at), has_aux=True))(given)
    np.testing.assert_allclose(fast, slow, rtol=1e-12, atol=1e-12)
    assert len(jax.tree.leaves(by_march)) == 8
    for one, other in zip(jax.tree.leaves(by_march), jax.tree.leaves(by_loop), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10 * np.abs(other).max())
    forward = jax.jit(lambda: jax.jvp(lambda at: value(False, at)[0], (given,), (given,))[1])()
    backward = sum(jnp.vdot(slope, at) for slope, at in zip(*map(jax.tree.leaves, (by_march, given)), strict=True))
    np.testing.assert_allclose(backward, forward, rtol=1e-10)


def exact(duration: float) -> np.ndarray:
    """The same equations in continuous time, by the exponential of a matrix that carries a constant 1 beside u."""
    n = CAPACITY.size
    leaving = jax.vmap(conductances().leaving)(jnp.eye(n).reshape(-1, *GRID.shape)).reshape(n, n).T
    generator = np.zeros((n + 1, n + 1))
    generator[:n, :n] = -np.asarray(leaving) / np.ravel(CAPACITY)[:, None]
    generator[:n, n] = np.ravel(POWER / CAPACITY)
    state = expm(duration * generator) @ np.append(np.ravel(START), 1.0)
    return state[:n].reshape(GRID.shape)


@jax.jit
def one_step(of_matrix, of_right_side, rise, time_step):
    operator = split_operator(CAPACITY, of_matrix, time_step)
    return plain_march(operator, of_right_side, POWER, rise, time_step, 1)[0]


@pytest.mark.parametrize("wrong", [1.0, 1.6, 0.5, 0.0])
def test_second_order_whatever_the_matrix_is(wrong):
    """What flows along r counts `wrong` times in the matrix, perfusion and near wall up to half as much again."""
    parts, duration, steps = conductances(), 8.0, [40, 80, 160]
    other = Conductances(wrong * parts.radial, parts.axial, wrong * parts.outer, (1.5 - 0.5 * wrong) * parts.loss)
    errors = []
    for n in steps:
        rise = START
        for _ in range(n):
            rise = one_step(other, parts, rise, duration / n)
        errors.append(np.abs(rise - exact(duration)).max())
    assert_order([1.0 / n for n in steps], errors, order=2.0, slack=0.15)
    assert observed_order([1.0 / n for n in steps], errors) < 2.4 and errors[-1] < 3e-3


def test_insulated_the_matrix_keeps_heat_whatever_the_weight():
    closed = conductances(Walls(Insulated(), Insulated(), Insulated()))
    bare = Conductances(closed.radial, closed.axial, closed.outer, jnp.zeros_like(closed.loss))
    operator = split_operator(CAPACITY, bare, 1e4)
    np.testing.assert_allclose(jnp.sum(CAPACITY * operator.solve(POWER)), jnp.sum(POWER), rtol=1e-12)
