"""The example of an experiment, changed: what tests of its reading begin with."""

from pathlib import Path

import pytest

from arfjax import InputError, read_experiment

EXAMPLE = Path(__file__).parent.parent / "examples" / "suomi2016.toml"
GOOD = EXAMPLE.read_text(encoding="utf-8")
BY_DOSE = GOOD[GOOD.index('size = "dose"') : GOOD.index('"linear"')] + '"linear"'
FOCAL = "focal_length_mm = 62.6"
TEMPERATURES = "[35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0]"


def changed(*replacements):
    """The example with one place after the other changed."""
    text = GOOD
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def acoustics(lines):
    """A change of the example: with a section on acoustics."""
    return "[mechanics]", f"[acoustics]\n{lines}\n\n[mechanics]"


def write(tmp_path, text):
    path = tmp_path / "experiment.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(path):
    with pytest.raises(InputError) as error:
        read_experiment(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ") and len(message.splitlines()) == 1
    return message.removeprefix(f"{path}: ")
