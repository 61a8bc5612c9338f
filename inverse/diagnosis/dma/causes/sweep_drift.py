"""Drift of the reading within each sweep."""

from jaxtyping import Array, Complex

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.dma.cause import DmaCause, DmaState


class SweepDrift(DmaCause):
    """Drift of the reading within each sweep."""

    name = "sweep-drift"
    place = "instrument: calibration in time"
    unit = "1 per sweep"
    sign = 0
    plausible = 0.1
    least = -0.95
    sentence = "The reading drifts in the course of each sweep, by the same part in all of them."
    helps = "Frequencies in random order, or the first frequency repeated at the end of each sweep."
    source = (
        "Mours & Winter (1994), doi 10.1007/bf00366581: each reading of a sweep is of another state of a sample that "
        "changes; scale assumed: a tenth in a sweep"
    )

    def measured(
        self, modulus: Complex[Array, " row"], state: DmaState, strength: Strength, shape: Strength
    ) -> Complex[Array, " row"]:
        """Modulus times one plus the share of the sweep that has passed."""
        del shape
        return modulus * (1.0 + strength * state.conditions.time_in_sweep)
