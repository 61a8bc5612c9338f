"""Weights with which an instrument averages the cells of an axisymmetric field over the region that it senses.

A reading is linear in the field, so that an instrument is a field of weights whose sum is 1. Between cell centres the
field is interpolated by cubics in z and in r^2. A smooth axisymmetric field is a smooth function of r^2, also at the
axis, and r^2 of a point is a smooth function of its coordinates: no square root, no kink, no special case there.
"""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.errors import InputError, lies_within
from arfjax.grid import AxisymmetricGrid
from arfjax.media import Scalar
from arfjax.numerics.interpolation import interpolation_weights

Positions = Float[Array, " point"]
Shares = Float[Array, " point"] | Float[np.ndarray, " point"]

_LARGEST = float(np.finfo(float).max)


def point_weights(squared_radius: Positions, z: Positions, shares: Shares, grid: AxisymmetricGrid) -> Array:
    """Weights (r, z) of the mean over points in space, at r^2 = `squared_radius` [m^2] and z [m].

    Args:
        squared_radius: Squared distance of each point from the axis [m^2].
        z: Axial position of each point [m].
        shares: Share of each point in the mean; they sum to 1.
        grid: Where the cells lie.

    Accuracy: fourth order in the cell size for fields that are smooth between cells; outside the outermost cell
    centres the last cubic is continued.
    Differentiability: in the positions, with jumps of slope of third order at cell centres.
    """
    radial, axial = interpolation_weights(squared_radius, grid.r**2), interpolation_weights(z, grid.z)
    return jnp.einsum("p,pr,pz->rz", jnp.asarray(shares), radial, axial)


def radial_weights(squared_radius: Positions, shares: Shares, grid: AxisymmetricGrid) -> Float[Array, " r"]:
    """Weights of the mean over points of one plane z = const; see `point_weights`."""
    return jnp.asarray(shares) @ interpolation_weights(squared_radius, grid.r**2)


def axial_weights(z: Positions, shares: Shares, grid: AxisymmetricGrid) -> Float[Array, " z"]:
    """Weights of the mean over points of one line r = const; see `point_weights`."""
    return jnp.asarray(shares) @ interpolation_weights(z, grid.z)


def mean_over(weights: Float[Array, "r z"], values: Float[Array, "*batch r z"]) -> Float[Array, "*batch"]:
    """Mean of a field over the region that the weights stand for."""
    return jnp.einsum("...rz,rz->...", values, weights)


def require(name: str, value: Scalar, unit: str, *, least: float = -np.inf, above: bool = False) -> None:
    """Refuse a number that is not finite, or below `least` (with `above`: not above it); traced numbers pass.

    Raises:
        InputError: what it is, what it must be.
    """
    if lies_within(value, max(least, -_LARGEST), _LARGEST, above=above):
        return
    bound = "" if least == -np.inf else f" {'above' if above else 'not below'} {least:g}"
    raise InputError(f"`{name}` must be a finite number{bound} [{unit}], got {np.asarray(value)}; correct it.")


def require_inside(what: str, grid: AxisymmetricGrid, *, radius: Scalar, near: Scalar, far: Scalar) -> None:
    """Refuse a region that reaches beyond the grid; where it is traced, the caller vouches for it.

    Args:
        what: What senses there.
        grid: Where the cells lie.
        radius: Largest distance of the region from the axis [m].
        near: Its lowest z [m].
        far: Its highest z [m].

    Raises:
        InputError: where the region lies and where the grid does.
    """
    ends = (grid.z_faces[0], grid.z_faces[-1])
    require_within(what, "grid", ends, grid.r_faces[-1], radius=radius, near=near, far=far)


def require_within(
    what: str,
    where: str,
    ends: tuple[Scalar | np.floating, Scalar | np.floating],
    edge: Scalar | np.floating,
    *,
    radius: Scalar,
    near: Scalar,
    far: Scalar,
) -> None:
    """Refuse a region that reaches beyond what is known between two z, `ends`, and up to the radius `edge`.

    Args:
        what: What senses there.
        where: What the field is known on.
        ends: Its lowest and highest z [m].
        edge: Its largest radius [m].
        radius: Largest distance of the region from the axis [m].
        near: Its lowest z [m].
        far: Its highest z [m].

    Raises:
        InputError: where the region lies and where the field is known; nothing where any of that is traced.
    """
    if any(isinstance(value, Tracer) for value in (radius, near, far, edge, *ends)):
        return
    first, last = ends
    if not (near >= first and far <= last and radius <= edge):
        raise InputError(
            f"the {what} reaches from z = {near:g} to {far:g} m and to r = {radius:g} m, the {where} only from "
            f"z = {first:g} to {last:g} m and to r = {edge:g} m. Millimetres? Pass metres; or enlarge the {where}."
        )


def require_field(name: str, shape: tuple[int, ...], grid: AxisymmetricGrid) -> None:
    """Refuse values whose last two axes are not the cells of the grid."""
    if shape[-2:] != grid.shape:
        raise InputError(f"`{name}` has shape {shape}, the grid has {grid.shape} cells (r, z); pass the field's grid.")
