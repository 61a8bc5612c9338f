"""What the program sets before it begins."""

import inspect
import os
import re
import subprocess
import sys
import typing
from pathlib import Path

import jax
import pytest

from inverse.commands import main
from inverse.commands.app import app

_COMMANDS = {each.name or each.callback.__name__: each.callback for each in app.registered_commands}


@pytest.mark.parametrize("cores", [1, 2])
def test_on_one_core_programs_run_in_the_thread_that_asks(cores, monkeypatch):
    """Otherwise `arfjax reproduce` waits for ever: its sparse solves hold the only thread that could serve them."""
    asked, update = {}, jax.config.update
    monkeypatch.setattr("inverse.cores.usable_cores", lambda: cores)
    monkeypatch.setattr(jax.config, "update", lambda name, value: asked.update({name: value}))
    assert main.run(["--help"]) == 0
    monkeypatch.setattr(jax.config, "update", update)
    assert asked.pop("jax_enable_x64") and asked == ({"jax_cpu_enable_async_dispatch": False} if cores == 1 else {})


def test_imports_do_not_start_jax():
    """What a program sets for the start of JAX would come too late."""
    code = "import inverse.commands.app; from jax._src import xla_bridge; print(len(xla_bridge._backends))"
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "0", done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["fit-dma", "data.csv", "--out", ""], "--out: the value is empty; give one"),
        (["diagnose", "--dma", "", "--out", "x"], "--dma: the value is empty; give one"),
        (["fit-dma", "", "--out", "x"], "argument 2: the value is empty; give one"),
    ],
)
def test_a_value_that_is_empty(arguments, said, capsys):
    """As an unset variable of a shell leaves it, which would be the folder that one is in."""
    assert main.run(arguments) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


@pytest.mark.parametrize("name", sorted(_COMMANDS))
def test_help_keeps_what_stands_in_brackets(name, capsys, monkeypatch):
    """Rich takes a bracket that begins with a small letter, such as a unit or a section of a file, for markup."""
    monkeypatch.setenv("COLUMNS", "400")
    assert main.run([name, "--help"]) == 0
    shown = capsys.readouterr().out
    hints = typing.get_type_hints(_COMMANDS[name], include_extras=True).values()
    options = [said.help or "" for hint in hints for said in getattr(hint, "__metadata__", ())]
    for text in (inspect.getdoc(_COMMANDS[name]), *options):
        for bracket in re.findall(r"\[[^\]]*\]", " ".join(text.split())):
            assert bracket in shown
    assert "\\" not in shown and "─ Options" in shown


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["infer", "--dma", "a.csv", "--dma", "b.csv", "--out", "x"], "--dma is given 2 times and takes one value"),
        (["diagnose", "--dma", "a.csv", "--causes=foo", "--causes", "slip", "--out", "x"], "--causes is given 2 times"),
        (["fit-dma", "a.csv", "--out", "x", "--out=x", "--out", "y"], "--out is given 3 times and takes one value"),
    ],
)
def test_an_option_of_one_value_is_given_once(arguments, said, capsys, tmp_path, monkeypatch):
    """The parser would keep the last value, and drop the other file without a word."""
    monkeypatch.chdir(tmp_path)
    assert main.run(arguments) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and not list(tmp_path.iterdir())


def test_options_of_many_values_and_switches_may_be_given_again(capsys):
    again = ["--varying", "a", "--varying", "b", "--evidence", "--evidence", "--profiles", "--no-profiles"]
    assert main.run(["infer", "--out", "--dma", *again]) == 2
    assert "nothing to infer from" in capsys.readouterr().err
    assert main.run(["infer", "--help", "--help"]) == 0
