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
_Set = tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]
"""Readings of one sweep in the order in which they are taken: temperatures [degC] and frequencies [Hz]."""


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
        """Sets of readings, each of one sweep, in the order in which they are taken."""
        spent = [np.maximum(pace, 1.0 / one) if has_time else np.full(len(one), pace) for _, one in sets]
        for one in spent:
            one[0] += pause
        clock = float(time.max()) + np.cumsum(np.concatenate(spent))
        each, frequency = (np.concatenate(part) for part in zip(*sets, strict=True))
        return DmaProposal(name, words, frequency, each, clock, sample, has_time)

    low, high = mine.frequency_hz.min(), mine.frequency_hz.max()
    decade = np.geomspace(1.0, _DECADE, _A_DECADE + 1)
    lower, higher = low / _DECADE * decade[:-1], high * decade[1:]
    found = [
        taken("again", "the same sweeps once more", visited),
        taken(
            "lower-frequencies", f"one decade of frequencies below {low:.3g} Hz at every temperature",
            [_steady(at, lower) for at, _ in visited],
        ),
        taken(
            "higher-frequencies", f"one decade of frequencies above {high:.3g} Hz at every temperature",
            [_steady(at, higher) for at, _ in visited],
        ),
        taken(
            "random-order", "the same sweeps once more, frequencies in random order",
            [(at[order], one[order]) for at, one in visited for order in [rng.permutation(len(one))]],
        ),
        taken(
            "reversed-temperatures", "the same sweeps once more, from the last temperature back to the first",
            visited[::-1],
        ),
    ]  # fmt: skip
    between = _between(visited, temperature)
    if between:
        # As fine as they are: a degree off, it would be one of its neighbours.
        listed = ", ".join(f"{round(float(at[0]), 2):g}" for at, _ in between)
        found.append(taken("between", f"sweeps at {listed} degC, between those that were measured", between))
    return tuple(found)


def _steady(temperature: Float[np.ndarray, " _"], frequency: Float[np.ndarray, " other"]) -> _Set:
    """Other frequencies at a sweep's mean temperature."""
    return np.full(len(frequency), np.mean(temperature)), frequency


def _between(visited: Sequence[_Set], measured: Float[np.ndarray, " row"]) -> list[_Set]:
    """Sweeps midway between neighbours, as full as the fuller one."""
    warmer = sorted(visited, key=lambda one: float(np.mean(one[0])))
    pairs = zip(warmer, warmer[1:], strict=False)
    midway = [(0.5 * (np.mean(a) + np.mean(b)), max(one, other, key=len)) for (a, one), (b, other) in pairs]
    # Nearer, it would make one sweep of its neighbours.
    return [(np.full(len(one), at), one) for at, one in midway if np.min(np.abs(measured - at)) > SWEEP_GAP]


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
    """Sweeps of a sample in the order in which they were begun, each reading at its own temperature.

    A frequency that was read several times in one sweep is there once.
    """
    found = []
    for sweep in group_sweeps(data):
        time = np.asarray(sweep.data.time_s)
        order = np.argsort(time, kind="stable")
        first = np.unique(frequency_groups(sweep.data.frequency_hz)[order], return_index=True)[1]
        rows = order[np.sort(first)]
        found.append((time.min(), sweep.data.temperature_c[rows], sweep.data.frequency_hz[rows]))
    return [(at, frequency) for _, at, frequency in sorted(found, key=lambda one: one[0])]


def _pace(time: Float[np.ndarray, " row"], temperature: Float[np.ndarray, " row"]) -> tuple[float, float]:
    """Time from one reading to the next, and how much longer it takes to another temperature [s]."""
    order = np.argsort(time, kind="stable")
    steps, other = np.diff(time[order]), np.abs(np.diff(temperature[order])) > SWEEP_GAP
    if np.all(other):
        # Every reading at another temperature than the one before: how long one takes by itself, nothing says.
        return (float(np.median(steps)) if len(steps) else 1.0), 0.0
    pace = float(np.median(steps[~other]))
    return pace, max(float(np.median(steps[other])) - pace, 0.0) if np.any(other) else 0.0
