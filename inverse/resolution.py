"""Data finer than any instrument resolves, such as those of a simulation, made as coarse as the best one."""

import dataclasses

import numpy as np

from inverse.datasets.dma import DmaData
from inverse.diagnosis.diagnosis import Diagnosis

RESOLUTION = 1e-4
"""Relative scatter of a modulus [1], and of its phase [rad], below which nothing was measured: the finest instruments
state a hundredth of a percent."""


def is_finer_than_measured(found: Diagnosis) -> bool:
    """Whether the model, or the model with a cause in it, meets a DMA more closely than an instrument resolves.

    What is left is the rounding of the numbers then, in which a test at any level finds what is no physics.

    Args:
        found: What a diagnosis says of the data.
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


def remark_on() -> str:
    """What a report says of data that were made coarser."""
    return (
        f"The model meets the data to less than {100.0 * RESOLUTION:g} %, which no instrument resolves: they look "
        "simulated. Noise of that size, drawn by the seed, was added to them, so that their rounding is not examined."
    )
