"""Periodic motion as a sum of harmonics: its course, and between what values it swings."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

_SAMPLES_PER_HARMONIC = 32
_STEPS = 8
_TERMS = 10  # of Taylor's series between two samples, where it is good to rounding: 0.2^10 / 10!


@jax.jit
def peak_to_peak(amplitudes: Complex[Array, "harmonic *space"]) -> Float[Array, "*space"]:
    """Largest less smallest value over a period of Re(sum of amplitude_n exp(+i n phase)).

    Accuracy: rounding. Every crest is found between two of 32 samples for each harmonic, at which the course rises and
        falls, and by Newton's method; of more crests in one such place the first and the last. Twice the magnitude
        where there is one harmonic only.
    Differentiability: in the amplitudes, where highest and lowest value are each reached once.
    """
    if len(amplitudes) == 1:
        return 2.0 * jnp.abs(amplitudes[0])
    held = jax.lax.stop_gradient(amplitudes)
    highest, lowest = (sum_of_harmonics(amplitudes, _highest(sign * held)) for sign in (1.0, -1.0))
    return highest - lowest


def sum_of_harmonics(
    amplitudes: Complex[Array, "harmonic *space"], phase: Float[Array, "*point"]
) -> Float[Array, "*point"]:
    """Re(sum of amplitude_n exp(+i n phase)) at phases [rad]: as many as there are points, or any of one point."""
    order = jnp.arange(1.0, len(amplitudes) + 1.0).reshape((-1,) + (1,) * phase.ndim)
    amplitudes = amplitudes.reshape(amplitudes.shape + (1,) * (phase.ndim + 1 - amplitudes.ndim))
    return jnp.sum((amplitudes * jnp.exp(1j * order * phase[None])).real, axis=0)


def _highest(amplitudes: Complex[Array, "harmonic *space"]) -> Float[Array, "*space"]:
    """Phase of the highest value."""
    n = len(amplitudes)
    n_samples = _SAMPLES_PER_HARMONIC * n
    spacing = 2.0 * np.pi / n_samples
    crested = _crested(amplitudes, n_samples)
    count = jnp.cumsum(crested, axis=0)

    def climb(number: Array, best: tuple[Array, Array]) -> tuple[Array, Array]:
        low = spacing * jnp.argmax(crested & (count == number + 1), axis=0)
        value, share = _crest(_series(amplitudes, low, spacing))
        higher = value > best[0]
        return jnp.where(higher, value, best[0]), jnp.where(higher, low + share * spacing, best[1])

    start = jnp.zeros(amplitudes.shape[1:], amplitudes.real.dtype)
    return jax.lax.fori_loop(0, jnp.max(count[-1], initial=0), climb, (start - jnp.inf, start))[1]


def _crested(amplitudes: Complex[Array, "harmonic *space"], n_samples: int) -> Bool[Array, "sample *space"]:
    """Whether the course rises at a sample and no longer does at the next one."""
    order = np.arange(1, len(amplitudes) + 1)
    turns = 2.0 * np.pi / n_samples * np.outer(np.arange(n_samples), order)
    real, imaginary = (
        jnp.asarray(order * each, dtype=amplitudes.real.dtype) for each in (np.sin(turns), np.cos(turns))
    )
    slope = -jnp.tensordot(real, amplitudes.real, 1) - jnp.tensordot(imaginary, amplitudes.imag, 1)
    return (slope > 0.0) & (jnp.roll(slope, -1, axis=0) <= 0.0)


def _series(amplitudes: Complex[Array, "harmonic *space"], low: Float[Array, "*space"], spacing: float) -> list[Array]:
    """Taylor's coefficients of the course about `low`, in shares of the spacing."""
    order = np.arange(1.0, len(amplitudes) + 1.0)
    turned = amplitudes * jnp.exp(1j * order.reshape((-1,) + (1,) * low.ndim) * low[None])
    factors = [(1j * spacing * order) ** k / math.factorial(k) for k in range(_TERMS)]
    return list(jnp.tensordot(jnp.asarray(np.stack(factors), dtype=turned.dtype), turned, 1).real)


def _crest(series: list[Array]) -> tuple[Array, Array]:
    """Highest value of a polynomial between 0 and 1, and where, by Newton's method from either end."""
    slopes = [k * each for k, each in enumerate(series)][1:]
    curvatures = [k * each for k, each in enumerate(slopes)][1:]

    def step(_: object, place: Array) -> Array:
        slope, curvature = _polynomial(slopes, place), _polynomial(curvatures, place)
        # Where the course is hollow Newton's method would walk into the valley.
        bent = curvature < 0.0
        moved = jnp.where(bent, -slope / jnp.where(bent, curvature, -1.0), 0.25 * jnp.sign(slope))
        return jnp.clip(place + moved, 0.0, 1.0)

    first, last = (jax.lax.fori_loop(0, _STEPS, step, jnp.full_like(series[0], end)) for end in (0.0, 1.0))
    low, high = _polynomial(series, first), _polynomial(series, last)
    return jnp.maximum(low, high), jnp.where(low < high, last, first)


def _polynomial(coefficients: list[Array], place: Array) -> Array:
    return functools.reduce(lambda total, each: total * place + each, reversed(coefficients))
