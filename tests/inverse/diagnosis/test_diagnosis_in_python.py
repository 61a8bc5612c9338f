"""`inverse.diagnose`: the command in one call."""

import json

import jax.numpy as jnp
import pytest

import inverse
from arfjax import InputError
from inverse.datasets.dma import read_dma
from inverse.diagnosis import DMA_CAUSES, DmaCause
from tests.blind import dma_generator as blind


class Backlash(DmaCause):
    """Play in the drive: a cause that is in no library."""

    name, place, unit, sign, plausible = "backlash", "instrument: drive", "1", 1, 0.1
    sentence, helps, source = "The drive has play.", "Two amplitudes.", "assumed"

    def measured(self, modulus, state, strength, shape):
        return modulus / (1.0 + strength * jnp.abs(modulus) / state.conditions.stiffest)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hidden")
    blind.write(
        folder / "data.csv", folder / "key.json", seed=blind.TEST_SEEDS + 5001, name="sweep-drift", d_prime=12.0
    )
    return folder / "data.csv"


def test_returns_what_it_writes(file, tmp_path):
    found = inverse.diagnose(file, out=tmp_path / "out", gain=False, seed=3)
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text()) == json.loads(json.dumps(found.content))
    assert found.content["verdict"] == found.verdict != "adequate"
    assert found.content["named"] == list(found.named) and found.content["seed"] == 3
    assert "data.csv" in (tmp_path / "out" / "report.md").read_text()
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".json", ".md", ".png", ".pdf"}


def test_takes_data_that_are_read_already_and_writes_nothing_by_itself(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    read = inverse.diagnose(read_dma(file), causes=["sweep-drift", "slip"], gain=False)
    assert {one["name"] for one in read.content["causes"]} == {"sweep-drift", "slip"}
    assert list(tmp_path.iterdir()) == []
    again = inverse.diagnose(str(file), causes=["slip", "sweep-drift", "slip"], gain=False)
    assert again.verdict == read.verdict


def test_a_cause_of_ones_own_joins_the_library(file):
    found = inverse.diagnose(file, causes=("sweep-drift", Backlash()), gain=False)
    names = {one["name"] for one in found.content["causes"]} | {one["name"] for one in found.content["not_testable"]}
    assert names == {"sweep-drift", "backlash"}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"causes": ["gremlins"]}, "there is no cause 'gremlins'"), ({"model": "maxwell"}, "fractional, zener")],
)
def test_wrong_names(file, wrong, said):
    with pytest.raises(InputError, match=said):
        inverse.diagnose(file, **wrong)


def test_the_library_is_the_default():
    assert len(DMA_CAUSES) >= 14
