"""The study of what strengths are off by without noise."""

import pytest

from benchmarks import diagnosis_intervals
from tests.blind import hmi_generator as blind


def _line(name: str, seed: int, strength: float, estimate: float, interval: list[float]) -> dict:
    covered = interval[0] <= strength <= interval[1]
    return {
        "part": "known", "name": name, "seed": seed, "d_prime": 4.5, "size": blind.NOISE, "strength": strength,
        "estimate": estimate, "interval": interval, "covered": covered,
    }  # fmt: skip


def test_errors_are_summed_up_by_cause_and_fits_that_failed_are_left_out():
    errors = [("perfusion", 0.2, -1.0), ("perfusion", -0.6, -2.0), ("damage-law", None, 1.5)]
    found = [
        _line(name, 1, 1.0, 1.0, [0.0, 0.5 + 1.0 * (quiet is None)]) | {"without noise": quiet, "in the record": loud}
        for name, quiet, loud in errors
    ]
    summary = diagnosis_intervals.summed_up(found)
    assert summary["perfusion"]["without noise"] == {"mean": pytest.approx(-0.2), "largest": -0.6}
    assert "without noise" not in summary["damage-law"]
    assert summary["all"]["sets"] == 3 and summary["all"]["covered"] == 1
    assert summary["all"]["in the record"] == {"mean": pytest.approx(-0.5), "largest": -2.0}


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_without_noise_the_mesh_moves_a_strength_by_less_than_noise_does():
    """Both meshes differ by less than d' of 2 in this tissue, of which a strength that is no heat takes a part."""
    hidden, off = 0.15, 0.19
    found = diagnosis_intervals.one_set(_line("output-drift", 1, hidden, off, [0.11, 0.27]))
    assert abs(found["without noise"]) < 1.0
    assert found["in the record"] == pytest.approx((off - hidden) / 0.04)
