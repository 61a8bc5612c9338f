"""Dry friction, as causes share it."""

import math

HYSTERESIS = 4.0 / (3.0 * math.pi)
"""Loss over the stiffness that friction takes away, on the branches of a parabolic loop."""
