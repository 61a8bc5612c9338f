"""Measurements that one could make next, beside a dynamic mechanical analysis that has been made."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from inverse.datasets.dma import DmaData, frequency_groups, group_sweeps
from inverse.datasets.dma_checks import SWEEP_GAP

_DECADE = 10.0
_A_DECADE = 7
"""Frequencies in a decade that is added."""
_Set = tuple[float, Float[np.ndarray, " _"]]
"""Readings at one temperature [degC]: their frequencies in the order in which they are taken [Hz]."""


@dataclasses.dataclass(frozen=True)
class DmaProposal:
    """Further readings of the same sample.

    Attributes:
        name: Short.
        words: What to do.
        frequency: Of each reading, in the order in which they are taken [Hz].
        temperature: [degC].
        time: On the clock of the data [s]; see `clock_of`.
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
    """What can be done with the same instrument and sample, at the pace of what has been done.

    Where the data give time, a reading takes one period of its frequency at least.

    Args:
        data: What was measured.
        sample: That is measured again; the first of several without.
        seed: Of orders that are drawn.
    """
    rng = np.random.default_rng(seed)
    if sample is None:
        sample = data.sample[0] if data.sample else ""
    has_time = data.time_s is not None
    data = dataclasses.replace(data, time_s=clock_of(data))
    mine = data.select(np.array([not data.sample or label == sample for label in data.sample or ("",) * len(data)]))
    time, temperature = np.asarray(mine.time_s), mine.temperature_c
    visited = _visits(mine)
    pace, pause = _pace(time, temperature)

    def taken(name: str, words: str, sets: Sequence[_Set]) -> DmaProposal:
        """Sets of readings, each at one temperature, in the order in which they are taken."""
        spent = [np.maximum(pace, 1.0 / one) if has_time else np.full(len(one), pace) for _, one in sets]
        for one in spent:
            one[0] += pause
        clock = float(time.max()) + np.cumsum(np.concatenate(spent))
        each = np.repeat([at for at, _ in sets], [len(one) for _, one in sets])
        return DmaProposal(name, words, np.concatenate([one for _, one in sets]), each, clock, sample, has_time)

    low, high = mine.frequency_hz.min(), mine.frequency_hz.max()
    decade = np.geomspace(1.0, _DECADE, _A_DECADE + 1)
    lower, higher = low / _DECADE * decade[:-1], high * decade[1:]
    found = [
        taken("again", "the same sweeps once more", visited),
        taken(
            "lower-frequencies", f"one decade of frequencies below {low:.3g} Hz at every temperature",
            [(at, lower) for at, _ in visited],
        ),
        taken(
            "higher-frequencies", f"one decade of frequencies above {high:.3g} Hz at every temperature",
            [(at, higher) for at, _ in visited],
        ),
        taken(
            "random-order", "the same sweeps once more, frequencies in random order",
            [(at, rng.permutation(one)) for at, one in visited],
        ),
        taken(
            "reversed-temperatures", "the same sweeps once more, from the last temperature back to the first",
            visited[::-1],
        ),
    ]  # fmt: skip
    warmer = sorted(visited, key=lambda one: one[0])
    pairs = zip(warmer, warmer[1:], strict=False)
    between = [(0.5 * (a + b), max(one, other, key=len)) for (a, one), (b, other) in pairs]
    # Nearer, it would make one sweep of its neighbours.
    between = [(at, one) for at, one in between if np.min(np.abs(temperature - at)) > SWEEP_GAP]
    if between:
        # As fine as they are: a degree off, it would be one of its neighbours.
        listed = ", ".join(f"{round(at, 2):g}" for at, _ in between)
        found.append(taken("between", f"sweeps at {listed} degC, between those that were measured", between))
    return tuple(found)


def clock_of(data: DmaData) -> Float[np.ndarray, " row"]:
    """Time of each row [s]; rows counted through each sample, as a diagnosis does, where the data give none."""
    if data.time_s is not None:
        return np.asarray(data.time_s, dtype=float)
    labels = np.array(data.sample or ("",) * len(data))
    time = np.zeros(len(data))
    for label in np.unique(labels):
        time[labels == label] = np.arange(np.sum(labels == label))
    return time


def _visits(data: DmaData) -> list[_Set]:
    """Temperatures of a sample in the order in which they were visited first [degC], frequencies as taken there [Hz].

    A frequency that was read several times at one temperature is there once.
    """
    found = []
    for sweep in group_sweeps(data):
        time = np.asarray(sweep.data.time_s)
        order = np.argsort(time, kind="stable")
        first = np.unique(frequency_groups(sweep.data.frequency_hz)[order], return_index=True)[1]
        found.append((time.min(), sweep.temperature_c, sweep.data.frequency_hz[order][np.sort(first)]))
    return [(at, frequency) for _, at, frequency in sorted(found, key=lambda one: one[0])]


def _pace(time: Float[np.ndarray, " row"], temperature: Float[np.ndarray, " row"]) -> tuple[float, float]:
    """Time from one reading to the next, and how much longer it takes to another temperature [s]."""
    order = np.argsort(time, kind="stable")
    steps, other = np.diff(time[order]), np.abs(np.diff(temperature[order])) > SWEEP_GAP
    pace = float(np.median(steps[~other])) if np.any(~other) else 1.0
    return pace, max(float(np.median(steps[other])) - pace, 0.0) if np.any(other) else 0.0
