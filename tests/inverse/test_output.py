"""Results appear whole or not at all, and the summary says how they came about."""

import hashlib
import json

import pytest

from arfjax.errors import InputError
from inverse.output import output_directory, quantity, recorded, write_summary


def test_results_appear_at_the_end_and_join_what_is_there(tmp_path):
    out = tmp_path / "deep" / "out"
    for content in ("first", "second"):
        with output_directory(out) as folder:
            (folder / "a.txt").write_text(content)
            (folder / "figures").mkdir()
            (folder / "figures" / "b.txt").write_text(content)
        (out / "mine.txt").write_text("kept")
    assert (out / "a.txt").read_text() == (out / "figures" / "b.txt").read_text() == "second"
    assert (out / "mine.txt").read_text() == "kept"
    assert [path.name for path in tmp_path.iterdir()] == ["deep"]
    assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_what_an_earlier_run_left_goes_when_results_come(tmp_path):
    """Only what is named, and only what is not made again; after an error it is all there."""
    for name in ("a.png", "b.png", "mine.png"):
        (tmp_path / name).write_text("earlier")
    with pytest.raises(RuntimeError), output_directory(tmp_path, replaces=["a.png", "b.png"]) as folder:
        raise RuntimeError
    assert len(list(tmp_path.iterdir())) == 3
    with output_directory(tmp_path, replaces=["a.png", "b.png", "c.png"]) as folder:
        (folder / "a.png").write_text("new")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a.png": "new", "mine.png": "earlier"}


def test_folders_that_what_goes_leaves_empty_go(tmp_path):
    for place in ("of_two", "with_mine"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "a.png").write_text("earlier")
    (tmp_path / "with_mine" / "mine.png").write_text("earlier")
    with output_directory(tmp_path, replaces=["of_two/a.png", "with_mine/a.png"]) as folder:
        (folder / "b.png").write_text("new")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["b.png", "mine.png", "with_mine"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_failure_leaves_nothing_and_keeps_what_was_there(tmp_path, error):
    fresh, old = tmp_path / "deep" / "fresh", tmp_path / "old"
    old.mkdir()
    (old / "a.txt").write_text("earlier")
    for out in (fresh, old):
        with pytest.raises(error), output_directory(out) as folder:
            (folder / "a.txt").write_text("half")
            raise error
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    assert [path.read_text() for path in old.iterdir()] == ["earlier"]


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file, not a folder"), output_directory(tmp_path / "file" / "out"):
        pass


def test_nothing_is_left_where_results_cannot_go(tmp_path, monkeypatch):
    (tmp_path / "out" / "a.txt").mkdir(parents=True)
    with (
        pytest.raises(InputError, match="a.txt: is a folder where a file"),
        output_directory(tmp_path / "out") as folder,
    ):
        (folder / "0.txt").write_text("first in order, and not moved either")
        (folder / "a.txt").write_text("a file where a folder is")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["a.txt"]
    (tmp_path / "out" / "a.txt" / "b").write_text("a file where a folder has to go")
    with pytest.raises(InputError, match="b: is a file where a folder"), output_directory(tmp_path / "out") as folder:
        (folder / "a.txt" / "b").mkdir(parents=True)

    def refused(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.mkdtemp", refused)
    with pytest.raises(InputError, match="new: cannot be written to .Permission denied"):
        with output_directory(tmp_path / "new"):
            pass
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_summary(tmp_path):
    data = tmp_path / "data.csv"
    data.write_text("a,b\n")
    results = {"tau": quantity(0.5, "s", float("inf")), "many": [1.0, float("nan")]}
    inputs = recorded({"data": data, "other": None})
    data.write_text("another file by then")
    write_summary(tmp_path, command="test", inputs=inputs, seed=3, settings={"n": 2}, results=results)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["inputs"] == {"data": {"path": str(data), "sha256": hashlib.sha256(b"a,b\n").hexdigest()}}
    assert summary["results"] == {"tau": {"value": 0.5, "unit": "s", "standard_error": None}, "many": [1.0, None]}
    assert summary["seed"] == 3 and set(summary["versions"]) == {"arfjax", "jax", "python"}
