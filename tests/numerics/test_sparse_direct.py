"""Sparse direct solves against dense linear algebra, their derivatives, and the life of the factors."""

import contextlib
import importlib.util
import threading
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse.linalg

from arfjax.errors import InputError
from arfjax.numerics import host_factors
from arfjax.numerics.host_factors import STORE
from arfjax.numerics.own_thread import OwnThread
from arfjax.numerics.sparse_direct import (
    Pattern,
    factorise,
    limit_factor_memory,
    linear_solve,
    nested_dissection,
    release_factors,
    solve,
)
from tests.checks import assert_gradient

N_R, N_Z = 3, 2
N_ROWS, N_COLUMNS = 2 * N_Z + 1, 2 * N_R + 1
N_UNKNOWNS = N_ROWS * N_COLUMNS
HELD = [0, 5, 17]


def element_dofs() -> np.ndarray:
    corner = 2 * np.arange(N_Z)[:, None] * N_COLUMNS + 2 * np.arange(N_R)[None, :]
    inside = np.arange(3)[:, None] * N_COLUMNS + np.arange(3)[None, :]
    return (corner.reshape(-1, 1) + inside.reshape(1, -1)).astype(int)


def free() -> np.ndarray:
    mask = np.ones(N_UNKNOWNS, bool)
    mask[HELD] = False
    return mask


PATTERN = Pattern.of_elements(element_dofs(), N_UNKNOWNS, free(), order=nested_dissection(N_ROWS, N_COLUMNS))
FLOATING = Pattern.of_elements(element_dofs(), N_UNKNOWNS)
PLAIN = Pattern.of_elements(element_dofs(), N_UNKNOWNS, free())


def element_matrices(seed: int = 0, *, complex_valued: bool = False) -> jnp.ndarray:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(N_R * N_Z, 9, 9))
    matrices = root @ root.transpose(0, 2, 1) + np.eye(9)
    if complex_valued:
        other = rng.normal(size=(N_R * N_Z, 9, 9))
        matrices = matrices + 1j * (other + other.transpose(0, 2, 1))
    return jnp.asarray(matrices)


def dense(matrices: np.ndarray) -> np.ndarray:
    full = np.zeros((N_UNKNOWNS, N_UNKNOWNS), matrices.dtype)
    for dofs, matrix in zip(element_dofs(), np.asarray(matrices), strict=True):
        full[np.ix_(dofs, dofs)] += matrix
    full[HELD] = full[:, HELD] = 0.0
    full[HELD, HELD] = 1.0
    return full


def right_side(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=N_UNKNOWNS)


def solve_elements(matrices, vector, pattern=PATTERN):
    return linear_solve(pattern, pattern.assemble(matrices), vector)


compiled = jax.jit(solve_elements, static_argnums=2)


@pytest.mark.parametrize("pattern", [PATTERN, PLAIN])
@pytest.mark.parametrize("complex_valued", [False, True])
def test_solution_and_product_match_dense_algebra(pattern, complex_valued):
    matrices = element_matrices(complex_valued=complex_valued)
    solution = compiled(matrices, right_side(), pattern)
    expected = np.linalg.solve(dense(matrices), right_side())
    np.testing.assert_allclose(solution, expected, rtol=1e-11, atol=1e-13)
    product = pattern.multiply(pattern.assemble(matrices), jnp.asarray(solution))
    np.testing.assert_allclose(product, right_side(), rtol=1e-11, atol=1e-12)


def test_a_real_matrix_takes_complex_right_sides():
    vector = right_side() + 1j * right_side(2)
    expected = np.linalg.solve(dense(element_matrices()), vector)
    np.testing.assert_allclose(compiled(element_matrices(), vector, PATTERN), expected, rtol=1e-11, atol=1e-13)


def test_an_indefinite_matrix_with_zeros_on_the_diagonal_is_solved():
    swap = jnp.asarray([[[0.0, 1.0], [1.0, 0.0]], [[0.0, 3.0], [3.0, 1e-9]]])
    pattern = Pattern.of_elements(np.array([[0, 1], [2, 3]]), 4)
    solution = linear_solve(pattern, pattern.assemble(swap), jnp.arange(4.0))
    np.testing.assert_allclose(solution, [1.0, 0.0, 1.0 - 1e-9 * 2.0 / 9.0, 2.0 / 3.0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("complex_valued", [False, True])
def test_gradient_in_matrix_and_right_side(complex_valued):
    matrices = element_matrices(complex_valued=complex_valued)

    def functional(x):
        change = x["change"] + x["change"].transpose(0, 2, 1)
        solution = solve_elements(matrices * (1.0 + change), x["vector"])
        return jnp.sum(jnp.sin(solution.real)) + jnp.sum(solution.imag**2)

    change = 0.05 * np.random.default_rng(3).normal(size=matrices.shape)
    assert_gradient(functional, {"change": change, "vector": right_side()})


def test_second_derivatives():
    def functional(scale):
        return jnp.sum(solve_elements(scale * element_matrices(), right_side(), FLOATING))

    exact = jax.jit(functional)(1.0)
    np.testing.assert_allclose(jax.jit(jax.grad(jax.grad(functional)))(1.0), 2.0 * exact, rtol=1e-10)


def test_one_factorisation_serves_all_steps_and_the_gradient(monkeypatch):
    release_factors()
    calls, splu = [], scipy.sparse.linalg.splu
    monkeypatch.setattr(scipy.sparse.linalg, "splu", lambda *a, **k: calls.append(None) or splu(*a, **k))

    def march(matrices, vector):
        factor = factorise(PATTERN, PATTERN.assemble(matrices))
        return jax.lax.scan(lambda x, _: (solve(factor, x), None), vector, None, length=4)[0]

    value = jax.jit(march)(element_matrices(), right_side())
    expected = np.linalg.solve(np.linalg.matrix_power(dense(element_matrices()), 4), right_side())
    np.testing.assert_allclose(value, expected, rtol=1e-9, atol=1e-12)
    jax.block_until_ready(jax.jit(jax.grad(lambda *x: jnp.sum(march(*x))))(element_matrices(), right_side()))
    assert len(calls) == 1


def test_batches_of_right_sides_and_of_matrices_match_single_solves():
    vectors = jnp.stack([right_side(seed) for seed in range(3)])
    matrices = jnp.stack([element_matrices(seed) for seed in range(3)])
    many = jax.jit(jax.vmap(solve_elements, in_axes=(None, 0)))(matrices[0], vectors)
    each = jax.jit(jax.vmap(solve_elements))(matrices, vectors)
    for i in range(3):
        np.testing.assert_allclose(many[i], compiled(matrices[0], vectors[i], PATTERN), rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(each[i], compiled(matrices[i], vectors[i], PATTERN), rtol=1e-12, atol=1e-14)


def test_float32_is_solved_in_float64():
    matrices, vector = element_matrices().astype(jnp.float32), right_side().astype(np.float32)
    solution = compiled(matrices, vector, PATTERN)
    assert solution.dtype == jnp.float32
    rounded = np.asarray(PATTERN.assemble(matrices), float)
    expected = linear_solve(PATTERN, jnp.asarray(rounded), jnp.asarray(vector, float))
    np.testing.assert_allclose(solution, expected, rtol=1e-6, atol=1e-9)


def test_singular_and_asymmetric_matrices_are_reported():
    with pytest.raises(Exception, match="singular"):
        jax.block_until_ready(compiled(jnp.zeros((N_R * N_Z, 9, 9)), right_side(), PATTERN))
    rigid = jnp.broadcast_to(9.0 * jnp.eye(9) - 1.0, (N_R * N_Z, 9, 9))  # a constant is in its kernel
    with pytest.raises(Exception, match="singular"):
        jax.block_until_ready(compiled(rigid, right_side(), FLOATING))
    assert np.all(np.isfinite(compiled(rigid, right_side(), PATTERN)))
    with pytest.raises(Exception, match="not symmetric"):
        jax.block_until_ready(compiled(element_matrices().at[0, 1, 2].add(1.0), right_side(), PATTERN))


@pytest.mark.parametrize(("rounding", "seen"), [(2.2e-16, True), (1.2e-7, False)])
def test_an_asymmetry_beyond_the_program_s_rounding_is_reported(rounding, seen):
    """A millionth of the largest entry: much in double precision, rounding in single."""
    matrices = element_matrices()
    values = np.asarray(PATTERN.assemble(matrices.at[0, 1, 2].add(1e-6 * jnp.max(jnp.abs(matrices)))))
    with pytest.raises(ValueError, match="not symmetric") if seen else contextlib.nullcontext():
        host_factors.factor_number(PATTERN, "superlu", values, rounding=rounding)


def test_values_that_are_not_finite_give_nan():
    assert np.all(np.isnan(compiled(element_matrices().at[0, 1, 1].set(jnp.nan), right_side(), PATTERN)))


def test_a_dropped_factor_is_an_error_and_never_a_wrong_number(monkeypatch):
    release_factors()
    make = jax.jit(lambda matrices: factorise(PATTERN, PATTERN.assemble(matrices)))
    first = make(element_matrices(0))
    expected = solve(first, right_side())
    monkeypatch.setattr(STORE, "limit", STORE.limit)
    limit_factor_memory(1)
    second = make(element_matrices(1))
    assert np.all(np.isfinite(solve(second, right_side())))
    with pytest.raises(Exception, match="have been dropped"):
        jax.block_until_ready(solve(first, right_side()))
    np.testing.assert_array_equal(solve(make(element_matrices(0)), right_side()), expected)


def test_matrices_that_are_looked_up_alike_are_told_apart(monkeypatch):
    release_factors()
    monkeypatch.setattr(host_factors, "_content", lambda pattern, backend, values: ("all",))
    make = jax.jit(lambda matrices: factorise(PATTERN, PATTERN.assemble(matrices)))
    first, second = make(element_matrices(0)), make(element_matrices(1))
    assert int(second.handle) != int(first.handle)
    assert int(make(element_matrices(1)).handle) == int(second.handle)
    for factor, matrices in ((first, element_matrices(0)), (second, element_matrices(1))):
        np.testing.assert_array_equal(solve(factor, right_side()), compiled(matrices, right_side(), PATTERN))
    release_factors()


def test_factors_go_in_the_thread_that_they_came_in(monkeypatch):
    # scipy frees them only there.
    splu, came, gone = scipy.sparse.linalg.splu, [], []

    class Factors:
        def __init__(self, *given, **options):
            self.made, self.nnz = splu(*given, **options), 1
            came.append(threading.get_ident())

        def solve(self, right_sides):
            return self.made.solve(right_sides)

        def __del__(self):
            gone.append(threading.get_ident())

    release_factors()
    monkeypatch.setattr(scipy.sparse.linalg, "splu", Factors)
    seeds = range(3)
    with ThreadPoolExecutor(len(seeds)) as threads:
        list(threads.map(lambda seed: np.asarray(compiled(element_matrices(seed), right_side(), PATTERN)), seeds))
    release_factors()
    monkeypatch.undo()
    compiled(element_matrices(9), right_side(), PATTERN).block_until_ready()  # after all that was asked before
    assert len(came) == len(seeds)
    assert gone == came
    assert set(came) != {threading.get_ident()}


def test_a_thread_of_ones_own_gives_back_results_and_errors():
    thread = OwnThread("test")
    assert thread.call(threading.get_ident) == thread.call(threading.get_ident) != threading.get_ident()
    with pytest.raises(ZeroDivisionError):
        thread.call(lambda: 1 / 0)
    left: list[int] = []
    thread.later(lambda: left.append(1))
    assert thread.call(lambda: list(left)) == [1]
    here = thread.call(threading.get_ident)
    thread.later(lambda: 1 / 0)
    assert thread.call(threading.get_ident) == here  # what is held there would go with it
    thread.finish()


def test_a_thread_that_nobody_asked_does_not_begin_at_the_end():
    before = threading.active_count()
    OwnThread("test").finish()
    assert threading.active_count() == before


def test_nested_dissection_is_a_permutation_with_less_fill():
    order = nested_dissection(61, 81)
    np.testing.assert_array_equal(np.sort(order), np.arange(61 * 81))
    line = [scipy.sparse.diags([1.0] * 3, [-1, 0, 1], shape=(n, n)) for n in (61, 81)]
    matrix = (scipy.sparse.kron(*line) + 9.0 * scipy.sparse.eye(61 * 81)).tocsr()

    def fill(matrix, permutation):
        options = {"SymmetricMode": True}
        return scipy.sparse.linalg.splu(matrix.tocsc(), permutation, diag_pivot_thresh=0.0, options=options).nnz

    assert fill(matrix[order][:, order], "NATURAL") < 0.5 * fill(matrix, "NATURAL")


def test_patterns_that_cannot_be_solved_are_refused():
    with pytest.raises(InputError, match="in no element"):
        Pattern.of_elements(np.array([[0, 1]]), 3)
    with pytest.raises(InputError, match="permutation"):
        Pattern.of_elements(np.array([[0, 1]]), 2, order=np.array([0, 0]))
    with pytest.raises(InputError, match="not known"):
        factorise(PATTERN, PATTERN.assemble(element_matrices()), backend="magic")


@pytest.mark.parametrize(("backend", "module"), [("cholmod", "sksparse"), ("cholespy", "cholespy")])
def test_other_backends_agree_or_say_what_to_install(backend, module):
    values = PATTERN.assemble(element_matrices())
    if importlib.util.find_spec(module) is None:
        with pytest.raises(InputError, match=f"'{backend}' needs the package .*: install it"):
            factorise(PATTERN, values, backend=backend)
        return
    expected = compiled(element_matrices(), right_side(), PATTERN)
    np.testing.assert_allclose(
        linear_solve(PATTERN, values, right_side(), backend=backend), expected, rtol=1e-10, atol=1e-13
    )
    with pytest.raises(InputError, match="real positive definite"):
        factorise(PATTERN, values.astype(complex), backend=backend)
    with pytest.raises(Exception, match=f"{backend} cannot factorise"):
        jax.block_until_ready(factorise(PATTERN, -values, backend=backend).handle)
