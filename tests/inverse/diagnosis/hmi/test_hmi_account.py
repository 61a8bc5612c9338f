"""What a report says of a curve: early dip, peak after it, end."""

import numpy as np
import pytest

from inverse.diagnosis.hmi.account import curve_features

TEMPERATURE = np.array([37.0, 45.0, 59.0, 70.0, 84.0])


@pytest.mark.parametrize(
    ("percent", "features"),
    [
        # The third sonication of Suomi et al. 2016: the first reading is as high as the peak.
        ([100.0, 96.0, 100.0, 85.0, 65.0], ["96 at 45 degC", "100 at 59 degC", "65 at 84 degC"]),
        # The first: still above its start in the end.
        ([100.0, 99.0, 104.0, 110.0, 96.0], ["99 at 45 degC", "110 at 70 degC", "96 at 84 degC"]),
        # No dip: it rises from the start.
        ([100.0, 102.0, 105.0, 85.0, 65.0], ["none", "105 at 59 degC", "65 at 84 degC"]),
        # Neither.
        ([100.0, 99.0, 96.0, 85.0, 65.0], ["none", "none", "65 at 84 degC"]),
    ],
)
def test_features_of_a_curve(percent, features):
    assert curve_features(np.array(percent), TEMPERATURE) == features
