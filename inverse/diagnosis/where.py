"""Where the residuals differ from noise: whiteness along every coordinate, and which free form absorbs how much."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from inverse.diagnosis.evidence import Evidence
from inverse.diagnosis.free_forms import Place
from inverse.diagnosis.projection import independent, visible_columns
from inverse.diagnosis.screening import SIGNALS, shrunk

_SIZES = (*SIGNALS, 25.0, 50.0, 100.0, 200.0)
"""Sizes of a correction that is drawn: of one far above the noise nothing is held back."""
_REPLICATES = 400
LEAST_OF_WHITENESS = 1.0 / (1 + _REPLICATES)
"""Least p-value of a correlation that so many replicates of white noise can show."""


@dataclasses.dataclass(frozen=True)
class Absorbed:
    """One free form.

    Attributes:
        words: Where it acts.
        share: Part of the sum of squared residuals that it takes away.
        p_family: That noise alone gives any alternative as improbable a value.
        correction: What it adds to the prediction, in weighted residuals.
    """

    words: str
    share: float
    p_family: float
    correction: Float[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True)
class Whiteness:
    """Correlation of residuals of neighbours along one coordinate.

    Attributes:
        along: The coordinate.
        correlation: Of neighbours.
        p_value: That white residuals are as correlated, either way.
    """

    along: str
    correlation: float
    p_value: float


def absorbed_by_places(tested: Evidence, places: Sequence[Place]) -> tuple[Absorbed, ...]:
    """Free forms by how improbable they are among all alternatives, then by themselves, and what each absorbs there.

    Args:
        tested: What the tests say of every alternative.
        places: Free forms and their words; alternatives of other names are passed over.
    """
    words = {place.name: place.words for place in places}
    basis = tested.fitted
    left = tested.residuals - basis @ (basis.T @ tested.residuals)
    found = []
    for row in np.lexsort((tested.log_p, tested.p_family)):
        alternative = tested.alternatives[row]
        if alternative.name not in words:
            continue
        directions = visible_columns(alternative.directions, basis)
        if directions.shape[1] == 1:
            directions = directions - basis @ (basis.T @ directions)
        correction = absorbed(directions, left, len(left) - basis.shape[1])
        share = 1.0 - float(np.sum((left - correction) ** 2) / (left @ left))
        found.append(Absorbed(words[alternative.name], share, float(tested.p_family[row]), correction))
    return tuple(found)


def absorbed(
    directions: Float[np.ndarray, "n q"], left: Float[np.ndarray, " n"], freedom: int
) -> Float[np.ndarray, " n"]:
    """What an alternative takes of residuals: of one direction all, of a process what is likeliest, given its size.

    Noise is taken for white here: this draws a correction, and decides nothing.

    Args:
        directions: Of the alternative, fitted parameters projected out.
        left: Residuals, these projected out, too.
        freedom: Number of residuals less that of fitted parameters.
    """
    axes, lengths, _ = np.linalg.svd(directions, full_matrices=False)
    if directions.shape[1] == 1:
        return axes[:, 0] * (axes[:, 0] @ left)
    along, shares = axes.T @ left, lengths**2 / np.sum(lengths**2)
    likeliest, correction = -np.inf, np.zeros_like(left)
    for signal in _SIZES:
        taken, cost = shrunk(shares, signal)
        likelihood = -0.5 * freedom * np.log(left @ left - taken @ along**2) - np.sum(cost)
        if likelihood > likeliest:
            likeliest, correction = likelihood, axes @ (taken * along)
    return correction


@dataclasses.dataclass(frozen=True)
class Axis:
    """A coordinate along which residuals have neighbours.

    Attributes:
        along: Its name.
        keys: Series of each residual: neighbours share one.
        position: Of each residual within its series.
    """

    along: str
    keys: Int[np.ndarray, " n"]
    position: Float[np.ndarray, " n"]


def whiteness(
    axes: Sequence[Axis],
    residuals: Float[np.ndarray, " n"],
    fitted: Float[np.ndarray, "n p"],
    rng: np.random.Generator,
    *,
    replicates: int = _REPLICATES,
) -> tuple[Whiteness, ...]:
    """Correlation of neighbouring residuals along each coordinate.

    Fitted residuals are correlated even if the noise is white: the p-values are against white noise, fitted alike. Of
    residuals of a fit that weighed them as correlated noise, what a fit in white noise would take goes first.
    Data beyond those that an axis knows, which are beliefs, are not looked at.

    Args:
        axes: Coordinates, and which data are neighbours along them.
        residuals: Of the fit.
        fitted: Derivatives in everything that was fitted.
        rng: Draws the white noise.
        replicates: Of it.
    """
    basis = independent(fitted)
    noise = rng.standard_normal((len(residuals), replicates))
    batch = np.concatenate([residuals[:, None], noise], axis=1)
    batch -= basis @ (basis.T @ batch)
    found = []
    for axis in axes:
        here = batch[: len(axis.keys)]
        here = here / np.sqrt(np.mean(here**2, axis=0))
        products = []
        for key in np.unique(axis.keys):
            rows = np.flatnonzero(axis.keys == key)
            ordered = here[rows[np.argsort(axis.position[rows], kind="stable")]]
            products.append(ordered[1:] * ordered[:-1])
        if not any(len(part) for part in products):
            continue
        correlation = np.mean(np.concatenate(products), axis=0)
        centred = np.abs(correlation - np.mean(correlation[1:]))
        p_value = (1.0 + np.sum(centred[1:] >= centred[0])) / len(centred)
        found.append(Whiteness(axis.along, float(correlation[0]), float(p_value)))
    return tuple(found)
