"""What the documents show can be run."""

import re
from pathlib import Path

import pytest

import inverse
from inverse.diagnosis.choice import find_causes
from tests.inverse.diagnosis_keys import DESIGN_KEYS, INSIDE, INSIDE_DESIGN, KEYS, MEASUREMENT

ROOT = Path(__file__).parent.parent


def code_of(document):
    """Blocks of Python in a document."""
    return re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.fixture
def asked(monkeypatch):
    """What `inverse.diagnose` is asked for."""
    given = []
    monkeypatch.setattr(inverse, "diagnose", lambda *data, **wanted: given.append((data, wanted)))
    return given


def test_a_cause_of_one_s_own_is_shown_as_it_runs(asked):
    """The same as in test_diagnosis_in_python.py (of a DMA) and test_hmi_simulation.py, where they meet data."""
    blocks = [code for code in code_of("CONTRIBUTING.md") if "inverse.diagnose(" in code]
    for code in blocks:
        exec(compile(code, "CONTRIBUTING.md", "exec"), {})
    (_, of_dma), (_, of_curves) = asked
    for wanted, own in ((of_dma, "backlash"), (of_curves, "late-push")):
        # Refused if it is of another kind, or lacks what a cause says of itself.
        found = find_causes(wanted["causes"], wanted["causes"][:-1])
        assert found[-1].name == own and found[-1].sentence.endswith(".") and found[-1].shapes


def test_every_key_of_what_is_written_is_documented():
    words = set(re.findall(r"`([a-z_]+)`", (ROOT / "docs/diagnosis.md").read_text(encoding="utf-8")))
    inside = {key for keys in (*INSIDE.values(), *INSIDE_DESIGN.values(), MEASUREMENT) for key in keys}
    assert {*KEYS, *DESIGN_KEYS, *inside} - words == set()
