"""Readings that are wrong by so much that the misfit is theirs: a slip of the measurement rather than of the model."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from inverse.diagnosis.projection import independent

_MOST = 3
"""Readings; what more of them have in common is no slip."""
_SHARE = 0.9
"""Of the sum of squares that they have to hold together. In noise of Student's t with 4 degrees of freedom they do by
chance in one of 2000 sets of 140 numbers with 28 constants, in 6 of 2000 of 48 numbers with 8."""
_FREE = 1e-6
"""Part of a reading that the fit has to leave for it to be judged."""
_LEAST_FREEDOM = 10
"""Data beyond what is fitted that have to be left without them, to see that these agree."""


@dataclasses.dataclass(frozen=True)
class Outlying:
    """One reading.

    Attributes:
        reading: Its number.
        amount: By how much it is off the model fitted to the readings that are no slips: of each of its numbers,
            weighted.
    """

    reading: int
    amount: Float[np.ndarray, " coordinate"]


def outlying(
    residuals: Float[np.ndarray, " n"], fitted: Float[np.ndarray, "n p"], reading: Int[np.ndarray, " n"]
) -> tuple[tuple[Outlying, ...], float]:
    """Few readings without which the model fits all others, and their share of the misfit; none if that is low.

    By leaving out one after the other, each time the one without which the linearised fit leaves least: not always the
    fewest.

    Args:
        residuals: Of the fit, weighted.
        fitted: Derivatives in everything that was fitted.
        reading: That each residual is of; below 0 for what is none.
    """
    basis = independent(fitted)
    whole = residuals - basis @ (basis.T @ residuals)
    across_all = np.eye(len(residuals)) - basis @ basis.T
    begun, found = float(whole @ whole), list[int]()
    left, across, spare = whole, across_all, len(residuals) - basis.shape[1]
    for _ in range(_MOST):
        candidates = [int(one) for one in np.unique(reading[reading >= 0]) if one not in found]
        taken = {one: _taken(left, across, np.flatnonzero(reading == one)) for one in candidates}
        if not taken:
            break
        worst = max(taken, key=lambda one: taken[one][1])
        rows, amount = np.flatnonzero(reading == worst), taken[worst][0]
        spare -= len(rows)
        if spare < _LEAST_FREEDOM:
            break
        found.append(worst)
        columns = across[:, rows]
        left = left - columns @ amount
        across = across - columns @ np.linalg.pinv(across[np.ix_(rows, rows)], rcond=_FREE, hermitian=True) @ columns.T
        share = 1.0 - float(left @ left) / begun if begun > 0.0 else 0.0
        if share >= _SHARE:
            return _off_the_others(whole, across_all, reading, found), share
    return (), 0.0


def _off_the_others(left, across, reading, found: Sequence[int]) -> tuple[Outlying, ...]:
    """What each of several readings is off by, if all of them are left out."""
    rows = [np.flatnonzero(reading == one) for one in found]
    amounts, _ = _taken(left, across, np.concatenate(rows))
    parts = np.split(amounts, np.cumsum([len(own) for own in rows])[:-1])
    return tuple(Outlying(one, amount) for one, amount in zip(found, parts, strict=True))


def _taken(left, across, rows) -> tuple[Float[np.ndarray, " coordinate"], float]:
    """What a reading is off by, and what of the sum of squares goes if it is left out."""
    own = across[np.ix_(rows, rows)]
    if np.linalg.norm(own) < _FREE:
        return np.zeros(len(rows)), 0.0
    amount = np.linalg.pinv(own, rcond=_FREE, hermitian=True) @ left[rows]
    return amount, float(left[rows] @ amount)


def said_of(places: Sequence[str], share: float) -> tuple[str, ...]:
    """The remark on readings that hold the misfit, each said with its place and by how much it is off.

    Args:
        places: Of the readings, in words; none if empty.
        share: Of the misfit, that they hold.
    """
    if not places:
        return ()
    percent = f"{100.0 * share:.3g} % of the misfit"
    if len(places) == 1:
        return (f"One reading holds {percent}: {places[0]}. Leave it out if it is a slip of the measurement.",)
    held = f"{len(places)} readings together hold {percent}: {'; '.join(places)}."
    return (f"{held} Leave them out if they are slips of the measurement.",)
