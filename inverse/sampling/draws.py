"""Draws of a posterior, whichever sampler they come from."""

import dataclasses

import numpy as np
from jaxtyping import Float


@dataclasses.dataclass(frozen=True)
class Draws:
    """Draws of a posterior density and how they were made.

    Attributes:
        unconstrained: The flat vectors u of the problem.
        log_density: Logarithm of the posterior density of each u, but for the evidence [nats].
        statistics: More about each draw, with shape (chain, draw), by the names that ArviZ knows: `diverging`,
            `acceptance_rate`, `n_steps`, `tree_depth`, `energy`.
        sampler: Its name and version.
        seed: From which the run follows.
        settings: What the sampler was told and what it found out before it drew, for the record.
        finished: Whether the sampler's own rule for stopping was met.
        message: Why it stopped, and what to do where the rule was not met.
        evaluations: How often the density, or the density with its gradient, was evaluated, but for warm-up.
        seconds: Wall time of the run, over all sittings, compilation included [s].
        walkers: Whether chains are walkers of one ensemble, which learn from one another.
    """

    unconstrained: Float[np.ndarray, "chain draw n"]
    log_density: Float[np.ndarray, "chain draw"]
    statistics: dict[str, np.ndarray]
    sampler: str
    seed: int
    settings: dict[str, str | int | float]
    finished: bool
    message: str
    evaluations: int
    seconds: float
    walkers: bool = False

    @property
    def n_chains(self) -> int:
        """Chains, or walkers."""
        return self.unconstrained.shape[0]

    @property
    def n_draws(self) -> int:
        """Draws of each chain."""
        return self.unconstrained.shape[1]

    @property
    def flat(self) -> Float[np.ndarray, "all n"]:
        """All chains one after the other."""
        return self.unconstrained.reshape(-1, self.unconstrained.shape[2])

    @property
    def divergences(self) -> int:
        """Transitions in which the integration of NUTS broke down; 0 for other samplers."""
        return int(np.sum(self.statistics.get("diverging", np.zeros(1))))

    def thinned(self, every: int) -> "Draws":
        """Every so-manieth draw of each chain."""
        return dataclasses.replace(
            self,
            unconstrained=self.unconstrained[:, ::every],
            log_density=self.log_density[:, ::every],
            statistics={name: values[:, ::every] for name, values in self.statistics.items()},
            settings={**self.settings, "thinned_by": every * int(self.settings.get("thinned_by", 1))},
        )

    def spread_evenly(self, count: int) -> Float[np.ndarray, "some n"]:
        """At most so many of the draws, evenly over all chains."""
        flat = self.flat
        return flat[np.unique(np.linspace(0, len(flat) - 1, min(count, len(flat))).astype(int))]
