"""Where a lesion is: its share of the tissue at each point, as closures on (r, z) and from computed damage.

A share is 1 where tissue is as in the lesion's centre, 0 where it is as outside, and mixes their constants between.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError, lies_within
from arfjax.grid import AxisymmetricGrid
from arfjax.laws import LETHAL_DOSE_MINUTES, coagulated_fraction, log_excess
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.elements.transfer import interpolation
from arfjax.media import Scalar

_SMALLEST_AXIS = 1e-9
"""Semi-axis [m] that stands for none: far below the distance from the axis to the nearest Gauss point."""

_LONGEST = 0.5
"""Semi-axis [m] beyond which an ellipsoid is refused."""

Points = Float[Array, "..."] | Float[np.ndarray, "..."]


class Ellipsoid(eqx.Module):
    """An ellipsoid on the axis.

    Made by `of_length_and_diameter` or by `of_semi_axes`, so that no factor of two hides: a table of lesion sizes read
    as semi-axes gives displacements at 60 / 65 / 70 degC of 93 / 69 / 55 % where lengths and diameters give 109 / 104 /
    95 % (of that at 35 degC, linear field of the bowl).

    Attributes:
        axial: Semi-axis along the axis [m]; 0 for no lesion.
        radial: Semi-axis across the axis [m]; 0 for no lesion.
        centre: Axial position of the centre [m].
    """

    axial: Scalar
    radial: Scalar
    centre: Scalar

    @classmethod
    def of_length_and_diameter(cls, length: Scalar, diameter: Scalar, *, centre: Scalar) -> "Ellipsoid":
        """From tip to tip along the axis and across it [m]."""
        return cls(0.5 * length, 0.5 * diameter, centre)

    @classmethod
    def of_semi_axes(cls, axial: Scalar, radial: Scalar, *, centre: Scalar) -> "Ellipsoid":
        """From the centre to a tip and to the widest place [m]."""
        return cls(axial, radial, centre)

    def __check_init__(self) -> None:
        """Refuse semi-axes that are negative or not in metres, where they are numbers."""
        for name in ("axial", "radial"):
            value = getattr(self, name)
            if not lies_within(value, 0.0, _LONGEST):
                raise InputError(
                    f"the {name} semi-axis of an ellipsoid must lie in 0 to {_LONGEST} m, got {value} m. "
                    "Millimetres? Pass metres."
                )

    def relative_radius(self, r: Points, z: Points) -> Float[Array, "..."]:
        """0 at the centre, 1 on the surface, in proportion between and beyond."""
        return _length(*self._scaled(r, z))

    def distance(self, r: Points, z: Points) -> Float[Array, "..."]:
        """Distance from the surface [m], negative inside; of first order in it (exact for a sphere)."""
        across, along = self._scaled(r, z)
        relative = _length(across, along)
        slope = _length(across / self._radial, along / self._axial)
        central = slope == 0.0
        inside = (relative - 1.0) * relative / jnp.where(central, 1.0, slope)
        return jnp.where(central, -self.shorter, inside)

    @property
    def shorter(self) -> Float[Array, ""]:
        """The shorter semi-axis [m]."""
        return jnp.minimum(self._axial, self._radial)

    @property
    def _axial(self) -> Float[Array, ""]:
        return jnp.maximum(self.axial, _SMALLEST_AXIS)

    @property
    def _radial(self) -> Float[Array, ""]:
        return jnp.maximum(self.radial, _SMALLEST_AXIS)

    def _scaled(self, r: Points, z: Points) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        return jnp.asarray(r) / self._radial, (jnp.asarray(z) - self.centre) / self._axial


def _length(across: Float[Array, "..."], along: Float[Array, "..."]) -> Float[Array, "..."]:
    # Of a vector; with the slope 0 where it vanishes.
    squared = across**2 + along**2
    vanishes = squared == 0.0
    return jnp.where(vanishes, 0.0, jnp.sqrt(jnp.where(vanishes, 1.0, squared)))


class Edge(eqx.Module):
    """How the share falls from a lesion's centre outward."""

    @abc.abstractmethod
    def share(self, ellipsoid: Ellipsoid, r: Points, z: Points) -> Float[Array, "..."]:
        """Share of the lesion at points r, z [m]."""


class LinearEdge(Edge):
    """From 1 at the centre in a straight line to 0 at the surface, as in Suomi et al. (2016).

    Differentiability: in size and place; the slope jumps at the surface and at the centre.
    """

    def share(self, ellipsoid: Ellipsoid, r: Points, z: Points) -> Float[Array, "..."]:
        """Share of the lesion at points r, z [m]."""
        return jnp.maximum(1.0 - ellipsoid.relative_radius(r, z), 0.0)


class SharpEdge(Edge):
    """1 inside and 0 outside, by a smooth step over a width centred on the surface.

    The step is what gives the material a slope in size and place: take it one to two elements wide. Its volume is that
    of the ellipsoid up to the square of width over semi-axis. A lesion narrower than the step narrows it to its own
    shorter axis, so that none is left of a lesion of no size.

    Attributes:
        width: Over which the share goes from 1 to 0 [m].

    Differentiability: once, in size, place and width.
    """

    width: Scalar

    def __check_init__(self) -> None:
        """Refuse a step of no width."""
        if not lies_within(self.width, 0.0, above=True):
            raise InputError(
                f"`width` of a sharp edge must be positive, got {self.width} m: a true step has no slope in the "
                "lesion's size. Take one element's size."
            )

    def share(self, ellipsoid: Ellipsoid, r: Points, z: Points) -> Float[Array, "..."]:
        """Share of the lesion at points r, z [m]."""
        width = jnp.minimum(self.width, 2.0 * ellipsoid.shorter)
        rise = jnp.clip(0.5 - ellipsoid.distance(r, z) / width, 0.0, 1.0)
        return rise**2 * (3.0 - 2.0 * rise)


class EllipsoidalLesion(eqx.Module):
    """An ellipsoid with an edge: a closure on (r, z) that gives the lesion's share."""

    ellipsoid: Ellipsoid
    edge: Edge = LinearEdge()

    def __call__(self, r: Points, z: Points) -> Float[Array, "..."]:
        """Share of the lesion at points r, z [m]."""
        return self.edge.share(self.ellipsoid, r, z)


def coagulated_share(
    mesh: Mesh,
    grid: AxisymmetricGrid,
    damage: Float[Array, "r z"] | Float[np.ndarray, "r z"],
    *,
    threshold: Scalar = LETHAL_DOSE_MINUTES,
    width: Scalar,
) -> Float[Array, "rq zq"]:
    """Share of coagulated tissue at the Gauss points of a mesh, from the damage in the cells of a heat grid.

    The logarithm of damage, which is as smooth as temperature, is interpolated linearly between cell centres (and held
    beyond the outermost), and `coagulated_fraction` of it taken at the points: damage may change tenfold from one cell
    to the next.

    Args:
        mesh: The mesh.
        grid: Where the cells lie, in the coordinates of the mesh.
        damage: Dose [equivalent min at 43 degC], or the damage of any other law.
        threshold: At which half has coagulated, in the same unit.
        width: Of the transition in the logarithm of damage.

    Raises:
        InputError: if `damage` does not fit the grid.

    Accuracy: second order in the cell size.
    Differentiability: in damage, threshold and width.
    """
    _check_shape(damage, grid)
    level = at_gauss_points(mesh, grid, log_excess(damage, threshold))
    return coagulated_fraction(jnp.exp(level), 1.0, width=width)


def at_gauss_points(mesh: Mesh, grid: AxisymmetricGrid, values: Float[Array, "r z"]) -> Float[Array, "rq zq"]:
    """Values in the cells of a heat grid at the Gauss points of a mesh, linear between centres and held beyond them.

    Raises:
        InputError: if the values do not fit the grid.

    Accuracy: second order in the cell size.
    """
    _check_shape(values, grid)
    along_r = jnp.asarray(interpolation(grid.r, mesh.gauss_r, degree=1, ring=True), dtype=float)
    along_z = jnp.asarray(interpolation(grid.z, mesh.gauss_z, degree=1), dtype=float)
    return along_r @ values @ along_z.T


def _check_shape(values: Float[Array, "r z"] | Float[np.ndarray, "r z"], grid: AxisymmetricGrid) -> None:
    if values.shape != grid.shape:
        raise InputError(f"values of shape {values.shape} do not fit the grid, which has {grid.shape} cells (r, z).")
