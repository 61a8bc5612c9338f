"""Tracking that shortens large displacements."""

from inverse.diagnosis.cause import Strength
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States


class TrackingCompression(HmiCause):
    """Tracking that shortens large displacements."""

    name = "tracking-compression"
    place = "instruments: tracking"
    unit = "1"
    sign = 1
    plausible = 0.2
    sentence = (
        "The correlation window blurs a displacement that changes across it: large displacements are reported too "
        "small, by a part that grows with them."
    )
    helps = "Lower power, so that all displacements are small; or a shorter window."
    source = (
        "Palmeri et al. (2006): shear under the beam shortens displacements, by one part at all forces; that "
        "the part grows with the displacement, and the scale, assumed"
    )

    def measured(self, displacement: States, conditions: HmiConditions, strength: Strength, shape: Strength) -> States:
        """Each displacement loses a part in proportion to itself."""
        del conditions, shape
        return displacement * (1.0 - strength * displacement)
