"""What a course of heating cannot fix, because of when its rows were read."""

import dataclasses

import numpy as np

from inverse.uncertainty import Uncertainty

_NEAR_A_ROW = 0.05
"""Part of the time between rows within which an end of the heat counts as at one."""
_COOLING_ROWS = 2  # after the heat is switched off, without which nobody saw that it was


def of_short_heat(uncertainty: Uncertainty, values: np.ndarray, time: np.ndarray) -> Uncertainty:
    """What rows cannot fix between which all of the heat lies.

    Where no two rows lie well within it, another start and duration between the same rows fits as well: errors of a
    linearised course, which has its kinks between rows, do not know that.
    """
    _, _, _, start, duration = values
    least = _NEAR_A_ROW * float(np.median(np.diff(time)))
    margins = (max(2.0 * float(uncertainty.standard_errors[at]), least) for at in (3, 4))
    from_start, from_end = margins
    inside = int(np.sum((time > start + from_start) & (time < start + duration - from_end)))
    if inside >= 2:
        return uncertainty
    rows = "no row lies" if inside == 0 else "a single row lies"
    unseen = {
        name: f"{name} is that of one of many courses: {rows} well within the heat of {duration:.3g} s, so that it may "
        "have begun and ended elsewhere between the same rows."
        for name in ("start", "duration")
    }
    return dataclasses.replace(uncertainty, not_identified={**uncertainty.not_identified, **unseen})


def of_switch_off(uncertainty: Uncertainty, values: np.ndarray, time: np.ndarray) -> Uncertainty:
    """What a course cannot fix that ends while it is heated, or a row later."""
    _, _, _, start, duration = values
    after = int(np.sum(time > start + duration))
    if after >= _COOLING_ROWS:
        return uncertainty
    rows = "no row lies" if after == 0 else "a single row lies"
    unseen = {
        "duration": f"duration is a lower bound: {rows} after {start + duration:.4g} s, where the fit ends the heat, "
        "so that it may have gone on.",
        "amplitude": "amplitude is the rise when the heat is switched off, and a lower bound with it.",
    }
    return dataclasses.replace(uncertainty, not_identified={**uncertainty.not_identified, **unseen})
