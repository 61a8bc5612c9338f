"""Measurements that one could make next, beside a dynamic mechanical analysis that has been made."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from inverse.datasets.dma import DmaData
from inverse.datasets.dma_checks import SWEEP_GAP

_DECADE = 10.0
_A_DECADE = 7
"""Frequencies in a decade that is added."""


@dataclasses.dataclass(frozen=True)
class DmaProposal:
    """Further readings of the same sample.

    Attributes:
        name: Short.
        words: What to do.
        frequency: Of each reading, in the order in which they are taken [Hz].
        temperature: [degC].
        time: Since the first reading of all [s].
        sample: Which sample of the data is measured again.
        has_time: Whether the data give time; without, readings are counted.
    """

    name: str
    words: str
    frequency: Float[np.ndarray, " row"]
    temperature: Float[np.ndarray, " row"]
    time: Float[np.ndarray, " row"]
    sample: str
    has_time: bool = True

    def __len__(self) -> int:
        """Number of readings."""
        return len(self.frequency)

    @property
    def seconds(self) -> float | None:
        """From the first of its readings to the last [s]; None where the data give no time."""
        return float(self.time[-1] - self.time[0]) if self.has_time else None

    @property
    def keys(self) -> dict[str, float | str]:
        """None: no experiment file says anything of a DMA."""
        return {}


def dma_proposals(data: DmaData, *, sample: str | None = None, seed: int = 0) -> tuple[DmaProposal, ...]:
    """What can be done with the same instrument and sample, each about as long as what has been done.

    Args:
        data: What was measured.
        sample: That is measured again; the first of several without.
        seed: Of orders that are drawn.
    """
    rng = np.random.default_rng(seed)
    if sample is None:
        sample = data.sample[0] if data.sample else ""
    rows = [row for row in range(len(data)) if not data.sample or data.sample[row] == sample]
    frequency, temperature = data.frequency_hz[rows], data.temperature_c[rows]
    time = np.arange(len(rows), dtype=float) if data.time_s is None else np.asarray(data.time_s, dtype=float)[rows]
    visited = _visits(temperature, time)
    grid = np.unique(np.round(frequency, 12))
    pace, pause = _pace(time, temperature)
    end = float(time.max())

    def taken(
        name: str, words: str, order: list[float], frequencies: Callable[[], Float[np.ndarray, " f"]]
    ) -> DmaProposal:
        sets = [frequencies() for _ in order]
        spent = [np.full(len(one), pace) for one in sets]
        for one in spent:
            one[0] += pause
        clock = end + np.cumsum(np.concatenate(spent))
        each = np.repeat(np.asarray(order), [len(one) for one in sets])
        return DmaProposal(name, words, np.concatenate(sets), each, clock, sample, data.time_s is not None)

    low, high = grid.min(), grid.max()
    between = [0.5 * (a + b) for a, b in zip(sorted(visited), sorted(visited)[1:], strict=False)]
    # Nearer, it would make one sweep of its neighbours.
    between = [one for one in between if np.min(np.abs(temperature - one)) > SWEEP_GAP]
    found = [
        taken("again", "the same sweeps once more", visited, lambda: grid),
        taken(
            "lower-frequencies", f"one decade of frequencies below {low:.3g} Hz at every temperature", visited,
            lambda: np.geomspace(low / _DECADE, low, _A_DECADE + 1)[:-1],
        ),
        taken(
            "higher-frequencies", f"one decade of frequencies above {high:.3g} Hz at every temperature", visited,
            lambda: np.geomspace(high, high * _DECADE, _A_DECADE + 1)[1:],
        ),
        taken(
            "random-order", "the same sweeps once more, frequencies in random order", visited,
            lambda: rng.permutation(grid),
        ),
        taken(
            "reversed-temperatures", "the same sweeps once more, from the last temperature back to the first",
            visited[::-1], lambda: grid,
        ),
    ]  # fmt: skip
    if between:
        listed = ", ".join(f"{one:.0f}" for one in between)
        found.append(
            taken("between", f"sweeps at {listed} degC, between those that were measured", between, lambda: grid)
        )
    return tuple(found)


def _visits(temperature: Float[np.ndarray, " row"], time: Float[np.ndarray, " row"]) -> list[float]:
    """Temperatures in the order in which they were visited first [degC]."""
    found: list[float] = []
    for value in temperature[np.argsort(time, kind="stable")]:
        if all(abs(value - one) > SWEEP_GAP for one in found):
            found.append(float(value))
    return found


def _pace(time: Float[np.ndarray, " row"], temperature: Float[np.ndarray, " row"]) -> tuple[float, float]:
    """Time from one reading to the next, and how much longer it takes to another temperature [s]."""
    order = np.argsort(time, kind="stable")
    steps, other = np.diff(time[order]), np.abs(np.diff(temperature[order])) > SWEEP_GAP
    pace = float(np.median(steps[~other])) if np.any(~other) else 1.0
    return pace, max(float(np.median(steps[other])) - pace, 0.0) if np.any(other) else 0.0
