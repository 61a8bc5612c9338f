"""Axisymmetric tensor grids of finite volumes: where faces and centres lie, and how large the cells are."""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from arfjax.errors import InputError


class AxisymmetricGrid(eqx.Module):
    """Cells between the radial faces and the axial faces, rotated about the axis.

    The first radial face lies on the axis, so that it has no area and needs no boundary condition.

    Attributes:
        r_faces: Radial faces [m], ascending from 0.
        z_faces: Axial faces [m], ascending, measured from the bowl's apex.
    """

    r_faces: Float[np.ndarray, " n_r_faces"]
    z_faces: Float[np.ndarray, " n_z_faces"]

    def __check_init__(self) -> None:
        """Refuse faces that are not ascending or do not start on the axis."""
        for name, faces in (("r_faces", self.r_faces), ("z_faces", self.z_faces)):
            if len(faces) < 2 or not np.all(np.diff(faces) > 0.0):
                raise InputError(f"`{name}` must hold at least two ascending positions [m], got {faces}.")
        if self.r_faces[0] != 0.0:
            raise InputError(f"`r_faces` must start on the axis at 0 m, got {self.r_faces[0]} m.")

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cells, radial and axial."""
        return len(self.r_faces) - 1, len(self.z_faces) - 1

    @property
    def r(self) -> Float[np.ndarray, " r"]:
        """Radial cell centres [m]."""
        return 0.5 * (self.r_faces[1:] + self.r_faces[:-1])

    @property
    def z(self) -> Float[np.ndarray, " z"]:
        """Axial cell centres [m]."""
        return 0.5 * (self.z_faces[1:] + self.z_faces[:-1])

    @property
    def volumes(self) -> Float[np.ndarray, "r z"]:
        """Cell volumes [m^3], all the way round the axis."""
        rings = np.pi * np.diff(self.r_faces**2)
        return rings[:, None] * np.diff(self.z_faces)[None, :]


def graded_positions(
    start: float, stop: float, centre: float, *, finest: float, growth: float, coarsest: float
) -> Float[np.ndarray, " n"]:
    """Positions from `start` to `stop` [m], spaced `finest` about `centre` and wider away from it.

    Spacing grows by the factor `growth` from one interval to the next up to `coarsest`; then each side is stretched
    evenly to end exactly at `start` and `stop`. `centre` is one of the positions (when it lies inside).

    Raises:
        InputError: if the interval is empty, `centre` lies outside, or the spacings make no sense.
    """
    if not start <= centre <= stop or not start < stop:
        raise InputError(f"`centre` {centre} m must lie between `start` {start} m and `stop` {stop} m.")
    if not 0.0 < finest <= coarsest or growth < 1.0:
        raise InputError(f"need 0 < finest <= coarsest and growth >= 1, got {finest}, {coarsest}, {growth}.")
    below = _one_side(centre - start, finest, growth, coarsest)
    above = _one_side(stop - centre, finest, growth, coarsest)
    return np.concatenate([centre - below[:0:-1], [centre], centre + above[1:]])


def _one_side(length: float, finest: float, growth: float, coarsest: float) -> Float[np.ndarray, " n"]:
    if length == 0.0:
        return np.zeros(1)
    spacings = [min(finest, length)]
    while sum(spacings) < length * (1.0 - 1e-12):
        spacings.append(min(spacings[-1] * growth, coarsest))
    positions = np.concatenate([[0.0], np.cumsum(spacings)])
    return positions * (length / positions[-1])
