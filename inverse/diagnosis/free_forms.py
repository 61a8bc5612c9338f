"""Corrections of no name: smooth or local differences that tell where a model is wrong when no cause explains it."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from inverse.diagnosis.screening import Alternative

SMOOTH_TERMS = (3, 7)
"""Cosines of a smooth correction along a coordinate: a coarse one has power, a fine one reach."""
_SAME = 1e-3
"""Relative difference below which two frequencies count as the same."""


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a free form acts, for words in a report.

    Attributes:
        name: Of the alternative.
        words: Where that is.
    """

    name: str
    words: str


def dma_free_forms(
    frequency: Float[np.ndarray, " n"],
    temperature: Float[np.ndarray, " n"],
    sweep: Int[np.ndarray, " n"],
    coordinate: Int[np.ndarray, " n"],
    labels: tuple[str, ...],
) -> tuple[list[Alternative], list[Place]]:
    """Free forms for dynamic mechanical analysis.

    A correction common to all sweeps, one that grows with temperature, one of a single sweep (all smooth in the
    logarithm of frequency), and one at a single frequency of all sweeps.

    Args:
        frequency: Of each residual [Hz].
        temperature: Of each residual [degC].
        sweep: Index of its sweep.
        coordinate: 0 for the magnitude, 1 for the phase.
        labels: Of the sweeps.
    """
    found, places = [], []

    def add(name: str, words: str, directions: Float[np.ndarray, "n q"]) -> None:
        found.append(Alternative(name, directions))
        places.append(Place(name, words))

    many = len(labels) > 1
    for terms in SMOOTH_TERMS:
        smooth = _smooth(frequency, coordinate, terms)
        if many:
            add(f"smooth-{terms}", "in all sweeps alike, smoothly along frequency", smooth)
            slope = 2.0 * (temperature - temperature.min()) / max(np.ptp(temperature), 1e-300) - 1.0
            add(f"trend-{terms}", "growing with temperature, smoothly along frequency", slope[:, None] * smooth)
        for index, label in enumerate(labels):
            add(f"sweep-{index}-{terms}", f"in the sweep {label} alone", smooth * (sweep == index)[:, None])
    for value in _distinct(frequency):
        at = np.abs(np.log(frequency / value)) < _SAME
        if len(np.unique(sweep[at])) < 2:
            continue
        for which, quantity in enumerate(("magnitude", "phase")):
            spike = (at & (coordinate == which)).astype(float)
            if np.any(spike):
                add(
                    f"line-{value:.4g}-{quantity}", f"in the {quantity} at {value:.3g} Hz in all sweeps", spike[:, None]
                )
    return found, places


def _smooth(
    frequency: Float[np.ndarray, " n"], coordinate: Int[np.ndarray, " n"], terms: int
) -> Float[np.ndarray, "n q"]:
    """Cosines along the logarithm of frequency, for each coordinate by itself."""
    logarithm = np.log(frequency)
    x = (logarithm - logarithm.min()) / max(np.ptp(logarithm), 1e-300)
    waves = np.cos(np.pi * np.arange(terms)[None, :] * x[:, None])
    parts = [waves * (coordinate == which)[:, None] for which in np.unique(coordinate)]
    return np.concatenate(parts, axis=1)


def _distinct(frequency: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    ordered = np.sort(frequency)
    starts = np.concatenate([[True], np.diff(np.log(ordered)) > _SAME])
    return ordered[starts]
