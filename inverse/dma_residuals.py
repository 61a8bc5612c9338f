"""How a fit compares a modelled modulus with a measured one: in logarithm or linearly, with or without phase."""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from inverse.datasets.dma import DmaData


class Observations(eqx.Module):
    """One sweep in the coordinates of a residual, padded to the length of the longest sweep.

    Attributes:
        angular_frequency: [rad/s].
        observed: Two coordinates of each measurement; the second is unused without phase.
        weights: One over the standard deviation of each coordinate, 0 for padding.
        has_phase: Whether the second coordinate was measured.
    """

    angular_frequency: Float[Array, " points"] | Float[np.ndarray, " points"]
    observed: Float[Array, "points 2"] | Float[np.ndarray, "points 2"]
    weights: Float[Array, "points 2"] | Float[np.ndarray, "points 2"]
    has_phase: bool = eqx.field(static=True)

    @property
    def in_use(self) -> Bool[np.ndarray, " residuals"]:
        """Which entries of the residual vector are measurements."""
        return np.asarray(self.weights).ravel() > 0.0


class ModulusResidual(eqx.Module):
    """Coordinates in which model and measurement are compared."""

    name: eqx.AbstractVar[str]

    @abc.abstractmethod
    def coordinates(self, modulus: Complex[Array, " points"], has_phase: bool) -> Float[Array, "points 2"]:
        """Coordinates of a modelled modulus [Pa]; the second is 0 without phase."""

    @abc.abstractmethod
    def standard_deviations(self, data: DmaData) -> Float[np.ndarray, "points 2"] | None:
        """Standard deviations of the coordinates of measurements, or None where the data give none."""

    def observations(self, data: DmaData, length: int) -> Observations:
        """Measurements in these coordinates, padded to `length` points of no weight."""
        size = len(data)
        if data.storage_modulus is not None and data.loss_modulus is not None:
            modulus = data.storage_modulus + 1j * data.loss_modulus
        else:
            modulus = data.modulus_magnitude + 0j
        observed = np.asarray(self.coordinates(jnp.asarray(modulus), data.has_phase))
        deviations = self.standard_deviations(data)
        weights = self.default_weights(data) if deviations is None else 1.0 / deviations
        weights = weights * np.array([1.0, 1.0 if data.has_phase else 0.0])[None, :]
        padding = ((0, length - size), (0, 0))
        return Observations(
            np.pad(2.0 * np.pi * data.frequency_hz, padding[0], constant_values=1.0),
            np.pad(observed, padding),
            np.pad(weights, padding),
            data.has_phase,
        )

    def default_weights(self, data: DmaData) -> Float[np.ndarray, "points 2"]:
        """Weights where no standard deviations are known."""
        return np.ones((len(data), 2))

    def __call__(self, modulus: Complex[Array, " points"], data: Observations) -> Float[Array, " residuals"]:
        """Weighted differences, model minus measurement."""
        return jnp.ravel(data.weights * (self.coordinates(modulus, data.has_phase) - data.observed))


class LogModulus(ModulusResidual):
    """Logarithm of the magnitude, and phase [rad]: every frequency counts by its relative error."""

    name: str = eqx.field(static=True, default="log")

    def coordinates(self, modulus: Complex[Array, " points"], has_phase: bool) -> Float[Array, "points 2"]:
        """Logarithm of the magnitude and phase."""
        squared = modulus.real**2 + modulus.imag**2
        vanishes = squared == 0.0
        magnitude = 0.5 * jnp.log(jnp.where(vanishes, jnp.finfo(squared.dtype).tiny, squared))
        if not has_phase:
            return jnp.stack([magnitude, jnp.zeros_like(magnitude)], axis=-1)
        phase = jnp.arctan2(modulus.imag, jnp.where(vanishes, 1.0, modulus.real))
        return jnp.stack([magnitude, phase], axis=-1)

    def standard_deviations(self, data: DmaData) -> Float[np.ndarray, "points 2"] | None:
        """First-order propagation from the deviations of storage and loss modulus, or of the magnitude."""
        squared = data.modulus_magnitude**2
        if data.has_phase and data.storage_modulus_sd is not None and data.loss_modulus_sd is not None:
            along = np.hypot(data.storage_modulus * data.storage_modulus_sd, data.loss_modulus * data.loss_modulus_sd)
            across = np.hypot(data.loss_modulus * data.storage_modulus_sd, data.storage_modulus * data.loss_modulus_sd)
            return np.stack([along, across], axis=-1) / squared[:, None]
        if data.modulus_magnitude_sd is not None and not data.has_phase:
            deviation = data.modulus_magnitude_sd / data.modulus_magnitude
            return np.stack([deviation, np.ones_like(deviation)], axis=-1)
        return None


class LinearModulus(ModulusResidual):
    """Storage and loss modulus, or magnitude [Pa]: the stiffest frequencies count most."""

    name: str = eqx.field(static=True, default="linear")

    def coordinates(self, modulus: Complex[Array, " points"], has_phase: bool) -> Float[Array, "points 2"]:
        """Storage and loss modulus, or the magnitude."""
        if has_phase:
            return jnp.stack([modulus.real, modulus.imag], axis=-1)
        squared = modulus.real**2 + modulus.imag**2
        vanishes = squared == 0.0
        magnitude = jnp.where(vanishes, 0.0, jnp.sqrt(jnp.where(vanishes, 1.0, squared)))
        return jnp.stack([magnitude, jnp.zeros_like(magnitude)], axis=-1)

    def standard_deviations(self, data: DmaData) -> Float[np.ndarray, "points 2"] | None:
        """The deviations that the data give."""
        if data.has_phase and data.storage_modulus_sd is not None and data.loss_modulus_sd is not None:
            return np.stack([data.storage_modulus_sd, data.loss_modulus_sd], axis=-1)
        if data.modulus_magnitude_sd is not None and not data.has_phase:
            return np.stack([data.modulus_magnitude_sd, np.ones(len(data))], axis=-1)
        return None

    def default_weights(self, data: DmaData) -> Float[np.ndarray, "points 2"]:
        """One over the geometric mean of the magnitudes, so that residuals are of order one."""
        scale = np.exp(np.mean(np.log(data.modulus_magnitude)))
        return np.full((len(data), 2), 1.0 / scale)
