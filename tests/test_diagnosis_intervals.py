"""The study of what strengths are off by without noise."""

import pytest

from benchmarks import diagnosis_intervals
from tests.blind import hmi_generator as blind


def test_errors_are_summed_up_by_cause_and_fits_that_failed_are_left_out():
    errors = [("perfusion", 0.2, -1.0, True), ("perfusion", -0.6, -2.0, False), ("damage-law", None, 1.5, False)]
    keys = ("name", "without noise", "in the record", "covered")
    found = [dict(zip(keys, values, strict=True)) for values in errors]
    summary = diagnosis_intervals.summed_up(found)
    assert summary["perfusion"]["without noise"] == {"mean": pytest.approx(-0.2), "largest": -0.6}
    assert "without noise" not in summary["damage-law"]
    assert summary["all"]["sets"] == 3 and summary["all"]["covered"] == 1
    assert summary["all"]["in the record"] == {"mean": pytest.approx(-0.5), "largest": -2.0}


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_without_noise_the_mesh_moves_a_strength_by_less_than_noise_does():
    """Noise moves it by one standard error; of a drift of the output, which heat has no part in."""
    line = {
        "part": "known", "name": "output-drift", "seed": 1, "d_prime": 4.5, "size": blind.NOISE, "strength": 0.15,
        "estimate": 0.19, "interval": [0.11, 0.27], "covered": True,
    }  # fmt: skip
    found = diagnosis_intervals.one_set(line)
    assert abs(found["without noise"]) < 1.0
    assert found["in the record"] == pytest.approx(1.0)
