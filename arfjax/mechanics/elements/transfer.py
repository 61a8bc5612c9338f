"""From values on positions along a line to the Gauss points of a mesh along it, as weights.

A field on a tensor grid is carried by one matrix along r and one along z. Integrals are
kept: what Gauss quadrature on the mesh says afterwards is the integral of the interpolated field.
"""

import numpy as np
from jaxtyping import Float

from arfjax.errors import InputError
from arfjax.mechanics.elements.mesh import N_GAUSS
from arfjax.numerics.quadrature import gauss_legendre

_POINTS, _WEIGHTS = gauss_legendre(N_GAUSS)
_INNER_POINTS, _INNER_WEIGHTS = gauss_legendre(4)
"""Exact for a cubic times a parabola times the radius, between one breakpoint and the next."""


def projected(
    nodes: Float[np.ndarray, " n"], edges: Float[np.ndarray, " n_edges"], *, ring: bool, even: bool = True
) -> Float[np.ndarray, "gauss n"]:
    """Weights of the projection of the cubic interpolant onto parabolas in each element.

    The nearest parabola in the mean square has the same integral against every parabola, that is the same total, and
    the same nodal forces in biquadratic elements, as the interpolant itself. Beyond the outermost nodes the field is 0.

    Args:
        nodes: Where values are known, ascending.
        edges: Of the elements.
        ring: Whether the line is a radius, whose points stand for rings and across whose origin the field continues.
        even: With `ring`: whether the field continues with the same sign there; else with the opposite one.
    """
    position, weight, element = _between(edges, nodes)
    basis = interpolation(nodes, position, degree=3, ring=ring, even=even)
    basis = basis * ((position <= nodes[-1]) & (ring | (position >= nodes[0])))[:, None]
    middle, half = _middles(edges)
    if ring:
        weight = weight * position
    moments = _lagrange(_POINTS, (position - middle[element]) / half[element]) * weight[:, None]
    total = np.zeros((len(middle), N_GAUSS, len(nodes)))
    np.add.at(total, element, moments[:, :, None] * basis[:, None, :])
    return total.reshape(-1, len(nodes)) / _gauss_lengths(edges, ring=ring)[:, None]


def interpolation(
    nodes: Float[np.ndarray, " n"],
    position: Float[np.ndarray, " point"],
    *,
    degree: int,
    ring: bool = False,
    even: bool = True,
) -> Float[np.ndarray, "point n"]:
    """Weights of the polynomial through the nearest nodes; beyond the outermost ones their values are held.

    On a radius (`ring`) the nodes are mirrored at the origin, where an even field has no slope and an odd one vanishes.
    """
    if np.any(np.diff(nodes) <= 0.0) or (ring and nodes[0] < 0.0):
        raise InputError(f"positions must ascend{', from 0 or more' if ring else ''}, got {nodes[0]} to {nodes[-1]} m.")
    own = np.eye(len(nodes))
    if ring:
        mirrored = nodes[nodes > 0.0][::-1]
        all_nodes = np.concatenate([-mirrored, nodes])
        fold = np.concatenate([(1.0 if even else -1.0) * own[nodes > 0.0][::-1], own])
        if not even and nodes[0] == 0.0:
            fold[len(mirrored)] = 0.0
    else:
        all_nodes, fold = nodes, own
    count = min(degree + 1, len(all_nodes))
    position = np.clip(position, all_nodes[0], all_nodes[-1])
    first = np.clip(np.searchsorted(all_nodes, position) - count // 2, 0, len(all_nodes) - count)
    chosen = first[:, None] + np.arange(count)
    weights = np.stack([_lagrange(all_nodes[c], np.array([x]))[0] for c, x in zip(chosen, position, strict=True)])
    table = np.zeros((len(position), len(all_nodes)))
    np.put_along_axis(table, chosen, weights, axis=1)
    return table @ fold


def _lagrange(nodes: Float[np.ndarray, " n"], position: Float[np.ndarray, " p"]) -> Float[np.ndarray, "p n"]:
    same = np.eye(len(nodes), dtype=bool)
    gaps = np.where(same, 1.0, nodes[:, None] - nodes[None, :])
    factors = np.where(same[None], 1.0, (position[:, None, None] - nodes[None, None, :]) / gaps[None])
    return np.prod(factors, axis=2)


def _between(
    edges: Float[np.ndarray, " n_edges"], nodes: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"], np.ndarray]:
    # Quadrature points and weights on the intervals between all edges and nodes, and the element of each point.
    inside = nodes[(nodes > edges[0]) & (nodes < edges[-1])]
    breaks = np.unique(np.concatenate([edges, inside]))
    middle, half = _middles(breaks)
    position = (middle[:, None] + half[:, None] * _INNER_POINTS).ravel()
    weight = (half[:, None] * _INNER_WEIGHTS).ravel()
    return position, weight, np.searchsorted(edges, np.repeat(middle, len(_INNER_POINTS)), side="right") - 1


def _middles(edges: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    return 0.5 * (edges[1:] + edges[:-1]), 0.5 * (edges[1:] - edges[:-1])


def _gauss_lengths(edges: Float[np.ndarray, " n"], *, ring: bool) -> Float[np.ndarray, " gauss"]:
    # Length (or r dr) that each Gauss point stands for.
    middle, half = _middles(edges)
    lengths = half[:, None] * _WEIGHTS
    return (lengths * (middle[:, None] + half[:, None] * _POINTS) if ring else lengths).ravel()
