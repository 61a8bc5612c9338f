"""Curves that the full solid made on another mesh, with an effect that only a sealed key knows.

Few sets, each far above the noise: `python -m benchmarks.diagnosis_hmi` measures rates. Seeds from `TEST_SEEDS` on.
"""

import jax
import pytest

from benchmarks.diagnosis_hmi import Condition, one_set, prepare
from tests.blind import hmi_generator as blind

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    jax.config.update("jax_enable_x64", True)
    return prepare(tmp_path_factory.mktemp("bench"))


@pytest.mark.parametrize(
    "name", ["output-drift", "thermocouple-position", "thermal-decorrelation", "lesion-stiffness-law"]
)
def test_hidden_effect_is_found_and_not_ruled_out(bench, name):
    found = one_set(bench, Condition("known", name, 9.0), blind.TEST_SEEDS + 11 + len(name))
    assert found["verdict"] != "adequate" and found["p"] < 0.05
    assert name in found["possible"]


def test_nothing_hidden_and_a_coarser_mesh_is_no_cause(bench):
    verdicts = [one_set(bench, Condition("null", "none", 0.0), blind.TEST_SEEDS + 40 + k)["verdict"] for k in range(3)]
    assert sum(verdict in ("adequate", "noise-model") for verdict in verdicts) >= 2


def test_effect_without_a_name_gets_none(bench):
    found = one_set(bench, Condition("unknown", "bump", 12.0), blind.TEST_SEEDS + 60)
    assert found["verdict"] == "unexplained" and found["named"] == []
