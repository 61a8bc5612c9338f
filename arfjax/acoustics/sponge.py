"""The absorbing ring that takes what leaves the beam before it comes back from the end of the domain.

It is not part of the physics, and nothing of it has to be resolved: it acts once every so many steps, and only then are
the nodes of the ring, about half of all, transformed at all.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from arfjax.acoustics.settings import MarchSettings
from arfjax.numerics.hankel import HankelBasis

_SPACING = 1.0 / 64.0
"""Axial distance between two passes, in radii of the domain. Against a pass in every step it changes the field about a
focus by 2e-5 of its peak, twice of it by 6e-5 and four times by 4e-4 (bowl of 64 mm, F/0.98, 1.1 MHz)."""


class Sponge(NamedTuple):
    """The ring on the nodes of a series.

    Attributes:
        n_clean: How many nodes from the axis lie inside the ring.
        loss: At the nodes beyond those, the farther out the stronger [Np/m].
        spacing: Shortest axial distance between two passes [m].
    """

    n_clean: int
    loss: Float[np.ndarray, " outer"]
    spacing: float

    def pass_lengths(self, step_lengths: Float[np.ndarray, " step"]) -> Float[np.ndarray, " step"]:
        """After each step, over what length the ring acts [m]: 0 after most, and after the last over what is left."""
        covered = np.cumsum(step_lengths)
        due = np.diff(np.floor(covered / self.spacing), prepend=0.0) > 0.0
        due[-1:] = True
        lengths = np.zeros_like(covered)
        lengths[due] = np.diff(covered[due], prepend=0.0)
        return lengths


def sponge_depth(basis: HankelBasis, settings: MarchSettings) -> Float[np.ndarray, " node"]:
    """How far into the ring each node is, from 0 to 1."""
    fraction = basis.nodes / settings.domain_radius
    return np.clip((fraction - settings.sponge_start) / (settings.sponge_end - settings.sponge_start), 0.0, 1.0)


def absorbing_ring(basis: HankelBasis, settings: MarchSettings) -> Sponge:
    """The ring as the settings have it."""
    depth = sponge_depth(basis, settings)
    n_clean = int(np.count_nonzero(depth == 0.0))
    loss = settings.sponge_strength / settings.domain_radius * depth[n_clean:] ** 2
    return Sponge(n_clean, loss, _SPACING * settings.domain_radius)
