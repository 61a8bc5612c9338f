r"""Cells, nodes and walls of the explicit path, and the flat arrays on which its stencil works.

Nodes lie on the faces of an `AxisymmetricGrid`, material in its cells. Every field becomes one line of numbers: node
(i, j) is entry i W + j with W axial nodes, and the four nodes of a cell are entries apart by 1, W and W + 1. Cells that
would wrap around the end of a row, and those before the first and after the last node, exist and have no stiffness.
So the stencil is nothing but shifted slices of long contiguous lines, without a gather, a scatter or a boundary.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.elements.mesh import Wall, Walls


class DampingLayer(eqx.Module):
    """A layer along the walls in which waves die out; along sliding walls, which may be planes of symmetry, is none.

    The force against the motion is density times velocity times a rate that grows with the square of the depth. It is
    for waves shorter than 1.5 times its width. Of a push it keeps little back, since most of the displacement is in
    longer waves: in a box of 12 mm with a layer of 6 mm, 0.35 of what comes back without it came back at the best rate
    (a push of 0.4 ms and 1 mm, compressional waves of 2.8 m/s). For pushes take a wide graded grid instead.

    Attributes:
        width: [m].
        rate: At the wall [1/s].

    Accuracy: share of the amplitude of a plane wave at right angles that comes back, for the layer that
        `against(..., reflection=0.01)` gives:

    | wave length over width | 0.33 | 0.5 | 0.67 | 1 | 1.33 | 2 | 4 | 10 |
    | --- | --- | --- | --- | --- | --- | --- | --- | --- |
    | share | 0.011 | 0.012 | 0.013 | 0.022 | 0.08 | 0.16 | 0.38 | 0.75 |
    """

    width: float = eqx.field(static=True)
    rate: float = eqx.field(static=True)

    def __check_init__(self) -> None:
        """Refuse a layer without width or with a negative rate."""
        if not (self.width > 0.0 and self.rate >= 0.0):
            raise InputError(
                f"a damping layer needs `width` > 0 and `rate` >= 0, got {self.width} m and {self.rate} 1/s."
            )

    @classmethod
    def against(cls, wave_speed: float, *, width: float, reflection: float = 1e-2) -> "DampingLayer":
        """The layer out of which short waves of that speed [m/s] come, at right angles, with that share of amplitude.

        Longer ones the layer reflects before it can damp them, the more so the smaller the share.
        """
        if not (wave_speed > 0.0 and 0.0 < reflection < 1.0):
            raise InputError(
                f"need `wave_speed` > 0 and `reflection` between 0 and 1, got {wave_speed} m/s and {reflection}."
            )
        return cls(float(width), float(3.0 * wave_speed * np.log(1.0 / reflection) / width))


def node_positions(grid: AxisymmetricGrid) -> tuple[Float[np.ndarray, "r 1"], Float[np.ndarray, "1 z"]]:
    """Radii and axial positions [m] of the nodes: `force(*node_positions(grid))` samples a function of r and z."""
    return grid.r_faces[:, None], grid.z_faces[None, :]


def cell_positions(grid: AxisymmetricGrid) -> tuple[Float[np.ndarray, "r 1"], Float[np.ndarray, "1 z"]]:
    """Radii and axial positions [m] of the centres of the cells, where the material is given."""
    return grid.r[:, None], grid.z[None, :]


def refined(grid: AxisymmetricGrid) -> AxisymmetricGrid:
    """The grid with each cell cut in four; `coarsened` gives the grid back."""
    faces = (grid.r_faces, grid.z_faces)
    r_faces, z_faces = (np.insert(each[1:] - 0.5 * np.diff(each), np.arange(len(each)), each) for each in faces)
    return AxisymmetricGrid(r_faces, z_faces)


def coarsened(grid: AxisymmetricGrid) -> AxisymmetricGrid:
    """The grid of every other face.

    Raises:
        InputError: if a number of cells is odd.
    """
    if grid.shape[0] % 2 or grid.shape[1] % 2:
        raise InputError(
            f"the estimate of the error halves the grid, which has {grid.shape[0]} x {grid.shape[1]} cells: "
            "give even numbers of cells, or `estimate_error=False`."
        )
    return AxisymmetricGrid(grid.r_faces[::2], grid.z_faces[::2])


def coarsened_cells(grid: AxisymmetricGrid, field: Float[Array, "*any r z"]) -> Float[Array, "*any r2 z2"]:
    """Means by volume of four cells each."""

    def four(values: Float[Array, "*any r z"]) -> Float[Array, "*any r2 z2"]:
        n_r, n_z = values.shape[-2:]
        return values.reshape(*values.shape[:-2], n_r // 2, 2, n_z // 2, 2).sum(axis=(-3, -1))

    volumes = jnp.asarray(grid.volumes, field.dtype)
    volumes = volumes.reshape((1,) * (field.ndim - 2) + volumes.shape)
    return four(field * volumes) / four(volumes)


class Layout:
    """Geometry of a grid as flat arrays (numpy), and the way to and from them."""

    def __init__(self, grid: AxisymmetricGrid):
        """Lay out the cells and nodes of a grid."""
        self.grid = grid
        self.n_r, self.n_z = grid.shape
        self.row = self.n_z + 1
        self.n_nodes = (self.n_r + 1) * self.row
        self.n_cells = self.n_nodes + self.row + 1
        self.inner, self.outer = grid.r_faces[:-1, None], grid.r_faces[1:, None]
        self.r_size, self.z_size = self.outer - self.inner, np.diff(grid.z_faces)[None, :]
        # Shares of a cell's volume that count to its inner and its outer nodes: cut in the middle between them.
        # The integrals of the shape functions, 1/3 and 2/3 on the axis in place of 1/4 and 3/4, would be wrong there.
        self.outer_share = 0.5 + 0.25 * self.r_size / (self.inner + self.outer)

    @property
    def hourglass(self) -> Float[np.ndarray, "2 r z"]:
        """Hourglass stiffness over shear modulus and volume [1/m^2]: what exact integration of the deviator gives.

        A motion u = xi eta strains along its own direction (4/3 of the modulus counts) and shears, both with a mean
        square of 1/3.
        """
        by_r, by_z = np.broadcast_arrays(1.0 / self.r_size**2, 1.0 / self.z_size**2)
        return np.stack([4.0 / 3.0 * by_r + by_z, 4.0 / 3.0 * by_z + by_r]) / 12.0

    def cells(self, field: Float[Array, "*any r z"], empty: float = 0.0) -> Float[Array, "*any cell"]:
        """A field of the cells, with `empty` in the cells that are none."""
        rows = [(0, 0)] * (field.ndim - 2)
        padded = jnp.pad(field, [*rows, (1, 1), (0, 1)], constant_values=empty)
        flat = padded.reshape(*field.shape[:-2], padded.shape[-2] * padded.shape[-1])
        return jnp.pad(flat, [*rows, (1, 0)], constant_values=empty)[..., : self.n_cells]

    def nodes(self, flat: Float[Array, "*any node"]) -> Float[Array, "*any r z"]:
        """A field of the nodes from its flat array."""
        return flat.reshape(*flat.shape[:-1], self.n_r + 1, self.row)

    def sum_at_nodes(self, field: Float[Array, "r z"]) -> Float[Array, "r_node z_node"]:
        """Shares what belongs to the cells out to their nodes."""
        outer = field * jnp.asarray(self.outer_share, field.dtype)
        by_radius = jnp.pad(field - outer, ((0, 1), (0, 0))) + jnp.pad(outer, ((1, 0), (0, 0)))
        return 0.5 * (jnp.pad(by_radius, ((0, 0), (0, 1))) + jnp.pad(by_radius, ((0, 0), (1, 0))))

    def free(self, walls: Walls) -> Float[np.ndarray, "2 r_node z_node"]:
        """One for each component of the displacement that may move, zero for those that are held."""
        free = np.ones((2, self.n_r + 1, self.row))
        free[0, 0] = 0.0
        for wall, nodes, across in (
            (walls.outer, np.s_[-1, :], 0),
            (walls.bottom, np.s_[:, 0], 1),
            (walls.top, np.s_[:, -1], 1),
        ):
            for component in (0, 1):
                if wall is Wall.FIXED or (wall is Wall.SLIDING and component == across):
                    free[component][nodes] = 0.0
        return free

    def damping_rate(self, layer: DampingLayer, walls: Walls) -> Float[np.ndarray, "r_node z_node"]:
        """Rate [1/s] at which motion is slowed down, at the nodes."""
        r, z = node_positions(self.grid)
        to_wall = np.full((self.n_r + 1, self.row), np.inf)
        for wall, distance in ((walls.outer, r[-1:] - r), (walls.bottom, z - z[:, :1]), (walls.top, z[:, -1:] - z)):
            if wall is not Wall.SLIDING:
                to_wall = np.minimum(to_wall, distance)
        return layer.rate * np.clip(1.0 - to_wall / layer.width, 0.0, 1.0) ** 2
