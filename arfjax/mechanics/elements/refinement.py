"""Meshes that are fine at the focus and coarsen smoothly away from it."""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from arfjax.errors import InputError
from arfjax.mechanics.elements.mesh import Mesh, Walls

STEEPEST = 1.3
"""Largest ratio of neighbouring spacings."""


class OuterLayer(eqx.Module):
    r"""Elements outside the graded part of a mesh, as the "infinite elements" of Suomi et al. (2016), 5 mm thick.

    With the share x of the thickness they stand for the distance $thickness \, x / (1 - x (1 - 1 / stretch))$: the
    first is about as long as it looks, the last nearly as long as all. A few unknowns move the walls away by `stretch`
    thicknesses.

    What they do, beside a fixed box of 21 mm radius and 20 mm half length (largest error at eight points within 10 mm
    of the focus over the largest displacement; mesh of 0.25 x 0.8 mm, layers of the defaults):

    | case | box | plain 5 mm | stretched |
    | --- | --- | --- | --- |
    | static, elastic | 10 % | 8 % | 3 % |
    | 50 Hz, fractional solid with much loss | 11 % | 9 % | 0.14 % (5 % with 4 elements) |
    | 50 Hz, liver's Zener solid, hardly any loss | 110 % | 77 % | 41 % |

    In a push of 0.5 ms they do nothing: no wave has come back from the wall (3e-5). They do not absorb: a wave that
    comes to elements longer than half its length is reflected there. Against waves use an absorbing layer.

    Attributes:
        thickness: [m].
        n_elements: Across the thickness.
        stretch: Distance that the layer stands for, over its thickness; 1 for plain elements.
    """

    thickness: float = eqx.field(static=True, default=5e-3)
    n_elements: int = eqx.field(static=True, default=8)
    stretch: float = eqx.field(static=True, default=1000.0)

    def __check_init__(self) -> None:
        """Refuse a layer that is none."""
        if not (0.0 < self.thickness < np.inf and self.n_elements >= 1 and 1.0 <= self.stretch < np.inf):
            raise InputError(
                "an outer layer needs a positive thickness, one element or more and a stretch of 1 or more, got "
                f"{self.thickness} m, {self.n_elements} and {self.stretch}."
            )

    @property
    def distances(self) -> Float[np.ndarray, " n"]:
        """Outer edges of the elements, from where the layer begins [m]."""
        share = np.arange(1, self.n_elements + 1) / self.n_elements
        return self.thickness * share / (1.0 - share * (1.0 - 1.0 / self.stretch))


def focused_mesh(
    *,
    focus: float,
    radius: float,
    front: float,
    back: float,
    finest_r: float,
    finest_z: float,
    growth: float = 1.2,
    fine_radius: float = 0.0,
    fine_length: float = 0.0,
    coarsest: float = np.inf,
    walls: Walls | None = None,
    outer_layer: OuterLayer | None = None,
) -> Mesh:
    """A mesh whose elements are finest on the axis at the focus.

    Args:
        focus: Axial position of the focus [m].
        radius: Outer radius of the graded part [m].
        front: Its first axial position [m].
        back: Its last axial position [m].
        finest_r: Radial size of the elements at the axis [m].
        finest_z: Axial size of those at the focus [m].
        growth: Largest ratio of neighbouring sizes, up to 1.3.
        fine_radius: Radius within which all are as fine [m].
        fine_length: Length, centred on the focus, within which all are as fine [m].
        coarsest: Largest size [m].
        walls: Conditions on the outer walls; all fixed if not given.
        outer_layer: Beyond the radius, the front and the back; none if not given.

    Raises:
        InputError: if the focus lies outside, sizes make no sense or the growth is too large.
    """
    r_edges = refined_edges(0.0, radius, 0.0, finest=finest_r, growth=growth, fine=2.0 * fine_radius, coarsest=coarsest)
    z_edges = refined_edges(front, back, focus, finest=finest_z, growth=growth, fine=fine_length, coarsest=coarsest)
    if outer_layer is not None:
        beyond = outer_layer.distances
        r_edges = np.concatenate([r_edges, radius + beyond])
        z_edges = np.concatenate([front - beyond[::-1], z_edges, back + beyond])
    return Mesh(r_edges, z_edges, Walls() if walls is None else walls)


def refined_edges(
    start: float, stop: float, focus: float, *, finest: float, growth: float, fine: float, coarsest: float = np.inf
) -> Float[np.ndarray, " n"]:
    """Edges from `start` to `stop` [m] whose spacing is `finest` at `focus` and grows smoothly away from it.

    Unlike `arfjax.grid.graded_positions`, which stretches each side to end where it should, both sides start with
    `finest` and their growth is lowered so that they end there. No two neighbours differ by more than `growth`, but
    beside a side that is too short to grow on, as at a focus near an end: that side is cut into even intervals.

    Args:
        start: First edge [m].
        stop: Last edge [m].
        focus: One of the edges [m].
        finest: Spacing there [m].
        growth: Largest ratio of neighbouring spacings, above 1 and up to 1.3.
        fine: Length about the focus within which the spacing is even [m].
        coarsest: Largest spacing [m].
    """
    if not start <= focus <= stop or start == stop:
        raise InputError(f"the focus, {focus} m, must lie in the mesh, {start} to {stop} m.")
    if not 0.0 < finest <= coarsest or not 1.0 < growth <= STEEPEST or fine < 0.0:
        raise InputError(
            f"need 0 < finest <= coarsest, 1 < growth <= {STEEPEST} and a fine part of 0 m or more, "
            f"got {finest} m, {coarsest} m, {growth} and {fine} m."
        )
    n_even = int(np.ceil(0.5 * fine / finest))
    below, above = (_one_side(length, finest, growth, n_even, coarsest) for length in (focus - start, stop - focus))
    edges = np.concatenate([focus - below[:0:-1], [focus], focus + above[1:]])
    edges[0], edges[-1] = start, stop
    return edges


def _one_side(length: float, finest: float, growth: float, n_even: int, coarsest: float) -> Float[np.ndarray, " n"]:
    if length == 0.0:
        return np.zeros(1)

    def positions(n: int, ratio: float) -> Float[np.ndarray, " m"]:
        # Compared as logarithms, because a power of many intervals overflows.
        exponent = np.maximum(np.arange(n) - n_even, 0) * np.log(ratio)
        spacing = finest * np.exp(np.minimum(exponent, np.log(coarsest / finest)))
        return np.concatenate([[0.0], np.cumsum(spacing)])

    n = 1
    while positions(n, growth)[-1] < length * (1.0 - 1e-12):
        n += 1
    low, high = 1.0, growth
    if positions(n, low)[-1] >= length:  # evenly spaced, the last interval shared among all
        n = max(int(np.rint(length / finest)), 1)
        return np.linspace(0.0, length, n + 1)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if positions(n, middle)[-1] < length else (low, middle)
    return positions(n, high)
