r"""When a chain has run long enough, by its own autocorrelation time.

The integrated autocorrelation time of a chain with correlations $\rho_t$ is $\tau = 1 + 2 \sum_t \rho_t$: so many steps
tell as much as one independent draw. Its estimate is too small on short chains, hence the rule.
"""

import dataclasses

import numpy as np
from emcee import autocorr
from jaxtyping import Float


def integrated_time(chain: Float[np.ndarray, "step walker n"]) -> Float[np.ndarray, " n"]:
    """Integrated autocorrelation time of each coordinate [steps]; infinite where a coordinate never moved.

    Source: Sokal's window of five times, averaged over walkers (Goodman & Weare 2010), by emcee.
    """
    moved = np.ptp(chain, axis=0) > 0.0
    times = np.full(chain.shape[2], np.inf)
    for index in range(chain.shape[2]):
        walkers = chain[:, moved[:, index], index]
        if walkers.shape[1] and len(chain) > 1:
            times[index] = autocorr.integrated_time(walkers, tol=0)[0]
    return times


@dataclasses.dataclass(frozen=True)
class StopRule:
    """A chain is long enough at many autocorrelation times, if their estimate has settled.

    Attributes:
        times: Autocorrelation times that the chain must be longer than.
        change: Largest relative change of the estimate since the last look.
        r_hat: Largest R-hat of walkers after the burn-in. Where a posterior has a long tail that walkers creep into,
            the autocorrelation time looks short until they have.
    """

    times: float = 50.0
    change: float = 0.01
    r_hat: float = 1.01

    def long_enough(self, before: Float[np.ndarray, " n"], now: Float[np.ndarray, " n"], steps: int) -> bool:
        """Whether the rule holds but for R-hat, from the estimates at the last look and now."""
        if not (np.all(np.isfinite(before)) and np.all(np.isfinite(now))):
            return False
        return bool(np.all(steps > self.times * now) and np.all(np.abs(now - before) < self.change * now))

    def describe(self, before: Float[np.ndarray, " n"], now: Float[np.ndarray, " n"], steps: int) -> str:
        """The chain's length in autocorrelation times and their last change, in words."""
        longest = float(np.max(now))
        if not np.isfinite(longest):
            return f"{steps} steps, in which some coordinate never moved"
        said = f"{steps} steps are {steps / longest:.0f} autocorrelation times of {longest:.3g} steps"
        if not np.all(np.isfinite(before)):
            return said
        change = float(np.max(np.abs(now - before) / now))
        return f"{said}, and the times changed by {100.0 * change:.2g} % since the last look"
