"""What one looks at first in a curve of displacement: its early dip, the peak after it, where it ends."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

_DEVIATIONS = 2.0
"""Of two readings together, each by its own size: from where on what the simulation does not have is a mismatch."""
_TAKEN_AWAY = 0.5
"""Part of a mismatch that a cause has to take away to be said to."""


@dataclasses.dataclass(frozen=True)
class Curve:
    """One sonication, its readings by temperature.

    Attributes:
        label: Of the sonication.
        temperature: [degC].
        percent: Displacement, of the coldest reading's.
    """

    label: str
    temperature: Float[np.ndarray, " n"]
    percent: Float[np.ndarray, " n"]

    @property
    def features(self) -> dict[str, int]:
        """Readings of the dip, of the peak after it and of the end, by name.

        Dip and peak are the two readings, in this order, between which the curve rises most, be it by noise; one that
        starts at its dip has none, and one that never rises has neither.
        """
        rise = self.percent[None, :] - self.percent[:, None]
        rise[np.tril_indices(len(self.percent))] = -np.inf
        dip, peak = (int(row) for row in np.unravel_index(int(np.argmax(rise)), rise.shape))
        found = {"dip": dip, "peak": peak} if rise[dip, peak] > 0.0 else {}
        return {name: row for name, row in found.items() if row > 0} | {"end": len(self.percent) - 1}

    def at(self, row: int) -> str:
        """A reading in words."""
        return f"{self.percent[row]:.0f} at {self.temperature[row]:.0f} degC"

    def cells(self) -> str:
        """Dip, peak and end, of a table."""
        found = self.features
        return " | ".join(self.at(found[name]) if name in found else "none" for name in ("dip", "peak", "end"))


def mismatches(
    measured: Sequence[Curve],
    simulated: Sequence[Curve],
    with_causes: Mapping[str, Sequence[Curve]],
    *,
    size: float,
) -> list[str]:
    """Dip, peak and end of every curve as measured, where the simulation is elsewhere, and what mends each: sentences.

    Args:
        measured: Every sonication.
        simulated: The same without causes.
        with_causes: The same with each cause that is not ruled out, refitted.
        size: Relative standard deviation of a reading.
    """
    sentences, within = [], []
    for number, (target, plain) in enumerate(zip(measured, simulated, strict=True)):
        found = target.features
        if found["end"] == found.get("peak"):  # one reading, of a curve that rises to its end
            del found["end"]
        for name, row in found.items():
            gap = abs(target.percent[row] - plain.percent[row])
            # Of a ratio of two readings, the coldest and this one.
            if abs(np.log(target.percent[row] / plain.percent[row])) <= _DEVIATIONS * np.sqrt(2.0) * size:
                within.append(f"the {name} of {target.label}")
                continue
            others = {cause: curves[number].percent[row] for cause, curves in with_causes.items()}
            mending = [
                f"{cause} ({value:.0f})"
                for cause, value in others.items()
                if abs(value - target.percent[row]) <= _TAKEN_AWAY * gap
            ]
            by = f"half of it or more is mended by {', '.join(mending)}" if mending else "mended by none in question"
            sentences.append(
                f"Sonication {target.label}, {name}: {target.at(row)} measured, {plain.percent[row]:.0f} simulated; "
                f"{by}."
            )
        sentences += _elsewhere(target, plain, {cause: curves[number] for cause, curves in with_causes.items()}, size)
    if within:
        scatter = 100.0 * np.expm1(_DEVIATIONS * np.sqrt(2.0) * size)
        sentences.append(f"Not to be told from scatter, up to {scatter:.2g} % of a reading: {', '.join(within)}.")
    return sentences


def _elsewhere(target: Curve, plain: Curve, with_causes: Mapping[str, Curve], size: float) -> list[str]:
    """That the simulated curve peaks at another temperature, and which causes take its peak halfway to the measured."""
    if "peak" not in target.features or "peak" not in plain.features:
        return []
    there, here = target.features["peak"], plain.features["peak"]
    # How much more the one rises from the one reading to the other than the other does.
    lost = (target.percent[there] - target.percent[here]) + (plain.percent[here] - plain.percent[there])
    if lost <= _DEVIATIONS * size * np.hypot(target.percent[there], target.percent[here]):
        return []
    at, gap = target.temperature, abs(target.temperature[there] - target.temperature[here])
    others = {cause: curve.features["peak"] for cause, curve in with_causes.items() if "peak" in curve.features}
    mending = [
        f"{cause} (at {at[row]:.0f})"
        for cause, row in others.items()
        if abs(at[row] - at[there]) <= (1.0 - _TAKEN_AWAY) * gap
    ]
    by = f"taken halfway there or further by {', '.join(mending)}" if mending else "taken there by none in question"
    where = f"at {at[there]:.0f} degC measured, at {at[here]:.0f} degC simulated"
    return [f"Sonication {target.label}: the peak is {where}; {by}."]
