"""Where results go: all of them or none, with a summary that says how they came about."""

import contextlib
import hashlib
import json
import math
import os
import shutil
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from arfjax import InputError
from inverse.software import versions

SUMMARY = "summary.json"


@contextlib.contextmanager
def output_directory(out: Path, *, replaces: Collection[str] = ()) -> Iterator[Path]:
    """A temporary folder whose files are moved into `out` once the block ends without an error.

    It lies in `out`, or in the nearest folder above that exists, so that moving is renaming on one file system.

    On an error, or when interrupted, nothing is left behind, and results of an earlier run in `out` stay as they were.
    Files of other names in `out` are never touched.

    Args:
        out: Where results go.
        replaces: Files in `out` that an earlier run may have made and this one need not: beside the new results they
            would be taken for theirs, and those that the block does not make again are removed, with the folders in
            `out` that they leave empty.

    Raises:
        InputError: if `out` is a file or cannot be written to.
    """
    out = Path(out).absolute()
    try:
        existing = next(parent for parent in (out, *out.parents) if parent.exists())
        if not existing.is_dir():
            raise InputError(f"{existing}: is a file, not a folder; give --out a folder.")
        temporary = Path(tempfile.mkdtemp(prefix=".arfjax-partial-", dir=existing))
    except OSError as error:
        raise _unwritable(out, error) from None
    try:
        yield temporary
        _require_room(temporary, out)
        earlier = [out / name for name in replaces if not (temporary / name).exists()]
        try:
            _move(temporary, out)
            _remove(earlier, out)
        except OSError as error:
            raise _unwritable(out, error) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _unwritable(out: Path, error: OSError) -> InputError:
    return InputError(f"{out}: cannot be written to ({error.strerror}); give --out another folder.")


def _require_room(source: Path, target: Path) -> None:
    """Nothing is moved where one file would be stopped by a folder of its name, or the other way round."""
    for path in source.iterdir():
        there = target / path.name
        if there.exists() and there.is_dir() != path.is_dir():
            kind, other = ("a folder", "a file") if there.is_dir() else ("a file", "a folder")
            raise InputError(f"{there}: is {kind} where {other} has to go; give --out another folder.")
        if there.is_dir():
            _require_room(path, there)


def _move(source: Path, target: Path) -> None:
    target.mkdir(parents=True, exist_ok=True)
    for path in sorted(source.iterdir()):
        if path.is_dir():
            _move(path, target / path.name)
        else:
            os.replace(path, target / path.name)


def _remove(files: Iterable[Path], out: Path) -> None:
    for path in files:
        if path.is_file():
            path.unlink()
            if path.parent != out and not any(path.parent.iterdir()):
                path.parent.rmdir()


def recorded(files: Mapping[str, Path | None]) -> dict[str, dict[str, str]]:
    """Path and SHA-256 of each file that was given, as summaries hold them.

    To be called once they are read: when the computation is over, other files may be there, or none.
    """
    return {name: {"path": str(path), "sha256": sha256(path)} for name, path in files.items() if path is not None}


def write_summary(
    folder: Path,
    *,
    command: str,
    inputs: Mapping[str, Mapping[str, str]],
    settings: Mapping[str, Any],
    results: Mapping[str, Any],
    seed: int | None = None,
) -> None:
    """Write summary.json: results with units, settings, seed, inputs as `recorded`, versions of the software."""
    summary = {
        "command": command,
        "inputs": dict(inputs),
        "settings": dict(settings),
        "seed": seed,
        "versions": versions(),
        "results": dict(results),
    }
    write_json(folder / SUMMARY, summary)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON; see `finite`."""
    text = json.dumps(finite(content), indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def figure_files(names: Iterable[str]) -> list[str]:
    """Files that `write_figures` makes of figures of these names."""
    return [f"{name}.{ending}" for name in names for ending in ("png", "pdf")]


def write_figures(folder: Path, figures: Mapping[str, Figure]) -> list[str]:
    """Write each figure as PNG and PDF under its name, and return the names of the PNG files."""
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=200)
        figure.savefig(folder / f"{name}.pdf")
    return [f"{name}.png" for name in figures]


def quantity(value: float, unit: str, standard_error: float | None = None) -> dict[str, Any]:
    """A number with its unit, and its standard error if there is one, as summaries hold it."""
    stated = {"value": value, "unit": unit}
    return stated if standard_error is None else {**stated, "standard_error": standard_error}


def sha256(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def finite(value: Any) -> Any:
    """The same in what JSON has words for: numbers that are not finite become null, those of numpy plain ones."""
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
