"""The benchmarks run: what they measure is for idle machines, not for tests."""

import json
import sys

import pytest

from benchmarks import acoustics


@pytest.mark.slow
def test_benchmark_of_the_sound_field_runs(tmp_path, monkeypatch):
    out = tmp_path / "acoustics.json"
    monkeypatch.setattr(sys, "argv", ["acoustics", "--quick", "--out", str(out)])
    acoustics.main()
    found = json.loads(out.read_text())
    case = found["five layers, 50 W"]["float32"]
    assert set(case["errors"]["T3"]) == {*acoustics.LIMITS, "within"}
    assert case["forward"]["min_s"] > 0.0 and case["forward"]["temp_mb"] > 0.0
    assert case["gradient, 1 steps per checkpoint"]["over_forward"] > 0.0
    assert found["growth, float32"]["harmonics"]["sizes"] == list(acoustics.QUICK.harmonics)
    assert found["attenuations at once, float32"][0]["members"] == 2
    assert found["paper's run"]["float32"]["repeats"] == 1


def test_errors_are_those_against_the_stored_fields(monkeypatch):
    """A stored field that is 1 % larger is 1 % off, and the limits tell."""
    z = acoustics.positions(acoustics.np.load(acoustics.REFERENCE / "T3_P50.npz")["z_m"], 0.5e-3)
    assert acoustics.np.all(acoustics.np.diff(z) <= 0.505e-3)
    assert z[0] < acoustics.FOCUS[0] and z[-1] > acoustics.FOCUS[1]
