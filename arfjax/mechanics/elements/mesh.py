"""The mesh of the mechanical problem: rectangles in the half plane (r, z), rotated about the axis."""

import enum
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Inexact

from arfjax.errors import InputError
from arfjax.numerics.elements import quadratic
from arfjax.numerics.quadrature import gauss_legendre

N_GAUSS = 3
"""Gauss points along each side of an element: exact for the mass matrix of a biquadratic element on a ring."""


_ROUNDING = 1e-4
"""Share of half an element by which a position may lie beyond the last edge."""


class Wall(enum.Enum):
    """What a wall lets the tissue beside it do.

    FIXED: nothing (as in Suomi et al. 2016).
    FREE: everything; no traction.
    SLIDING: move along the wall, and not through it; no traction along it. A plane of symmetry is such a wall.
    """

    FIXED = "fixed"
    FREE = "free"
    SLIDING = "sliding"


def _as_wall(wall: Wall | bool | str) -> Wall:
    if isinstance(wall, bool):
        return Wall.FIXED if wall else Wall.FREE
    try:
        return Wall(wall)
    except ValueError:
        names = ", ".join(f'"{kind.value}"' for kind in Wall)
        raise InputError(f"a wall is a `Wall`, one of {names}, or a bool (fixed or free), got {wall!r}.") from None


class Walls(eqx.Module):
    """Conditions on the outer walls, by kind or name. The axis is never a wall. True stands for fixed, False for free.

    Attributes:
        outer: The wall at the largest radius.
        bottom: The wall at the smallest z.
        top: The wall at the largest z.
    """

    outer: Wall = eqx.field(static=True, default=Wall.FIXED, converter=_as_wall)
    bottom: Wall = eqx.field(static=True, default=Wall.FIXED, converter=_as_wall)
    top: Wall = eqx.field(static=True, default=Wall.FIXED, converter=_as_wall)


class Mesh(eqx.Module):
    """Biquadratic elements between radial edges and axial edges.

    Attributes:
        r_edges: Radial element edges [m], ascending from 0 (the axis).
        z_edges: Axial element edges [m], ascending.
        walls: Conditions on the outer walls, `arfjax.mechanics.elements.mesh.Walls` (`arfjax.Walls` are those of heat).
    """

    r_edges: Float[np.ndarray, " n_r_edges"]
    z_edges: Float[np.ndarray, " n_z_edges"]
    walls: Walls = Walls()

    def __check_init__(self) -> None:
        """Refuse edges that are not ascending or do not start on the axis."""
        for name, edges in (("r_edges", self.r_edges), ("z_edges", self.z_edges)):
            if len(edges) < 2 or not np.all(np.diff(edges) > 0.0):
                raise InputError(f"`{name}` must hold at least two ascending positions [m], got {edges}.")
        if self.r_edges[0] != 0.0:
            raise InputError(f"`r_edges` must start on the axis at 0 m, got {self.r_edges[0]} m.")

    @property
    def shape(self) -> tuple[int, int]:
        """Number of elements, radial and axial."""
        return len(self.r_edges) - 1, len(self.z_edges) - 1

    @property
    def n_unknowns(self) -> int:
        """Number of displacement components, held ones included."""
        return 2 * len(self.node_r) * len(self.node_z)

    @property
    def node_r(self) -> Float[np.ndarray, " r"]:
        """Radial node positions [m]: element edges and middles."""
        return _inside(self.r_edges, np.array([-1.0, 0.0, 1.0]), drop_last=True)

    @property
    def node_z(self) -> Float[np.ndarray, " z"]:
        """Axial node positions [m]: element edges and middles."""
        return _inside(self.z_edges, np.array([-1.0, 0.0, 1.0]), drop_last=True)

    @property
    def gauss_r(self) -> Float[np.ndarray, " rq"]:
        """Radial positions [m] of the tensor grid of Gauss points, on which material and force are given."""
        return _inside(self.r_edges, gauss_legendre(N_GAUSS)[0])

    @property
    def gauss_z(self) -> Float[np.ndarray, " zq"]:
        """Axial positions [m] of the tensor grid of Gauss points."""
        return _inside(self.z_edges, gauss_legendre(N_GAUSS)[0])

    @property
    def gauss_weights(self) -> tuple[Float[np.ndarray, " rq"], Float[np.ndarray, " zq"]]:
        """Area 2 pi r dr [m^2] and height dz [m] for which each radial and each axial Gauss point stands."""
        weights = gauss_legendre(N_GAUSS)[1]
        r_sizes, z_sizes = (0.5 * np.diff(edges)[:, None] * weights for edges in (self.r_edges, self.z_edges))
        return 2.0 * np.pi * self.gauss_r * r_sizes.ravel(), z_sizes.ravel()

    @property
    def free(self) -> Float[np.ndarray, "row column 2"]:
        """One for each displacement component that may move, zero for those that are held."""
        free = np.ones((len(self.node_z), len(self.node_r), 2))
        free[:, 0, 0] = 0.0
        walls = self.walls
        for kind, wall, normal in ((walls.outer, np.s_[:, -1], 0), (walls.bottom, 0, 1), (walls.top, -1, 1)):
            if kind is Wall.FIXED:
                free[wall] = 0.0
            elif kind is Wall.SLIDING:
                free[wall][..., normal] = 0.0
        return free

    def require_inside(self, points: Float[np.ndarray, "point 2"]) -> None:
        """Refuse positions r, z [m] outside the mesh."""
        lowest, highest = [0.0, self.z_edges[0]], [self.r_edges[-1], self.z_edges[-1]]
        slack = 1e-9 * np.abs(highest)
        outside = ~np.all((points >= lowest - slack) & (points <= highest + slack), axis=1)
        if np.any(outside):
            r, z = points[np.flatnonzero(outside)[0]]
            raise InputError(
                f"the point r = {r:g} m, z = {z:g} m lies outside the mesh, r up to {highest[0]:g} m and z from "
                f"{lowest[1]:g} to {highest[1]:g} m. Millimetres, or another origin? Pass metres."
            )

    def element_values(
        self, field: Inexact[Array, "rq zq"] | Inexact[np.ndarray, "rq zq"]
    ) -> Inexact[Array, "ez er 9"]:
        """A field on the tensor grid of Gauss points, sorted by elements."""
        n_r, n_z = self.shape
        expected = (N_GAUSS * n_r, N_GAUSS * n_z)
        if field.shape != expected:
            raise InputError(
                f"a field at the Gauss points has shape {expected} (radial, axial) on this mesh, got {field.shape}. "
                "Evaluate it at `mesh.gauss_r` and `mesh.gauss_z`."
            )
        split = jnp.asarray(field).reshape(n_r, N_GAUSS, n_z, N_GAUSS)
        return split.transpose(2, 0, 3, 1).reshape(n_z, n_r, N_GAUSS**2)


def _inside(
    edges: Float[np.ndarray, " n"], points: Float[np.ndarray, " p"], *, drop_last: bool = False
) -> Float[np.ndarray, " m"]:
    # The reference points of every interval; with `drop_last` the end shared with the next interval counts once.
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * (edges[1:] - edges[:-1])
    positions = middle[:, None] + half[:, None] * points[None, :]
    if drop_last:
        return np.append(positions[:, :-1].ravel(), edges[-1])
    return positions.ravel()


def interpolation_weights(
    edges: Float[np.ndarray, " n_edges"] | Float[Array, " n_edges"],
    positions: Float[Array, " position"] | Float[np.ndarray, " position"] | Sequence[float],
) -> Float[Array, "position node"]:
    """Weights of the nodes along one direction that interpolate quadratically inside the element of each position.

    Weights are NaN for positions outside the mesh.
    """
    edges, positions = jnp.asarray(edges, dtype=float), jnp.asarray(positions, dtype=float)
    n_elements = len(edges) - 1
    element = jnp.clip(jnp.searchsorted(edges, positions, side="right") - 1, 0, n_elements - 1)
    left, right = edges[element], edges[element + 1]
    place = (2.0 * positions - left - right) / (right - left)
    values = jnp.where((jnp.abs(place) <= 1.0 + _ROUNDING)[:, None], quadratic(place), jnp.nan)
    weights = jnp.zeros((len(positions), 2 * n_elements + 1), values.dtype)
    rows = jnp.arange(len(positions))[:, None]
    return weights.at[rows, 2 * element[:, None] + jnp.arange(3)[None, :]].set(values)
