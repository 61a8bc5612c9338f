"""Conduction between the cells of an axisymmetric grid, and out of them into blood and walls.

Conservative finite volumes: the heat that leaves a cell through a face enters its neighbour, and a face between two
media passes the flux of two half cells in series, so that layers conserve heat.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError, lies_within
from arfjax.grid import AxisymmetricGrid
from arfjax.media import Scalar, ThermalMedium

CellValues = Float[Array, "r z"] | Float[np.ndarray, "r z"]


class ThermalField(eqx.Module):
    """Thermal constants at the cell centres of a grid, all positive (perfusion and metabolic heat may be zero).

    Attributes:
        conductivity: [W/(m K)].
        heat_capacity: Density times specific heat [J/(m^3 K)].
        perfusion_conductance: Heat that blood takes away per kelvin above arterial temperature [W/(m^3 K)].
        metabolic_heat: Heat that tissue makes itself [W/m^3].
    """

    conductivity: CellValues
    heat_capacity: CellValues
    perfusion_conductance: CellValues
    metabolic_heat: CellValues | Scalar = 0.0


def uniform_field(medium: ThermalMedium, grid: AxisymmetricGrid) -> ThermalField:
    """The same medium in every cell of a grid."""
    ones = jnp.ones(grid.shape)
    return ThermalField(
        conductivity=ones * medium.conductivity,
        heat_capacity=ones * medium.heat_capacity,
        perfusion_conductance=ones * medium.perfusion_conductance,
        metabolic_heat=ones * medium.metabolic_heat,
    )


_LARGEST_COEFFICIENT = 1e12
"""Of heat transfer [W/(m^2 K)]: far beyond what boils or freezes anything, and finite."""


class Wall(eqx.Module):
    """What the outside does to the cells that touch one wall of the grid."""

    @abc.abstractmethod
    def conductance(self, half_cell: Float[Array, " n"], area: Float[Array, " n"]) -> Float[Array, " n"]:
        """Conductance [W/K] from cell centres to the outside.

        Args:
            half_cell: Conductance from cell centres to the wall [W/K].
            area: Of the wall that each cell has [m^2].
        """

    @abc.abstractmethod
    def temperature_rise(self) -> Scalar:
        """Temperature of the outside above the initial temperature [K]."""


class FixedTemperature(Wall):
    """A wall held at a constant temperature.

    Attributes:
        rise: Its temperature above the initial temperature [K].
    """

    rise: Scalar = 0.0

    def conductance(self, half_cell: Float[Array, " n"], area: Float[Array, " n"]) -> Float[Array, " n"]:
        """That of half a cell."""
        return half_cell

    def temperature_rise(self) -> Scalar:
        """The wall's."""
        return self.rise


class Insulated(Wall):
    """A wall that no heat passes."""

    def conductance(self, half_cell: Float[Array, " n"], area: Float[Array, " n"]) -> Float[Array, " n"]:
        """None."""
        return jnp.zeros_like(half_cell)

    def temperature_rise(self) -> Scalar:
        """Of no effect."""
        return 0.0


class Convective(Wall):
    """A wall that a moving fluid, such as a stirred water bath, cools or warms.

    Attributes:
        coefficient: Heat transfer coefficient [W/(m^2 K)].
        rise: Temperature of the fluid above the initial temperature [K].
    """

    coefficient: Scalar
    rise: Scalar = 0.0

    def __check_init__(self) -> None:
        """Refuse coefficients that are negative or not finite."""
        if not lies_within(self.coefficient, 0.0, _LARGEST_COEFFICIENT):
            raise InputError(
                f"`coefficient` of a convective wall must be a number from 0 to {_LARGEST_COEFFICIENT:g} W/(m^2 K), "
                f"got {self.coefficient}; perfect contact is `FixedTemperature`."
            )

    def conductance(self, half_cell: Float[Array, " n"], area: Float[Array, " n"]) -> Float[Array, " n"]:
        """Half a cell and the fluid's boundary layer in series; none at a coefficient of zero."""
        film = self.coefficient * area
        return half_cell * film / (half_cell + film)

    def temperature_rise(self) -> Scalar:
        """The fluid's."""
        return self.rise


class Walls(eqx.Module):
    """The walls of the grid; the axis is none.

    Attributes:
        outer: At the largest radius.
        near: At the smallest z, towards the transducer.
        far: At the largest z.
    """

    outer: Wall = FixedTemperature()
    near: Wall = FixedTemperature()
    far: Wall = FixedTemperature()


class Geometry(eqx.Module):
    """Areas and volumes of a grid: `radial_area` is each cell's outer face, `axial_area` its two end faces."""

    volumes: Float[Array, "r z"]
    radial_area: Float[Array, "r z"]
    axial_area: Float[Array, " r"]
    half_width: Float[Array, " r"]
    half_height: Float[Array, " z"]


def cell_geometry(grid: AxisymmetricGrid) -> Geometry:
    """Areas, volumes and widths of the cells of a grid."""
    heights = np.diff(grid.z_faces)
    return Geometry(
        volumes=jnp.asarray(grid.volumes),
        radial_area=jnp.asarray(2.0 * np.pi * grid.r_faces[1:, None] * heights[None, :]),
        axial_area=jnp.asarray(np.pi * np.diff(grid.r_faces**2)),
        half_width=jnp.asarray(0.5 * np.diff(grid.r_faces)),
        half_height=jnp.asarray(0.5 * heights),
    )


class Conductances(eqx.Module):
    """Between neighbours along r and along z, through the outer wall, and to blood and end walls together [W/K]."""

    radial: Float[Array, "r_inner z"]
    axial: Float[Array, "r z_inner"]
    outer: Float[Array, " z"]
    loss: Float[Array, "r z"]

    def leaving(self, rise: Float[Array, "r z"]) -> Float[Array, "r z"]:
        """Net power that leaves each cell [W]."""
        return self.leaving_along_r(rise) + self.leaving_along_z(rise)

    def leaving_along_r(self, rise: Float[Array, "r z"]) -> Float[Array, "r z"]:
        """Net power that leaves each cell to its neighbours along r and to the outer wall [W]."""
        inner = jnp.zeros_like(rise[:1])
        flow = jnp.concatenate([inner, -self.radial * jnp.diff(rise, axis=0), self.outer[None] * rise[-1:]])
        return jnp.diff(flow, axis=0)

    def leaving_along_z(self, rise: Float[Array, "r z"]) -> Float[Array, "r z"]:
        """Net power that leaves each cell to its neighbours along z, to blood and to the end walls [W]."""
        flow = jnp.pad(-self.axial * jnp.diff(rise, axis=1), ((0, 0), (1, 1)))
        return jnp.diff(flow, axis=1) + self.loss * rise

    def diagonal_along_r(self) -> Float[Array, "r z"]:
        """Sum of each cell's conductances to its neighbours along r and to the outer wall."""
        inner = jnp.zeros_like(self.outer)[None]
        radial = jnp.concatenate([inner, self.radial, self.outer[None]])
        return radial[1:] + radial[:-1]

    def diagonal_along_z(self) -> Float[Array, "r z"]:
        """Sum of each cell's conductances to its neighbours along z, to blood and to the end walls."""
        axial = jnp.pad(self.axial, ((0, 0), (1, 1)))
        return axial[:, 1:] + axial[:, :-1] + self.loss


def cell_conductances(
    field: ThermalField, geometry: Geometry, walls: Walls
) -> tuple[Conductances, Float[Array, "r z"]]:
    """Conductances [W/K], and the power that the walls send into each cell at zero rise [W]."""
    conductivity = jnp.asarray(field.conductivity)
    radial = geometry.half_width[:, None] / conductivity  # resistance of half a cell times area
    axial = geometry.half_height[None, :] / conductivity
    outer = walls.outer.conductance(geometry.radial_area[-1] / radial[-1], geometry.radial_area[-1])
    near = walls.near.conductance(geometry.axial_area / axial[:, 0], geometry.axial_area)
    far = walls.far.conductance(geometry.axial_area / axial[:, -1], geometry.axial_area)

    def into_cells(outer: Array, near: Array, far: Array) -> Float[Array, "r z"]:
        cells = jnp.zeros_like(conductivity)
        return cells.at[-1].add(outer).at[:, 0].add(near).at[:, -1].add(far)

    inflow = into_cells(
        outer * walls.outer.temperature_rise(), near * walls.near.temperature_rise(), far * walls.far.temperature_rise()
    )
    ends = into_cells(jnp.zeros_like(outer), near, far)
    conductances = Conductances(
        radial=geometry.radial_area[:-1] / (radial[:-1] + radial[1:]),
        axial=geometry.axial_area[:, None] / (axial[:, :-1] + axial[:, 1:]),
        outer=outer,
        loss=jnp.asarray(field.perfusion_conductance) * geometry.volumes + ends,
    )
    return conductances, inflow
