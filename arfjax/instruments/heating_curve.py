"""What is done to a curve of readings over temperature: averaging, normalising, and what that does to its errors.

Both are followed by the covariance of the readings, because both make errors of different readings depend on one
another: neighbours share samples of a moving mean, and all share the reading that they were divided by.
"""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.errors import InputError, as_known
from arfjax.media import Scalar

Readings = Float[Array, "_"] | Float[np.ndarray, "_"]
Covariance = Float[Array, "_ _"] | Float[np.ndarray, "_ _"]


def moving_mean(
    values: Float[Array, "*batch sample"] | Float[np.ndarray, "*batch sample"], n_averaged: int
) -> Float[Array, "*batch mean"]:
    """Means over so many successive values, without those that reach beyond the ends: n_averaged - 1 fewer.

    Take temperatures with their readings: the mean of a straight line is the value at the mean. The noise of
    independent values falls as the square root of their number.

    Raises:
        InputError: if there are fewer values than are to be averaged, or none is.
    """
    count = values.shape[-1] - n_averaged + 1
    if n_averaged < 1 or count < 1:
        raise InputError(f"`n_averaged` must lie in 1 to {values.shape[-1]}, the number of values, got {n_averaged}.")
    values = jnp.asarray(values)
    return sum((values[..., first : first + count] for first in range(1, n_averaged)), values[..., :count]) / n_averaged


def moving_mean_covariance(covariance: Covariance, n_averaged: int) -> Float[Array, "mean mean"]:
    """Covariance of `moving_mean` from that of the values; exact."""
    return moving_mean(moving_mean(covariance, n_averaged).T, n_averaged)


def normalised_curve(
    temperature: Readings, curve: Readings, *, reference_temperature: Scalar
) -> Float[Array, " sample"]:
    """Readings over their own value at a temperature, which is linear between the two readings about it.

    Average noisy readings first: the noise of the reference is on every value of the curve.

    Args:
        temperature: Of each reading [degC], ascending.
        curve: Readings of any unit.
        reference_temperature: At which the curve becomes 1 [degC].

    Raises:
        InputError: if temperatures do not ascend, or the reference lies outside of them (where not traced).

    Differentiability: in all, with a jump of slope in temperatures where the reference is one of them.
    """
    values = jnp.asarray(curve)
    return values / (_weights_at(temperature, curve, reference_temperature) @ values)


def normalised_covariance(
    temperature: Readings, curve: Readings, covariance: Covariance, *, reference_temperature: Scalar
) -> Float[Array, "sample sample"]:
    r"""Covariance of `normalised_curve` from that of the readings, to first order in their errors.

    With n = y / y_ref and the weights w of y_ref, the curve's derivative is $J = (1 - n w^T) / y_{ref}$, and this is
    $J C J^T$. It has a zero direction (w): where a reading lies at the reference, it is 1 without any error.

    Args:
        temperature: Of each reading [degC], ascending; its errors are not looked at.
        curve: Readings of any unit.
        covariance: Of the readings, in that unit squared.
        reference_temperature: At which the curve becomes 1 [degC].

    Raises:
        InputError: as `normalised_curve`, or if the covariance is of another shape.

    Accuracy: what is left out is of second order in the relative error of the reference.
    """
    if covariance.shape != (len(curve), len(curve)):
        raise InputError(f"`covariance` has shape {covariance.shape} for {len(curve)} readings; pass a square one.")
    weights = _weights_at(temperature, curve, reference_temperature)
    reference = weights @ jnp.asarray(curve)
    jacobian = (jnp.eye(len(curve)) - (curve / reference)[:, None] * weights[None, :]) / reference
    return jacobian @ jnp.asarray(covariance) @ jacobian.T


def _weights_at(temperature: Readings, curve: Readings, reference: Scalar) -> Float[Array, " sample"]:
    _require_curve(temperature, curve, reference)
    temperature = jnp.asarray(temperature)
    last = jnp.clip(jnp.searchsorted(temperature, reference), 1, len(temperature) - 1)
    low, high = temperature[last - 1], temperature[last]
    share = (reference - low) / (high - low)
    return jnp.zeros(len(temperature)).at[last - 1].set(1.0 - share).at[last].set(share)


def _require_curve(temperature: Readings, curve: Readings, reference: Scalar) -> None:
    if temperature.shape != curve.shape or len(curve) < 2:
        raise InputError(
            f"`temperature` and `curve` must be of one length, 2 or more, got {len(temperature)} and {len(curve)}."
        )
    temperature, reference = as_known(temperature), as_known(reference)
    if isinstance(temperature, Tracer) or isinstance(reference, Tracer):
        return
    if not (np.all(np.diff(temperature) > 0.0) and np.isfinite(temperature[-1])):
        raise InputError("`temperature` must ascend and be finite [degC]; sort the readings, or average them first.")
    if not temperature[0] <= reference <= temperature[-1]:
        raise InputError(
            f"`reference_temperature` is {reference:g} degC, the curve reaches from {temperature[0]:g} to "
            f"{temperature[-1]:g} degC. Kelvin? Pass degC; or normalise at a temperature that was measured."
        )
