"""Data finer than any instrument resolves, such as those of a simulation, made as coarse as the best one."""

import dataclasses
from collections.abc import Callable

import numpy as np

from inverse.datasets.dma import DmaData
from inverse.diagnosis.diagnosis import Diagnosis

RESOLUTION = 1e-4
"""Relative scatter of a modulus [1], and of its phase [rad], below which nothing was measured: the finest instruments
state a hundredth of a percent."""
_REMARK = (
    f"The model, or the model with a cause in it, meets the data to less than {100.0 * RESOLUTION:g} %, which no "
    "instrument resolves: they look simulated. Noise of that size, drawn by the seed, was added to them, so that their "
    "rounding is not examined."
)


def diagnosed_as_measured(
    data: DmaData, diagnose: Callable[[DmaData], Diagnosis], seed: int
) -> tuple[DmaData, Diagnosis, tuple[str, ...]]:
    """The diagnosis of a DMA, or of it made as coarse as a measurement if it is finer.

    Args:
        data: From `read_dma`.
        diagnose: Says what is wrong with it.
        seed: Of the noise.

    Returns:
        What was diagnosed, the diagnosis, and what is to be remarked on the data.
    """
    found = diagnose(data)
    if not _is_finer(found):
        return data, found, ()
    coarse = as_measured(data, seed)
    return coarse, diagnose(coarse), (_REMARK,)


def _is_finer(found: Diagnosis) -> bool:
    """Whether the model, or the model with a cause in it, meets the data more closely than an instrument resolves.

    What is left is the rounding of the numbers then, in which a test at any level finds what is no physics.
    """
    if found.decision is None:
        return False
    refits = [one.refit.residuals for one in found.causes if one.refit is not None and one.converged]
    weights = found.problem.weights.ravel()
    return any(np.sqrt(np.mean((left / weights) ** 2)) < RESOLUTION for left in (found.residuals, *refits))


def as_measured(data: DmaData, seed: int) -> DmaData:
    """The same data with normal noise of `RESOLUTION` in magnitude and phase.

    Args:
        data: From `read_dma`.
        seed: Of the noise.
    """
    noise = RESOLUTION * np.random.default_rng([seed, 20261129]).standard_normal((len(data), 2))
    if data.storage_modulus is None or data.loss_modulus is None:
        return dataclasses.replace(data, modulus_magnitude=data.modulus_magnitude * np.exp(noise[:, 0]))
    modulus = (data.storage_modulus + 1j * data.loss_modulus) * np.exp(noise[:, 0] + 1j * noise[:, 1])
    return dataclasses.replace(
        data, modulus_magnitude=np.abs(modulus), storage_modulus=modulus.real, loss_modulus=modulus.imag
    )
