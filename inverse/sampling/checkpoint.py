"""Files of unfinished runs, readable at whatever moment a run is killed: written beside, then put in place at once."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from arfjax.errors import InputError


@contextlib.contextmanager
def replaced(path: Path, *, copied: bool = False) -> Iterator[Path]:
    """A file beside `path` that takes its place when the block ends well, and is gone when it does not.

    Args:
        path: To be replaced.
        copied: Whether to begin with what is there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=".arfjax-partial-", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    beside = Path(name)
    try:
        if copied:
            shutil.copyfile(path, beside)
        else:
            beside.unlink()
        yield beside
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def write_checkpoint(path: Path, arrays: dict[str, np.ndarray], attributes: dict[str, str | int | float]) -> None:
    """Arrays and attributes as an HDF5 file."""
    with replaced(path) as beside, h5py.File(beside, "w") as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=values)
        file.attrs.update(attributes)


def read_checkpoint(path: Path) -> tuple[dict[str, np.ndarray], dict]:
    """Arrays and attributes of an HDF5 file.

    Raises:
        InputError: if it is none.
    """
    with opened(path) as file:
        arrays = {name: np.asarray(values) for name, values in file.items() if isinstance(values, h5py.Dataset)}
        return arrays, dict(file.attrs)


@contextlib.contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file to read.

    Raises:
        InputError: if it is none.
    """
    try:
        file = h5py.File(path, "r")
    except OSError:
        raise InputError(
            f"{path}: is no HDF5 file of a run that could be resumed; delete it to begin anew, or keep this run "
            "elsewhere."
        ) from None
    with file:
        yield file


def refuse_other_settings(found: dict, wanted: dict[str, str | int | float], place: str) -> None:
    """Refuse a file of a run with other settings.

    Raises:
        InputError: saying which.
    """
    for name, value in wanted.items():
        if found.get(name) != value:
            raise InputError(
                f"{place}: was begun with `{name}` {found.get(name, 'unknown')}, asked for is {value}: go on with the "
                "former, delete it to begin anew, or keep this run elsewhere."
            )
