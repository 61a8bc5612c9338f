"""The benchmarks run: what they measure is for idle machines, not for tests."""

import json
import sys

import numpy as np
import pytest

from benchmarks import acoustics, inference, mechanics, protocols


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


@pytest.mark.slow
def test_benchmark_of_mechanics_runs(tmp_path, monkeypatch):
    out = tmp_path / "mechanics.json"
    monkeypatch.setattr(sys, "argv", ["mechanics", "--quick", "--out", str(out)])
    mechanics.main()
    found = json.loads(out.read_text())
    assert set(found["push of 0.5 ms"]) == set(found["explicit push of 0.5 ms"]) | {"fzener"}
    assert found["50 Hz"]["error"] < 3e-4 and found["explicit push of 0.5 ms"]["zener"]["error_extrapolated"] < 1e-2
    assert found["large"]["run"]["min_s"] > 0.0 and found["growth at 20 steps"]["unknowns"][0] > 0


@pytest.mark.slow
def test_benchmark_of_the_protocols_runs(tmp_path, monkeypatch):
    out = tmp_path / "protocols.json"
    monkeypatch.setattr(sys, "argv", ["protocols", "--quick", "--out", str(out)])
    protocols.main()
    found = json.loads(out.read_text())["cases"]
    assert list(found) == ["stepwise, fast"]
    times = found["stepwise, fast"]
    assert times["gradient over run"] == pytest.approx(
        times["value and gradient"]["median_s"] / times["run"]["median_s"], abs=0.01
    )


@pytest.mark.parametrize("name", ["T1_P50", "T2_P50", "T3_P50", "T1_P150", "T2_P150", "T3_P150"])
def test_positions_are_stored_ones_a_step_apart(name):
    stored = np.load(acoustics.REFERENCE / f"{name}.npz")["z_m"]
    step = acoustics.SETTINGS[int(name[4:])].axial_step
    z = acoustics.positions(stored, step)
    assert set(z) <= set(stored)
    assert 0.9 * step < np.diff(z).max() <= step
    assert z[0] < acoustics.FOCUS[0] and z[-1] > acoustics.FOCUS[1]


@pytest.mark.slow
def test_benchmark_of_the_fast_model_runs(tmp_path, monkeypatch):
    out = tmp_path / "inference.json"
    monkeypatch.setattr(sys, "argv", ["inference", "--quick", "--out", str(out)])
    inference.main()
    found = json.loads(out.read_text())
    assert found["cases"]["single"]["median_s"] > 0.0 and found["cases"]["4 walkers"]["per_walker_s"] > 0.0
    assert found["errors"]["covered"] == 1.0 and found["errors"]["largest"] < 0.03
