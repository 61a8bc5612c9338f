"""Factors of sparse symmetric matrices on the host: who makes them, whether they are reliable, how long they live."""

import abc
import atexit
import ctypes
import dataclasses
import functools
import importlib.util
import itertools
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from arfjax.errors import InputError
from arfjax.numerics.own_thread import OwnThread
from arfjax.numerics.sparse_pattern import Pattern


class HostFactor(abc.ABC):
    """What a backend gives: factors on the host, in the order of elimination."""

    n_bytes: int

    @abc.abstractmethod
    def solve(self, right_sides: np.ndarray) -> np.ndarray:
        """Solutions of several systems, one a column."""


_SUPERLU = OwnThread("SuperLU")
"""scipy keeps account of SuperLU's memory by thread, and does not free factors that go in another thread than they came
in (scipy issue 15921); newer ones free them when the thread ends that they came in. JAX calls from any: on a usual mesh
4 MB were lost a push. To factorise by turns costs little: SuperLU holds Python's lock most of the time."""


_LARGE = 8 * 2**20


@functools.cache
def _keep_large_memory_apart() -> None:
    """Have the system give and take back memory of `_LARGE` and more piece by piece, where it is Linux's C library.

    SuperLU asks for ten times what factors fill. In pieces of their own, the rest is never touched and takes no memory;
    in the heap, where the library puts pieces below 32 MiB after some have been freed, it is what others have used: a
    diagnosis that pushes with ever new tissue came to 16 GB, with less than 1 GiB of factors.
    """
    set_option = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if set_option is not None:
        threshold = -3  # M_MMAP_THRESHOLD of malloc.h
        set_option(threshold, _LARGE)


class _SuperLU(HostFactor):
    """LU factors, pivots on the diagonal wherever they are large enough."""

    def __init__(self, matrix: Any, *, ordered: bool, pivoting: float):
        make = functools.partial(
            scipy.sparse.linalg.splu,
            matrix,
            permc_spec="NATURAL" if ordered else "MMD_AT_PLUS_A",
            diag_pivot_thresh=pivoting,
            options={"SymmetricMode": True},
        )
        # The only reference, so that they go where it is taken away.
        self._held: list[Any] = []
        _keep_large_memory_apart()
        _SUPERLU.call(lambda: self._held.append(make()))
        self.n_bytes = int(self._held[0].nnz) * (matrix.dtype.itemsize + 4)

    def solve(self, right_sides: np.ndarray) -> np.ndarray:
        return self._held[0].solve(right_sides)

    def __del__(self) -> None:
        _SUPERLU.later(self._held.clear)


_BYTES_AN_ENTRY = 60
"""What the packages below take for an entry of a matrix, which they do not tell: a tenfold fill, half of it stored."""


class _Cholmod(HostFactor):
    """Cholesky factors by the SuiteSparse of the system, through the package scikit-sparse."""

    def __init__(self, matrix: Any, *, ordered: bool, pivoting: float):
        del pivoting
        cholmod: Any = importlib.import_module("sksparse.cholmod")
        matrix.sort_indices()
        ordering = "natural" if ordered else "best"
        try:
            self._factors = cholmod.analyze(matrix, mode="supernodal", ordering_method=ordering).cholesky(matrix)
        except cholmod.CholmodError as error:
            raise ValueError(str(error)) from error
        self.n_bytes = _BYTES_AN_ENTRY * matrix.nnz

    def solve(self, right_sides: np.ndarray) -> np.ndarray:
        return self._factors.solve_A(right_sides)


class _Cholespy(HostFactor):
    """Cholesky factors by the package cholespy, whose wheel brings SuiteSparse along and finds an order by itself."""

    def __init__(self, matrix: Any, *, ordered: bool, pivoting: float):
        del ordered, pivoting
        cholespy: Any = importlib.import_module("cholespy")
        self._factors = cholespy.CholeskySolverD(
            matrix.shape[0], matrix.indptr, matrix.indices, matrix.data, cholespy.MatrixType.CSC
        )
        self.n_bytes = _BYTES_AN_ENTRY * matrix.nnz

    def solve(self, right_sides: np.ndarray) -> np.ndarray:
        right_sides = np.ascontiguousarray(right_sides)
        solutions = np.empty_like(right_sides)
        self._factors.solve(right_sides, solutions)
        return solutions


class _Backend(NamedTuple):
    """How factors are made, what must be importable and what to install for it, and whether matrices may be complex."""

    make: Callable[..., HostFactor]
    module: str
    package: str
    any_symmetric: bool


_BACKENDS = {
    "superlu": _Backend(_SuperLU, "scipy", "scipy", True),
    "cholmod": _Backend(_Cholmod, "sksparse", "scikit-sparse (and SuiteSparse on the system)", False),
    "cholespy": _Backend(_Cholespy, "cholespy", "cholespy", False),
}


def check_backend(backend: str, *, complex_valued: bool) -> None:
    """Refuse a backend that is not known, not installed or does not take complex matrices."""
    if backend not in _BACKENDS:
        raise InputError(f"`backend` {backend!r} is not known: take one of {', '.join(_BACKENDS)}.")
    chosen = _BACKENDS[backend]
    if importlib.util.find_spec(chosen.module) is None:
        raise InputError(f"`backend` {backend!r} needs the package {chosen.package}: install it, or take 'superlu'.")
    if complex_valued and not chosen.any_symmetric:
        raise InputError(f"`backend` {backend!r} takes real positive definite matrices: take 'superlu' for complex.")


@dataclasses.dataclass
class HeldFactor:
    """Factors, and the matrix that they are of."""

    pattern: Pattern
    backend: str
    values: np.ndarray
    factor: HostFactor

    @property
    def n_bytes(self) -> int:
        """Memory that it takes."""
        return self.factor.n_bytes + self.values.nbytes

    @functools.cached_property
    def content(self) -> tuple:
        """What it is looked up by."""
        return _content(self.pattern, self.backend, self.values)

    def solve(self, right_sides: np.ndarray) -> np.ndarray:
        """Solutions of several systems, one a column, in the order of the unknowns."""
        if np.iscomplexobj(right_sides) and not np.iscomplexobj(self.values):
            return self.solve(np.real(right_sides)) + 1j * self.solve(np.imag(right_sides))
        order = self.pattern.order
        if order is None:
            return self.factor.solve(np.asarray(right_sides, order="F"))
        solutions = np.empty_like(right_sides)
        solutions[order] = self.factor.solve(np.asarray(right_sides[order], order="F"))
        return solutions


class FactorStore:
    """The factors used last, by number. Numbers are never given twice."""

    def __init__(self) -> None:
        """Begin with none."""
        self._held: OrderedDict[int, HeldFactor] = OrderedDict()
        self._number_of: dict[tuple, int] = {}
        self._numbers = itertools.count()
        self._lock = threading.RLock()
        self.limit = 2**30

    def find(self, pattern: Pattern, backend: str, values: np.ndarray) -> int | None:
        """Number of the factors of this very matrix, if they are kept."""
        with self._lock:
            number = self._number_of.get(_content(pattern, backend, values))
            if number is None or not np.array_equal(self._held[number].values, values):
                return None
            self._held.move_to_end(number)
            return number

    def keep(self, held: HeldFactor) -> int:
        """Their number from now on; drops those not used for longest once all take more than the limit."""
        with self._lock:
            number = next(self._numbers)
            self._held[number] = held
            self._number_of[held.content] = number
            self._trim()
            return number

    def get(self, number: int) -> HeldFactor:
        """The factors of that number.

        Raises:
            RuntimeError: if they have been dropped.
        """
        with self._lock:
            if number not in self._held:
                raise RuntimeError(
                    f"the factors number {number} of a sparse matrix have been dropped: more were alive at once than "
                    f"{self.limit / 2**30:g} GiB hold. Solve batch members one after the other (`jax.lax.map`; under a "
                    "gradient each within `jax.checkpoint`), or raise the limit (`arfjax.limit_factor_memory`)."
                )
            self._held.move_to_end(number)
            return self._held[number]

    def set_limit(self, n_bytes: int) -> None:
        """Keep no more than that, and one."""
        with self._lock:
            self.limit = n_bytes
            self._trim()

    def _trim(self) -> None:
        while len(self._held) > 1 and sum(each.n_bytes for each in self._held.values()) > self.limit:
            number, held = self._held.popitem(last=False)
            # Two threads may have made the same factors at once: the later ones are those that are found.
            if self._number_of.get(held.content) == number:
                del self._number_of[held.content]

    def clear(self) -> None:
        """Drop all."""
        with self._lock:
            self._held.clear()
            self._number_of.clear()


def _content(pattern: Pattern, backend: str, values: np.ndarray) -> tuple:
    """Equal for the same matrix; hardly ever for another one. To compare all that are kept takes longer than factors.

    A kept pattern is alive, so that no other one has its number.
    """
    return id(pattern), backend, values.dtype.str, hash(values.tobytes())


STORE = FactorStore()


@atexit.register
def _end() -> None:
    """Before the modules go that the factors need to end."""
    STORE.clear()
    _SUPERLU.finish()


def limit_factor_memory(n_bytes: int) -> None:
    """How much the host keeps of factors and their matrices, those used last; at first 1 GiB. One is always kept."""
    if n_bytes <= 0:
        raise InputError(f"`n_bytes` must be positive, got {n_bytes}.")
    STORE.set_limit(n_bytes)


def release_factors() -> None:
    """Drops all factors from the host; a solve with one of them raises an error."""
    STORE.clear()


def factor_number(pattern: Pattern, backend: str, values: np.ndarray, *, rounding: float) -> int:
    """Number in `STORE` of the factors of a matrix, made now unless they are kept; -1 if it is not finite.

    Entries may differ from their mirror by a hundred times `rounding`, that of the program which made them.

    Raises:
        ValueError: if the matrix is not symmetric, singular to working precision, or solved without accuracy.
    """
    if not np.all(np.isfinite(values)):
        return -1
    number = STORE.find(pattern, backend, values)
    if number is not None:
        return number
    asymmetry = np.max(np.abs(values - values[pattern.mirrored]), initial=0.0)
    if asymmetry > max(1e-9, 100.0 * rounding) * np.max(np.abs(values)):
        raise ValueError(f"the sparse matrix is not symmetric: entries differ by {asymmetry:g} from their mirror.")
    places: Any = pattern.reordered
    matrix = scipy.sparse.csc_matrix((values[places.data], places.indices, places.indptr), places.shape)
    return STORE.keep(
        HeldFactor(pattern, backend, values, _reliable_factor(matrix, backend, ordered=pattern.order is not None))
    )


def _reliable_factor(matrix: Any, backend: str, *, ordered: bool) -> HostFactor:
    # Pivots on the diagonal keep the fill low. Where they are too small for accuracy, pivot as stability wants.
    residual = np.inf
    for pivoting in (1e-3, 1.0):
        try:
            factor = _BACKENDS[backend].make(matrix, ordered=ordered, pivoting=pivoting)
        except (RuntimeError, ValueError) as error:
            raise ValueError(f"{backend} cannot factorise the sparse matrix: {error}. {_SINGULAR}") from error
        residual, condition = _check(matrix, factor)
        if not condition < _LARGEST_CONDITION:
            raise ValueError(f"the sparse matrix is singular (condition at least {condition:.1e}). {_SINGULAR}")
        if residual < _LARGEST_RESIDUAL:
            return factor
    raise ValueError(f"{backend} solves the sparse matrix with relative residual {residual:.1e} only. {_SINGULAR}")


_SINGULAR = "Is something free to move without force, or a constant of the material zero, negative or not in SI units?"

_LARGEST_CONDITION = 1e15
"""Of the matrix scaled to entries of one; that of nearly incompressible solids is below 1e12."""

_LARGEST_RESIDUAL = 1e-10
"""Backward error above which pivots off the diagonal are tried."""


def _check(matrix: Any, factor: HostFactor) -> tuple[float, float]:
    # Backward error, and a lower bound of the condition of the scaled matrix by two steps of inverse iteration.
    sizes = abs(matrix)
    scale = np.sqrt(sizes.max(axis=0).toarray().ravel())
    vector = np.random.default_rng(0).standard_normal(matrix.shape[0])
    residual = condition = np.inf
    for _ in range(2):
        right_side = (scale * vector / np.linalg.norm(vector)).astype(matrix.dtype)
        solution = factor.solve(np.asarray(right_side[:, None], order="F"))[:, 0]
        size = sizes @ np.abs(solution) + np.abs(right_side)
        residual = float(np.max(np.abs(matrix @ solution - right_side) / size))
        vector = scale * solution
        condition = float(np.linalg.norm(vector))
    return residual, condition
