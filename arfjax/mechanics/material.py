"""Liver with a lesion in it, at the Gauss points of a mesh."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.mechanics.viscoelastic import (
    ModulusReading,
    ViscoelasticField,
    prony_of,
    viscoelastic_field,
)
from arfjax.media import FractionalZener, Scalar, Zener

_SMALLEST_AXIS = 1e-9
"""Semi-axis [m] that stands for none: far below the distance from the axis to the nearest Gauss point."""


def ellipsoid_depth(
    r: Float[np.ndarray, " rq"], z: Float[np.ndarray, " zq"], *, length: Scalar, diameter: Scalar, centre: Scalar
) -> Float[Array, "rq zq"]:
    """Depth of points in an ellipsoid on the axis: 1 at its centre, falling linearly to 0 at its edge, 0 outside.

    Args:
        r: Radial positions [m].
        z: Axial positions [m].
        length: Of the ellipsoid along the axis, tip to tip [m]; 0 for none.
        diameter: Across the axis [m]; 0 for none.
        centre: Axial position of its centre [m].
    """
    across = r[:, None] / jnp.maximum(0.5 * diameter, _SMALLEST_AXIS)
    along = (z[None, :] - centre) / jnp.maximum(0.5 * length, _SMALLEST_AXIS)
    return jnp.maximum(1.0 - jnp.hypot(across, along), 0.0)


def liver_with_lesion(
    liver: Zener | FractionalZener,
    lesion: Zener | FractionalZener,
    depth: Float[Array, "rq zq"],
    *,
    density: Scalar,
    reading: ModulusReading,
    poisson_ratio: Scalar,
) -> ViscoelasticField:
    """Material whose every constant goes linearly from the liver's to the lesion's with the depth in the lesion.

    The bulk modulus follows from Poisson's ratio and the instantaneous modulus: the paper states the former and not
    which modulus it goes with; for the displacement it makes less than 0.4 percent points.

    Args:
        liver: Constants outside the lesion.
        lesion: Constants at the lesion's centre; the same kind of solid.
        depth: Depth in the lesion at the Gauss points, from 0 (outside) to 1 (centre).
        density: [kg/m^3].
        reading: Whether the moduli are Young's or shear moduli.
        poisson_ratio: [1].
    """
    if type(liver) is not type(lesion):
        raise InputError(
            f"liver is a {type(liver).__name__} and the lesion a {type(lesion).__name__}: "
            "give both the same kind of solid."
        )
    solid = jax.tree.map(lambda outside, inside: outside + (inside - outside) * depth, liver, lesion)
    return viscoelastic_field(
        prony_of(solid),
        (depth.shape[0], depth.shape[1]),
        density=density,
        bulk_modulus=reading.bulk_modulus(solid.unrelaxed_modulus, poisson_ratio),
        reading=reading,
        poisson_ratio=poisson_ratio,
    )
