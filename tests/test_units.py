"""Conversions at the border."""

import pytest

from arfjax import units


def test_decibel_and_neper():
    assert units.from_db_per_cm(1.0) == pytest.approx(11.512925464970229, rel=1e-14)  # 100 ln(10) / 20
    assert units.to_db_per_cm(units.from_db_per_cm(0.35)) == pytest.approx(0.35, rel=1e-14)
