"""`arfjax causes`, and the page that lists them."""

from pathlib import Path

import pytest

from inverse.commands.main import run
from inverse.diagnosis import DMA_CAUSES, HMI_CAUSES

PAGE = Path(__file__).parents[3] / "docs" / "diagnosis.md"


def test_all_are_listed(capsys):
    assert run(["causes"]) == 0
    listed = capsys.readouterr().out
    assert all(cause.name in listed for cause in (*DMA_CAUSES, *HMI_CAUSES))


def test_the_page_lists_them_as_they_are(capsys):
    assert run(["causes", "--markdown"]) == 0
    assert PAGE.read_text(encoding="utf-8").endswith(capsys.readouterr().out)


@pytest.mark.parametrize("name", ["temperature-lag", "cavitation"])
def test_one_is_described(name, capsys):
    assert run(["causes", name]) == 0
    said = " ".join(capsys.readouterr().out.split())
    cause = next(one for one in (*DMA_CAUSES, *HMI_CAUSES) if one.name == name)
    for part in (cause.sentence, cause.helps, cause.source, cause.shape_means, cause.place):
        assert " ".join(part.split()) in said


@pytest.mark.parametrize(
    ("name", "ends"),
    [
        ("lesion-rim", "±0.5 is plausible; there is none below -1, and none above 1."),
        ("perfusion", "±1 is plausible; there is none below -1."),
        ("thermocouple-position", "0.25 mm^2 is plausible; there is none above 1.56 mm^2."),
        ("drying", "0.3 is plausible."),
    ],
)
def test_how_strong_one_can_be(name, ends, capsys):
    assert run(["causes", name]) == 0
    assert f"A strength of {ends} What would show it" in " ".join(capsys.readouterr().out.split())


def test_one_that_there_is_not(capsys):
    assert run(["causes", "gremlins"]) == 2
    said = capsys.readouterr().err
    assert "there is no cause 'gremlins'" in said and "cavitation" in said and said.count("\n") == 1
