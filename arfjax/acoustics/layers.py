"""Flat layers across the axis, and what passes from one to the next."""

import equinox as eqx
import jax.numpy as jnp

from arfjax.media import AcousticMedium, Scalar

SAME_POSITION = 1e-9
"""Positions closer than this are one position [m]; it absorbs the rounding of summed thicknesses."""


class AcousticLayer(eqx.Module):
    """A flat layer across the axis.

    Attributes:
        medium: What it is made of.
        thickness: Along the axis [m]; the first layer's is counted from the bowl's apex.
    """

    medium: AcousticMedium
    thickness: float = eqx.field(static=True)


def transmission(before: AcousticMedium, after: AcousticMedium, *, reflects: bool = True) -> Scalar:
    """Pressure transmission coefficient at normal incidence, 2 Z2 / (Z1 + Z2) [1].

    Without reflection it is the square root of Z2 / Z1, with which all power passes.
    """
    impedance_before = before.density * before.sound_speed
    impedance_after = after.density * after.sound_speed
    if not reflects:
        return jnp.sqrt(impedance_after / impedance_before)
    return 2.0 * impedance_after / (impedance_before + impedance_after)
