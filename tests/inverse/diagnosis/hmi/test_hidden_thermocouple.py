"""The generator's thermocouple beside the focus, against a profile that is known."""

import numpy as np
import pytest

from tests.blind.hmi_effects import REACH, beside


def test_beside_the_axis_it_is_as_warm_as_a_gaussian_beam_makes_it():
    time = np.linspace(0.0, 60.0, 31)
    r = (np.arange(20) + 0.5) * 1e-4
    width = 1.5e-3 * (1.0 + time / 60.0)
    focus = 37.0 + 0.7 * time
    temperature = 37.0 + (focus - 37.0)[:, None] * np.exp(-((r / width[:, None]) ** 2))
    for s in (0.01, 0.1, 0.5, 1.0):
        expected = 37.0 + (focus - 37.0) * np.exp(-s * 1e-6 / width**2)
        np.testing.assert_allclose(beside((time, focus, r, temperature), s), expected, atol=1e-3)
    # The cells beside the focus are a little cooler than it: that is no distance.
    cooler = 37.0 + 0.99 * (temperature - 37.0)
    np.testing.assert_allclose(beside((time, focus, r, cooler), 0.0), focus, rtol=1e-12)
    with pytest.raises(ValueError, match="beyond"):
        beside((time, focus, r, temperature), 1.1e6 * REACH**2)
