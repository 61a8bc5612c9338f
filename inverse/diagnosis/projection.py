"""Directions, and what fitted parameters leave of them."""

import numpy as np
from jaxtyping import Float

_VISIBLE = 1e-2
"""Part of a process's direction that the fitted parameters and its coarser directions must leave for it to count."""
_ROUNDING = 1e-9  # part of a direction that is left by rounding alone
_FLOOR = 1e-300


def independent(columns: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n r"]:
    """Orthonormal basis of the columns, scaled to unit length first; directions of no effect are dropped."""
    lengths = np.linalg.norm(columns, axis=0)
    kept = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
    basis, singular, _ = np.linalg.svd(kept, full_matrices=False)
    return basis[:, singular > 1e-9 * singular[0]] if singular.size else kept


def project_out(columns: Float[np.ndarray, "n m"], basis: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n m"]:
    """Columns without what an orthonormal basis holds of them."""
    return columns - basis @ (basis.T @ columns)


def unit_columns(columns: Float[np.ndarray, "n q"]) -> Float[np.ndarray, "n q"]:
    """Columns of unit length."""
    return columns / np.maximum(np.linalg.norm(columns, axis=0), _FLOOR)


def visibility(columns: Float[np.ndarray, "n q"], fitted: Float[np.ndarray, "n p"]) -> Float[np.ndarray, " q"]:
    """Part of each column's length that the fitted parameters cannot imitate."""
    return np.linalg.norm(project_out(unit_columns(columns), independent(fitted)), axis=0)


def visible_columns(columns: Float[np.ndarray, "n q"], basis: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n r"]:
    """A direction as it is; of a process, what the fit leaves of each column, as long as the column is.

    Columns are taken in order of their length, each less what those before it can do: a coarse correction that the
    fitted parameters imitate but for a hundredth is still believed before a fine one.
    """
    lengths = np.linalg.norm(columns, axis=0)
    if columns.shape[1] == 1:
        visible = np.linalg.norm(project_out(columns, basis)) > _ROUNDING * lengths[0]
        return columns / lengths[0] if visible else columns[:, :0]
    order = np.argsort(-lengths, kind="stable")
    order = order[lengths[order] > 0.0]
    spread, found = [], np.zeros((len(columns), 0))
    for column in order:
        left = project_out(columns[:, [column]] / lengths[column], basis)
        # Twice: once is not enough where next to nothing is left.
        rest = project_out(project_out(left, found), found)
        length = float(np.linalg.norm(rest))
        if length > _VISIBLE:
            spread.append(lengths[column])
            found = np.concatenate([found, rest / length], axis=1)
    return found * np.array(spread) / spread[0] if spread else found
