"""Rows of a table that say what another one says: one reading, written twice."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int


def distinct_rows(columns: Sequence[np.ndarray | Sequence[str] | None]) -> Int[np.ndarray, " kept"]:
    """The first of all rows that are alike in every column; None for a column that is not there."""
    rows = list(zip(*(np.asarray(one).tolist() for one in columns if one is not None), strict=True))
    return np.array(sorted({row: place for place, row in reversed(list(enumerate(rows)))}.values()))


def said_of_copies(count: int) -> tuple[str, ...]:
    """A remark on copies that were left out, if there were any."""
    if count == 0:
        return ()
    copies = (
        f"{count} rows repeat others in every column that is used and are"
        if count > 1
        else ("One row repeats another and is")
    )
    return (f"{copies} left out: a reading that is written twice is one.",)
