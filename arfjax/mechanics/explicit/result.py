"""What the explicit path gives, how far it can be trusted, and what extrapolation makes of it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.media import Scalar
from arfjax.numerics.interpolation import stencil_weights

_ROUNDING = 1e-4
"""How far beyond its ends, in cells, the grid still holds a position: what single precision makes of metres."""


class ExplicitConvergence(eqx.Module):
    """How far a run can be trusted. Differences to a run of twice the cell sizes and twice the step, over three.

    For a second-order method that is the error of the finer run, and what to subtract from it (`extrapolated`).
    Where the material jumps within a cell the order is lower and the estimate only tells the size.

    Attributes:
        on_axis: Error of the axial displacement on the axis [m], at every other time and every other axial node.
        at_points: Error of the displacement at the points [m], at every other time.
        maps: Error of the maps [m], at every other node along r and z.
        error: Largest of the errors of axial displacement on the axis and at the points over the largest displacement
            there [1]; NaN without an estimate.
        courant_number: Time step over the longest stable one; from 1 on the scheme may be unstable.
    """

    on_axis: Float[Array, "time2 z2"]
    at_points: Float[Array, "time2 point 2"]
    maps: Float[Array, "map r2 z2 2"]
    error: Float[Array, ""]
    courant_number: Float[Array, ""]

    def shortcoming(self, tolerance: float) -> str:
        """What is to be done to get within a relative tolerance, empty if nothing; for concrete values."""
        said = []
        if not float(self.courant_number) <= 1.0:
            said.append(f"the steps are unstable ({self.courant_number:.2g} of the longest stable one): shorten them")
        if np.isnan(float(self.error)):
            said.append("the error of its cells was not estimated: pass `estimate_error=True`")
        elif not float(self.error) <= tolerance:
            said.append(f"the cells are too large (error {self.error:.1e}): halve them, or use `extrapolated`")
        return "; ".join(said)


class ExplicitResult(eqx.Module):
    """Motion during and after a push. Components are r, z; nodes are the faces of the grid.

    Attributes:
        time: [s], the first is 0.
        r: Radii of the nodes [m].
        z: Axial positions of the nodes [m].
        axial_displacement_on_axis: [m]; the first is zero.
        displacement_at_points: [m] at the points asked for, interpolated by cubics; the first is zero.
        map_time: Times of the maps [s].
        maps: Displacement of all nodes [m].
        velocity: Of all nodes at the end [m/s].
        convergence: How far the numbers can be trusted.
    """

    time: Float[Array, " time"]
    r: Float[Array, " r"]
    z: Float[Array, " z"]
    axial_displacement_on_axis: Float[Array, "time z"]
    displacement_at_points: Float[Array, "time point 2"]
    map_time: Float[Array, " map"]
    maps: Float[Array, "map r z 2"]
    velocity: Float[Array, "r z 2"]
    convergence: ExplicitConvergence

    def at_focus(self, z: Scalar) -> Float[Array, " time"]:
        """Axial displacement [m] on the axis at `z` [m], by cubics between the nodes; NaN outside `z[0]` to `z[-1]`."""
        place = jnp.asarray(z, self.z.dtype)
        first, weights = stencil_weights(place[None], self.z)
        near = jax.lax.dynamic_slice_in_dim(self.axial_displacement_on_axis, first[0], weights.shape[1], axis=1)
        rounding = _ROUNDING * (self.z[1] - self.z[0])
        inside = (place >= self.z[0] - rounding) & (place <= self.z[-1] + rounding)
        return (near @ weights[0]) * jnp.where(inside, 1.0, jnp.nan)


def extrapolated(result: ExplicitResult) -> ExplicitResult:
    """The result less its estimated error, at every other time and node: a fifth of it or less where all is smooth.

    The velocity is left as it is, at every other node; the estimate of the error stays that of the finer run.
    """
    error = result.convergence
    return ExplicitResult(
        time=result.time[::2],
        r=result.r[::2],
        z=result.z[::2],
        axial_displacement_on_axis=result.axial_displacement_on_axis[::2, ::2] - error.on_axis,
        displacement_at_points=result.displacement_at_points[::2] - error.at_points,
        map_time=result.map_time,
        maps=result.maps[:, ::2, ::2] - error.maps,
        velocity=result.velocity[::2, ::2],
        convergence=error,
    )


def estimate(fine: dict[str, Array], coarse: dict[str, Array], courant_number: Float[Array, ""]) -> ExplicitConvergence:
    """The errors of a run from one of twice the cell sizes and step; both are the fields of an `ExplicitResult`."""
    axis, at_points = fine["axial_displacement_on_axis"], fine["displacement_at_points"]
    on_axis = (coarse["axial_displacement_on_axis"] - axis[::2, ::2]) / 3.0
    of_points = (coarse["displacement_at_points"] - at_points[::2]) / 3.0

    def largest(along_axis: Array, points: Array) -> Float[Array, ""]:
        return jnp.maximum(jnp.max(jnp.abs(along_axis)), jnp.max(jnp.abs(points[..., 1]), initial=0.0))

    peak = largest(axis, at_points)
    error = largest(on_axis, of_points) / jnp.where(peak == 0.0, 1.0, peak)
    maps = (coarse["maps"] - fine["maps"][:, ::2, ::2]) / 3.0
    return ExplicitConvergence(on_axis, of_points, maps, error, courant_number)


def no_estimate(fine: dict[str, Array], courant_number: Float[Array, ""]) -> ExplicitConvergence:
    """Not a number wherever an error would be."""
    nothing = jax.tree.map(lambda field: jnp.full_like(field, jnp.nan), fine)
    return ExplicitConvergence(
        nothing["axial_displacement_on_axis"][::2, ::2],
        nothing["displacement_at_points"][::2],
        nothing["maps"][:, ::2, ::2],
        jnp.full_like(courant_number, jnp.nan),
        courant_number,
    )
