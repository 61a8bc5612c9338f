"""Two sonications and the states that they are looked at in."""

from pathlib import Path

import numpy as np

from inverse.datasets.hmi import HmiData

FINAL = (64.0, 80.0)
STATES = [np.linspace(37.0, final, 13) for final in FINAL]
TEMPERATURES = np.concatenate(STATES)
LABELS = ("1",) * 13 + ("2",) * 13


def curves(percent: np.ndarray, time: np.ndarray | None = None) -> HmiData:
    return HmiData(Path("simulated"), LABELS, TEMPERATURES, time, percent, True, None, ())
