"""Periodic motion as a sum of harmonics: its course, and between what values it swings."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float


@jax.jit
def peak_to_peak(amplitudes: Complex[Array, "harmonic *space"]) -> Float[Array, "*space"]:
    """Largest less smallest value over a period of Re(sum of amplitude_n exp(+i n phase)).

    Accuracy: rounding (extremes among 16 samples for each harmonic, then Newton's method); twice the magnitude where
        there is one harmonic only.
    Differentiability: in the amplitudes, where highest and lowest value are each reached once.
    """
    if len(amplitudes) == 1:
        return 2.0 * jnp.abs(amplitudes[0])
    n_samples = 16 * len(amplitudes)
    phases = jnp.asarray(2.0 * np.pi * np.arange(n_samples) / n_samples)
    held = jax.lax.stop_gradient(amplitudes)
    sampled = jax.lax.map(lambda phase: sum_of_harmonics(held, jnp.broadcast_to(phase, held.shape[1:])), phases)
    highest, lowest = (
        sum_of_harmonics(amplitudes, _extreme(held, phases[pick(sampled, axis=0)], 2.0 * np.pi / n_samples))
        for pick in (jnp.argmax, jnp.argmin)
    )
    return highest - lowest


def sum_of_harmonics(
    amplitudes: Complex[Array, "harmonic *space"], phase: Float[Array, "*point"]
) -> Float[Array, "*point"]:
    """Re(sum of amplitude_n exp(+i n phase)) at phases [rad]: as many as there are points, or any of one point."""
    order = jnp.arange(1.0, len(amplitudes) + 1.0).reshape((-1,) + (1,) * phase.ndim)
    amplitudes = amplitudes.reshape(amplitudes.shape + (1,) * (phase.ndim + 1 - amplitudes.ndim))
    return jnp.sum((amplitudes * jnp.exp(1j * order * phase[None])).real, axis=0)


def _extreme(
    amplitudes: Complex[Array, "harmonic *space"], start: Float[Array, "*space"], spacing: float
) -> Float[Array, "*space"]:
    # Phase at which the slope vanishes, by Newton's method from the best sample, and never far from it.
    turn = 1j * jnp.arange(1.0, len(amplitudes) + 1.0).reshape((-1,) + (1,) * start.ndim)

    def step(_: object, phase: Array) -> Array:
        slope, curvature = sum_of_harmonics(amplitudes * turn, phase), sum_of_harmonics(amplitudes * turn**2, phase)
        flat = curvature == 0.0
        moved = phase - jnp.where(flat, 0.0, slope / jnp.where(flat, 1.0, curvature))
        return jnp.clip(moved, start - spacing, start + spacing)

    return jax.lax.fori_loop(0, 6, step, start)
