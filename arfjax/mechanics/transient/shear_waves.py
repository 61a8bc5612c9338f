"""What an imaging system tracks in a push: when the shear wave passes, how fast it runs, how the tissue is strained."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError

_AT_THE_EDGE = 2
"""Samples from either end of a course within which a highest value is no arrival: the wave may not have passed."""


def arrival_times(
    time: Float[Array, " time"], displacement: Float[Array, "time *position"]
) -> Float[Array, "*position"]:
    """When displacement is largest at each position [s]: the time to peak of shear-wave tracking.

    A parabola through the highest sample and its neighbours places the peak between samples.

    Args:
        time: Ascending, at least five; spaced as unevenly as they like [s].
        displacement: Along the push [m].

    Returns:
        NaN where the highest value lies at an end of the course: the wave has not passed, or was always there.

    Accuracy: second order in the interval (a tenth of it where the course is smooth over three samples).
    Differentiability: in the displacement, while the highest sample stays the same.
    """
    if len(time) < 5:
        raise InputError(f"`time` needs at least five samples to find a peak in, got {len(time)}.")
    highest = jnp.argmax(displacement, axis=0)
    inside = (highest >= _AT_THE_EDGE) & (highest < len(time) - _AT_THE_EDGE)
    centre = jnp.where(inside, highest, _AT_THE_EDGE)
    before, at, after = (jnp.take_along_axis(displacement, (centre + shift)[None], axis=0)[0] for shift in (-1, 0, 1))
    steps = jnp.diff(jnp.asarray(time))
    step, next_step = steps[centre - 1], steps[centre]
    rise, next_rise = (at - before) / step, (after - at) / next_step
    bend = next_rise - rise
    curved = inside & (bend < 0.0)
    offset = -0.5 * (rise * next_step + next_rise * step) / jnp.where(curved, bend, 1.0)
    return jnp.where(curved, jnp.asarray(time)[centre] + offset, jnp.nan)


def of_one_front(arrival: Float[Array, " r"]) -> Float[Array, " r"]:
    """Arrivals [s] at ascending radii that belong to one wave running out; NaN for the others.

    Before the wave comes, tissue that keeps its volume moves a little as a whole. Where the course ends too early that
    is the largest displacement, and its time falls behind that of positions nearer in: from there on nothing is kept.
    """
    known = jnp.isfinite(arrival)
    latest = jax.lax.cummax(jnp.where(known, arrival, -jnp.inf))
    nearer = jnp.concatenate([jnp.full_like(latest[:1], -jnp.inf), latest[:-1]])
    lost = (~known & (nearer > -jnp.inf)) | (known & (arrival <= nearer))
    return jnp.where(known & (jnp.cumsum(lost) == 0), arrival, jnp.nan)


def shear_wave_speed(r: Float[np.ndarray, " r"], arrival: Float[Array, " r"]) -> Float[Array, ""]:
    """Speed [m/s] of a wave that arrives at radii r [m] at these times [s]: the inverse slope of a straight line.

    Positions without arrival (NaN) are left out; NaN where fewer than three are left.
    """
    known = jnp.isfinite(arrival)
    weight = jnp.where(known, 1.0, 0.0)
    count = jnp.sum(weight)
    times = jnp.where(known, arrival, 0.0)
    radii = jnp.asarray(r, dtype=float)
    mean_r, mean_time = (jnp.sum(weight * each) / jnp.maximum(count, 1.0) for each in (radii, times))
    slope = jnp.sum(weight * (radii - mean_r) * (times - mean_time))
    spread = jnp.sum(weight * (radii - mean_r) ** 2)
    return jnp.where(count >= 3.0, spread / jnp.where(count >= 3.0, slope, 1.0), jnp.nan)


def strain_on_grid(
    r: Float[np.ndarray, " r"], z: Float[np.ndarray, " z"], displacement: Float[Array, "*time r z 2"]
) -> Float[Array, "*time r z 4"]:
    """Strains rr, zz, tt and rz (engineering shear) of a displacement r, z [m] known on a grid from the axis outward.

    Accuracy: second order in the spacings, by differences between neighbours, also where they are uneven.
    Differentiability: linear.
    """
    if r[0] != 0.0 or min(len(r), len(z)) < 3:
        raise InputError(f"strains need three positions or more along r, from the axis, and along z, got {r} and {z}.")
    along_r, along_z = (
        jnp.asarray(np.gradient(np.eye(len(x)), x, axis=0, edge_order=2), displacement.dtype) for x in (r, z)
    )
    radial, axial = displacement[..., 0], displacement[..., 1]
    rr = jnp.einsum("ij,...jz->...iz", along_r, radial)
    over_radius = jnp.asarray(1.0 / np.where(r > 0.0, r, 1.0), displacement.dtype)
    hoop = jnp.einsum("i,...iz->...iz", over_radius, radial).at[..., 0, :].set(rr[..., 0, :])
    zz = jnp.einsum("ij,...rj->...ri", along_z, axial)
    shear = jnp.einsum("ij,...rj->...ri", along_z, radial) + jnp.einsum("ij,...jz->...iz", along_r, axial)
    return jnp.stack([rr, zz, hoop, shear], axis=-1)
