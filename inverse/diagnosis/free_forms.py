r"""Corrections of no name: smooth or local differences that tell where a model is wrong when no cause explains it.

Smooth ones are Gaussian processes along a coordinate $x$ from 0 to 1, with cosines for a basis: $\cos k \pi x$ with
variance $e^{-(k \pi l)^2 / 2}$ has the covariance $e^{-(x - x')^2 / 2 l^2}$ but for its mirror images at the ends and
for the constant one, which has twice the variance. A test then takes what the fit leaves of each for as large as the
whole (`visible_columns`).

Source: Solin & Särkkä (2020), Hilbert space methods for reduced-rank Gaussian process regression.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

LENGTHS = (0.3, 0.1)
"""Correlation lengths of smooth corrections, in parts of the coordinate's range: coarse ones and fine ones."""
COARSE, FINE = LENGTHS
LOCAL_WIDTHS = (0.03, 0.06, 0.12)
"""Standard deviations of local corrections, in parts of the range; their middles are as far apart."""
_LEAST_SPREAD = 0.02
"""Of a cosine, over that of the constant one, below which it is left out."""


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a free form acts, for words in a report.

    Attributes:
        name: Of the alternative.
        words: Where that is.
    """

    name: str
    words: str


def process(position: Float[np.ndarray, " n"], length: float) -> Float[np.ndarray, "n q"]:
    """Basis of a Gaussian process along a coordinate, each column as long as its strength is spread.

    Args:
        position: Of each datum.
        length: Correlation length, in parts of the range of positions.
    """
    x = (position - position.min()) / max(np.ptp(position), 1e-300)
    count = 1 + int(np.sqrt(-4.0 * np.log(_LEAST_SPREAD)) / (np.pi * length))
    turns = np.pi * np.arange(count)
    return np.cos(turns * x[:, None]) * np.exp(-0.25 * (turns * length) ** 2)


def bumps(position: Float[np.ndarray, " n"]) -> list[Float[np.ndarray, " n"]]:
    """Local corrections along a coordinate: Gaussian ones of `LOCAL_WIDTHS`, everywhere.

    Args:
        position: Of each datum.
    """
    x = (position - position.min()) / max(np.ptp(position), 1e-300)
    return [
        np.exp(-0.5 * ((x - middle) / width) ** 2)
        for width in LOCAL_WIDTHS
        for middle in np.arange(0.0, 1.0 + 0.5 * width, width).tolist()
    ]
