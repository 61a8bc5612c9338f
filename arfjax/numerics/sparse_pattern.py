"""Where a sparse symmetric matrix made of element matrices may differ from zero, and in which order to eliminate."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse
from jaxtyping import Array, Bool, Inexact, Int

from arfjax.errors import InputError


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True, eq=False)
class Pattern:
    """Entries of a symmetric sparse matrix, row by row; equal only to itself.

    Attributes:
        n_unknowns: Rows.
        starts: Where each row starts in `columns`, and the number of entries.
        columns: Of the entries, ascending in each row.
        slots: Entry that each entry of each element matrix is added to; the number of entries for one that is dropped.
        held: Entries on the diagonal of held unknowns.
        order: Order of elimination; none to have the solver find one at every factorisation.
    """

    n_unknowns: int
    starts: Int[np.ndarray, " row"]
    columns: Int[np.ndarray, " entry"]
    slots: Int[np.ndarray, "element k k"]
    held: Int[np.ndarray, " held"]
    order: Int[np.ndarray, " unknown"] | None

    @classmethod
    def of_elements(
        cls,
        element_dofs: Int[np.ndarray, "element k"],
        n_unknowns: int,
        free: Bool[np.ndarray, " unknown"] | None = None,
        *,
        order: Int[np.ndarray, " unknown"] | None = None,
    ) -> "Pattern":
        """The pattern that element matrices add up to.

        Args:
            element_dofs: Unknowns of each element, in the order of the rows of its matrix.
            n_unknowns: Of all elements together; each must occur in an element or be held.
            free: False for an unknown that is held: its row and column become those of the identity. All are free if
                not given.
            order: Order of elimination, a permutation (`nested_dissection` for a grid); the solver's own if not given.

        Raises:
            InputError: if an unknown has no row, or `order` is no permutation.
        """
        free = np.ones(n_unknowns, bool) if free is None else np.asarray(free, bool)
        if order is not None and not np.array_equal(np.sort(order), np.arange(n_unknowns)):
            raise InputError(f"`order` must be a permutation of 0 to {n_unknowns - 1}: every unknown once.")
        rows, columns, sources = _sorted_by_rows(element_dofs, n_unknowns)
        used = free[rows] & free[columns]
        rows, columns, sources = rows[used], columns[used], sources[used]
        first = np.append(True, (rows[1:] != rows[:-1]) | (columns[1:] != columns[:-1]))[: len(rows)]
        counts = np.bincount(rows[first], minlength=n_unknowns) + ~free
        if np.any(counts == 0):
            missing = int(np.flatnonzero(counts == 0)[0])
            raise InputError(f"unknown {missing} is free but in no element: its row would be empty. Hold it.")
        starts = np.append(0, np.cumsum(counts))
        held = starts[:-1][~free]
        entries = np.cumsum(first) - 1 + np.cumsum(~free)[rows]  # those of held unknowns lie in between
        all_columns = np.empty(starts[-1], np.int32)
        all_columns[entries], all_columns[held] = columns, np.flatnonzero(~free)
        slots = np.full((*element_dofs.shape, element_dofs.shape[1]), starts[-1], np.int32)
        slots.reshape(-1)[sources] = entries
        return cls(n_unknowns, starts.astype(np.int32), all_columns, slots, held.astype(np.int32), order)

    @property
    def n_entries(self) -> int:
        """Entries that may differ from zero."""
        return len(self.columns)

    @functools.cached_property
    def rows(self) -> Int[np.ndarray, " entry"]:
        """Row of each entry."""
        return np.repeat(np.arange(self.n_unknowns, dtype=np.int32), np.diff(self.starts))

    @functools.cached_property
    def mirrored(self) -> Int[np.ndarray, " entry"]:
        """Entry on the other side of the diagonal."""
        return np.lexsort((self.rows, self.columns))

    @functools.cached_property
    def reordered(self) -> scipy.sparse.csc_matrix:
        """The matrix in the order of elimination, with the number of each entry in the place of its value."""
        matrix = scipy.sparse.csr_matrix(
            (np.arange(self.n_entries), self.columns, self.starts), (self.n_unknowns, self.n_unknowns)
        )
        matrix = matrix if self.order is None else matrix[self.order][:, self.order]
        return scipy.sparse.csc_matrix(matrix)

    def assemble(self, element_matrices: Inexact[Array, "element k k"]) -> Inexact[Array, " entry"]:
        """Values of the sum of element matrices, with the identity for held unknowns."""
        total = jnp.zeros(self.n_entries, element_matrices.dtype)
        total = total.at[self.slots].add(element_matrices, mode="drop")
        return total.at[self.held].set(1.0)

    def multiply(
        self, values: Inexact[Array, " entry"], vector: Inexact[Array, " unknown"]
    ) -> Inexact[Array, " unknown"]:
        """The matrix times a vector."""
        return jax.ops.segment_sum(
            values * vector[self.columns], self.rows, num_segments=self.n_unknowns, indices_are_sorted=True
        )


def _sorted_by_rows(
    element_dofs: Int[np.ndarray, "element k"], n_unknowns: int
) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Row, column and place of every entry of every element matrix, by row and column; time in proportion to them."""
    n_elements, k = element_dofs.shape
    by_row = np.argsort(element_dofs.ravel(), kind="stable")
    element, line = np.divmod(by_row, k)
    counts = k * np.bincount(element_dofs.ravel(), minlength=n_unknowns)
    places = ((element * k + line)[:, None] * k + np.arange(k)).ravel()
    matrix = scipy.sparse.csr_array(
        (places, element_dofs[element].ravel().astype(np.int64), np.append(0, np.cumsum(counts))),
        shape=(n_unknowns, n_unknowns),
    )
    matrix.sort_indices()
    return np.repeat(np.arange(n_unknowns), counts), matrix.indices, matrix.data


def nested_dissection(n_rows: int, n_columns: int) -> Int[np.ndarray, " node"]:
    """Order of elimination of the nodes of a grid of biquadratic elements, numbered row by row.

    A line of nodes between elements cuts the grid in two; it comes after both halves, which are cut in the same way.
    Fewer entries than the solver's own order in the time to find it: a third faster on 50 000 to 130 000 unknowns.
    """
    nodes = np.arange(n_rows * n_columns).reshape(n_rows, n_columns)
    pieces: list[np.ndarray] = []

    def cut(part: np.ndarray, first: tuple[int, int]) -> None:
        along = 0 if part.shape[0] >= part.shape[1] else 1
        middle = part.shape[along] // 2
        middle += (first[along] + middle) % 2  # lines between elements have even numbers
        if part.size <= _LEAF or not 0 < middle < part.shape[along] - 1:
            pieces.append(part.ravel())
            return
        below, line, above = np.split(part, [middle, middle + 1], axis=along)
        cut(below, first)
        cut(above, (first[0] + middle + 1, first[1]) if along == 0 else (first[0], first[1] + middle + 1))
        pieces.append(line.ravel())

    cut(nodes, (0, 0))
    return np.concatenate(pieces)


_LEAF = 24
"""Nodes of a part that is not cut any more."""
