"""The study of what is found at all."""

import numpy as np
import pytest

from benchmarks import diagnosis, diagnosis_detection
from benchmarks.diagnosis_summary import rate


def test_detection_has_seeds_of_its_own_and_counts_what_can_be_made():
    for model in ("fractional", "zener"):
        todo = diagnosis_detection.planned(100, model)
        assert len({seed for *_, seed in todo}) == len(todo)
    with pytest.raises(SystemExit, match="from 1 to 100"):
        diagnosis_detection.planned(101, "zener")
    lines = [{"name": "slip", "seed": seed, "p": p} for seed, p in enumerate((0.05, 0.051, 0.0025, None))]
    found = diagnosis_detection.found_by_cause(lines)
    assert found["all"] == found["by cause"]["slip"] == rate([True, False, True]) and found["no such data"] == 1


@pytest.mark.slow
def test_detection_is_that_of_the_diagnosis():
    """The p-value of the test of everything is the one that a diagnosis of the same set begins with."""
    model, name, seed = "fractional", "sweep-drift", 4711
    problem, _ = diagnosis.measured(seed, model, name=name, d_prime=4.5, noise="white")
    whole = diagnosis.examine_dma(
        problem, diagnosis.DMA_CAUSES, np.random.default_rng(seed), program=diagnosis.DMA_CAUSES
    )
    assert diagnosis_detection.one_set(model, name, seed)["p"] == whole.decision.omnibus.p_value
