"""What more than one command has to say about its results."""

import math
from typing import SupportsFloat

import numpy as np

from arfjax import (
    DamageEdge,
    Discretisation,
    DoseSize,
    Experiment,
    Heating,
    Model,
    SonicationResult,
    extrapolations,
    range_notes,
)
from arfjax.experiment.monitoring import MonitoringSection
from arfjax.thermal.bioheat import border_rise
from arfjax.thermal.damage import LETHAL_DOSE_MINUTES

WATCHED = ("sonication", "monitoring", "mechanics", "lesion")
"""Sections that a sonication with its displacement comes from."""

_LOWEST_FREQUENCY = 0.25e6  # Hz; there the field is within 0.5 percent of its peak
_LONGEST_WITHOUT_FLOW = 600.0  # s; until then the focus does not feel the walls, and 10 mm from it 3 percent are missed
_BODY_TEMPERATURE = 37.0  # degC
_COOLING_RISE = 0.5  # K


def assumed_notes(described: Experiment, *sections: str, power: SupportsFloat = 0.0) -> list[str]:
    """What was taken in place of those of these sections that the file does not have.

    Args:
        described: The file.
        sections: Names of those that a command uses.
        power: That of the sonication [W].
    """
    phases = [f"{one.duration_s:g} s at {one.relative_power * float(power):g} W" for one in described.sonication.phases]
    assumed = {
        "sonication": f"{', then '.join(phases)}, from {described.sonication.start_temperature_c:g} degC",
        "monitoring": described.monitoring.words(),
        "mechanics": f"that tabulated moduli are Young's, with Poisson's ratio {described.mechanics.poisson_ratio:g}",
        "lesion": "a lesion as large as 240 equivalent minutes reach, with constants linear from its centre",
    }
    missing = [name for name in sections if name not in described.model_fields_set]
    return [f"the file has no [{name}]: assumed is {assumed[name]}." for name in missing]


def boiling_notes(boiling_time: SupportsFloat) -> list[str]:
    """A warning where tissue reaches 100 degC at a time [s] that is not NaN."""
    time = float(boiling_time)
    if math.isnan(time):
        return []
    return [f"tissue reaches 100 degC at {time:g} s: it would boil, which is not simulated; do not trust what follows."]


def heated_range_notes(
    model: Model, described: Experiment, settings: Discretisation, result: SonicationResult
) -> list[str]:
    """Laws of the layers beyond their range, over all temperatures that a sonication makes in them."""
    temperature, owner, found = np.asarray(result.temperature), np.asarray(settings.layer_of_cell), []
    for index in sorted(set(settings.layer_of_cell)):
        inside = temperature[:, :, owner == index]
        found += extrapolations(model.layers[index].tissue, inside, name=described.layers[index].tissue)
    lead = "for the field, attenuation and sound speed are held at the ends of the ranges named here:"
    return [lead, *found] if found else []


def lesion_range_notes(model: Model, result: SonicationResult) -> list[str]:
    """Laws of the lesion beyond their range, over what its tissue remembers: the hottest so far.

    That of the focus where the lesion is an ellipsoid, that of each cell where it has the shape of the dose.
    """
    lethal = np.asarray(result.lesion.length) > 0.0
    hottest = np.maximum.accumulate(np.asarray(result.focal_temperature))[lethal]
    if isinstance(model.lesion.edge, DamageEdge):
        cells = np.maximum.accumulate(np.asarray(result.temperature), axis=0)
        size = model.lesion.size
        threshold = size.threshold if isinstance(size, DoseSize) else LETHAL_DOSE_MINUTES
        hottest = cells[np.asarray(result.dose) >= float(threshold)]
    return extrapolations(model.lesion, hottest, name="lesion")


def central_range_notes(model: Model, focal_temperature: np.ndarray, lesion_length: np.ndarray) -> list[str]:
    """Laws of liver and lesion beyond their range, in the run of the central constants.

    Args:
        model: With those constants.
        focal_temperature: Of that run [degC].
        lesion_length: At the same times or temperatures [m].
    """
    hottest = np.maximum.accumulate(np.asarray(focal_temperature))
    return [f"with the central constants, {note}" for note in range_notes(model, hottest, np.asarray(lesion_length))]


def sound_notes(settings: Discretisation, *factors: float) -> list[str]:
    """Warnings where the sound field falls short of its tolerance, or where its heat is scaled by a power's factor.

    Heat of nonlinear sound may not be scaled by any other factor than 0 and 1.
    """
    short = [f"the sound field is not within its tolerance: {settings.shortcoming}."] if settings.shortcoming else []
    return short + scaling_notes(settings, *factors)


def modulation_notes(settings: Discretisation, monitoring: MonitoringSection) -> list[str]:
    """A warning where the mean heat of a modulated beam is taken as a share of its strongest moment's.

    Exact where heat goes with the power, and where the beam is on or off.
    """
    share = monitoring.mean_force()
    if settings.march.n_harmonics == 1 or monitoring.modulation == "square" or share > 0.99:
        return []
    return [
        f"heat is that of the beam at its strongest times the mean of its modulation, {share:.3g}, but nonlinear sound "
        "of weaker moments heats in another shape; only that of a beam that is on or off (square) is exact."
    ]


def border_notes(rise: SupportsFloat) -> list[str]:
    """A warning where the border of the grid warms by a rise [K] that its walls, held at the start, take away."""
    if not float(rise) > _COOLING_RISE:
        return []
    return [
        f"the border of the grid warms by {float(rise):.1f} K beside walls that are held; the walls cool the focus."
    ]


def heated_border_notes(heating: Heating, temperature: float) -> list[str]:
    """That warning of a sonication up to where its focus comes to a temperature [degC]."""
    reached = int(np.searchsorted(np.asarray(heating.focal_temperature), temperature))
    return border_notes(border_rise(heating.temperature[: reached + 1]))


def grid_notes(model: Model, duration: float = 0.0) -> list[str]:
    """Warnings where the grids' size no longer suits what runs on them; see `march_settings` and `discretise`.

    Args:
        model: The model.
        duration: Of a sonication, in all [s].
    """
    notes, frequency = [], float(model.drive.frequency)
    if frequency < _LOWEST_FREQUENCY:
        notes.append(
            f"the sound field's domain is narrow for waves as long as at {1e-6 * frequency:g} MHz: its largest error "
            "over its peak is 0.5 % at 0.25 MHz, 2.2 % at 0.15 and 29 % at 0.05."
        )
    # As it is at the start: flow that stops as tissue coagulates goes on around the lesion.
    flows = np.any(np.asarray(model.liver.perfusion_rate.after(_BODY_TEMPERATURE, 0.0)) > 0.0)
    if duration > _LONGEST_WITHOUT_FLOW and not flows:
        notes.append(
            f"heat is followed over {duration:g} s without blood flow, within walls up to 20 mm from the focus that "
            "stay as warm as at the start: after 1800 s the rise at the focus is 1.1 % too low, 10 mm from it 20 %."
        )
    return notes


def scaling_notes(settings: Discretisation, *factors: float) -> list[str]:
    """A warning where heat of nonlinear sound is scaled by a power's factor, which may be 0 or 1."""
    scaled = [factor for factor in factors if factor > 0.0 and abs(factor - 1.0) > 0.01]
    if settings.march.n_harmonics == 1 or not scaled:
        return []
    factor = max(scaled, key=lambda each: abs(math.log(each)))
    return [
        f"heat is that of the stated power times {factor:.3g}, but nonlinear sound of that other power would heat in "
        "another shape; state the power that is used."
    ]
