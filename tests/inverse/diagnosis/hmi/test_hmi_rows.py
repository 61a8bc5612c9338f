"""Data in percent are what they are, and what cannot be compared is refused."""

import numpy as np
import pytest

from arfjax import InputError
from inverse.diagnosis.hmi.courses import hmi_rows
from tests.inverse.diagnosis.hmi.cases import TEMPERATURES, curves


def test_reading_that_a_curve_was_divided_by_is_one_of_its_rows():
    percent = np.full(len(TEMPERATURES), 97.0)
    rows = hmi_rows(curves(percent), 37.0)
    assert len(rows) == len(TEMPERATURES) + 2 and int(np.sum(rows.is_reference)) == 2
    assert rows.temperature[-1] == 37.0 and rows.log_displacement[-1] == np.log(100.0)
    percent[[0, 13]] = 100.0
    again = hmi_rows(curves(percent), 37.0)
    assert len(again) == len(TEMPERATURES) and list(np.flatnonzero(again.is_reference)) == [0, 13]


def test_a_displacement_that_is_not_positive_is_refused():
    percent = np.full(len(TEMPERATURES), 97.0)
    percent[4] = -1.0
    with pytest.raises(InputError, match="row 5.*positive"):
        hmi_rows(curves(percent), 37.0)
