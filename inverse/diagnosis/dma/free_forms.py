"""Corrections of no name to a dynamic mechanical analysis: one for each place in which a model of it can be wrong."""

import numpy as np
from jaxtyping import Complex, Float, Int

from inverse.datasets.dma import frequency_groups
from inverse.datasets.dma_checks import SWEEP_GAP
from inverse.diagnosis.free_forms import COARSE, FINE, LENGTHS, Place, process
from inverse.diagnosis.projection import unit_columns
from inverse.diagnosis.screening import Alternative

MOST_TERMS = 100
"""Directions of one correction beyond which it takes more time than it is worth."""


def dma_free_forms(
    frequency: Float[np.ndarray, " n"],
    temperature: Float[np.ndarray, " n"],
    sweep: Int[np.ndarray, " n"],
    coordinate: Int[np.ndarray, " n"],
    labels: tuple[str, ...],
    modulus: Complex[np.ndarray, " n"],
    times: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]],
) -> tuple[list[Alternative], list[Place]]:
    """Free forms for dynamic mechanical analysis: one for each place in which a model of it can be wrong.

    The material: a correction common to all sweeps, one that grows with temperature, one of each sweep (all smooth in
    the logarithm of frequency), alone and of all in their own ways, and one that follows the stiffness. The
    instrument: a stiffness added to the sample's and a factor of it, as power series of frequency and smooth. The
    procedure: corrections that follow time. And one at a single frequency of all sweeps.

    Args:
        frequency: Of each residual [Hz].
        temperature: Of each residual [degC].
        sweep: Index of its sweep.
        coordinate: 0 for the magnitude, 1 for the phase.
        labels: Of the sweeps.
        modulus: That the model predicts.
        times: Share of the visit that had passed, and of the sample's drying.
    """
    found, places = [], []

    def add(name: str, words: str, directions: Float[np.ndarray, "n q"]) -> None:
        found.append(Alternative(name, directions))
        places.append(Place(name, words))

    def relative(functions: Complex[np.ndarray, "n q"]) -> Float[np.ndarray, "n q2"]:
        """Changes of the logarithm of the modulus by functions with complex coefficients."""
        both = np.concatenate([functions, 1j * functions], axis=1)
        return np.where((coordinate == 0)[:, None], both.real, both.imag)

    many, warmed = len(labels) > 1, float(np.ptp(temperature))
    for length in LENGTHS:
        smooth = _smooth(frequency, coordinate, length)
        if many:
            add(f"smooth-{length:g}", "in all sweeps alike, smoothly along frequency", smooth)
        if many and warmed > SWEEP_GAP:
            slope = 2.0 * (temperature - temperature.min()) / warmed - 1.0
            add(f"trend-{length:g}", "growing with temperature, smoothly along frequency", slope[:, None] * smooth)
        for index, label in enumerate(labels):
            add(f"sweep-{index}-{length:g}", f"in the sweep {label} alone", smooth * (sweep == index)[:, None])
    if many:
        _add_of_many(add, relative, frequency, sweep, coordinate, len(labels), modulus, times)
    groups = frequency_groups(frequency)
    for group in range(1 + int(groups.max())):
        at = groups == group
        value = float(np.min(frequency[at]))
        if len(np.unique(sweep[at])) < 2:
            continue
        for which, quantity in enumerate(("magnitude", "phase")):
            spike = (at & (coordinate == which)).astype(float)
            if np.any(spike):
                add(
                    f"line-{value:.4g}-{quantity}", f"in the {quantity} at {value:.3g} Hz in all sweeps", spike[:, None]
                )
    return found, places


def _add_of_many(add, relative, frequency, sweep, coordinate, count, modulus, times) -> None:
    """Free forms that take several sweeps to tell from the material's constants."""
    for length in LENGTHS:
        smooth = _smooth(frequency, coordinate, length)
        if count * smooth.shape[1] > MOST_TERMS:
            continue
        each = [smooth * (sweep == index)[:, None] for index in range(count)]
        add(f"each-{length:g}", "in each sweep in its own way, smoothly along frequency", np.concatenate(each, axis=1))
    powers = np.stack([frequency / frequency.max(), (frequency / frequency.max()) ** 2], axis=-1)
    smooth, size = process(np.log(frequency), COARSE), np.abs(modulus)
    softness = (size.min() / modulus)[:, None]
    add(
        "added-power",
        "as a stiffness added to the sample's that grows with frequency",
        unit_columns(relative(softness * powers)),
    )
    add("added-smooth", "as a stiffness added to the sample's, smoothly along frequency", relative(softness * smooth))
    add("factor-power", "as a factor that grows with frequency", unit_columns(relative(powers + 0j)))
    stiffness = (size / size.max())[:, None]
    add("force-smooth", "growing with the force, smoothly along frequency", relative(stiffness * smooth + 0j))
    add("stiffness", "following the stiffness", relative(process(np.log(size), COARSE) + 0j))
    add("time-in-visit", "following the time since the sweep began", relative(process(times[0], COARSE) + 0j))
    add("time-of-drying", "following the time of the sample", relative(process(times[1], FINE) + 0j))


def _smooth(
    frequency: Float[np.ndarray, " n"], coordinate: Int[np.ndarray, " n"], length: float
) -> Float[np.ndarray, "n q"]:
    """A process along the logarithm of frequency, for each coordinate by itself."""
    waves = process(np.log(frequency), length)
    parts = [waves * (coordinate == which)[:, None] for which in np.unique(coordinate)]
    return np.concatenate(parts, axis=1)
