"""What a long run has done so far, kept beside the folder of its results until it ends."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from arfjax import InputError
from arfjax.io import write_netcdf


class StoppedEarly(Exception):
    """A run was stopped, and its message says what is kept."""


class PartialFile:
    """Outcomes of the samples that are done, in `OUT.partial.nc` beside the folder `OUT`.

    Not in the folder, because that gets all results or none.

    Args:
        out: Folder of the results.
        settings: Everything that the outcomes depend on; another run's file is refused.
    """

    def __init__(self, out: Path, settings: Mapping[str, Any]) -> None:
        """See the class."""
        whole = Path(out).absolute()
        self.path = whole.with_name(f"{whole.name}.partial.nc")
        self._settings = json.dumps(dict(settings), sort_keys=True)

    def load(self) -> dict[str, np.ndarray]:
        """Outcomes with the sample as first axis; none if there is no file.

        Raises:
            InputError: if the file is of a run with other settings, or cannot be read.
        """
        if not self.path.exists():
            return {}
        try:
            with xr.open_dataset(self.path, engine="h5netcdf") as data:
                settings = data.attrs.get("settings")
                outcomes = {str(name): values.to_numpy() for name, values in data.items()}
        except (OSError, ValueError, KeyError) as error:
            raise InputError(
                f"{self.path}: cannot be read ({error}); delete it to begin anew, or give --out another folder."
            ) from None
        if settings != self._settings:
            raise InputError(
                f"{self.path}: holds samples of a run with other settings; repeat that run's options to go on with it, "
                "delete the file to begin anew, or give --out another folder."
            )
        return outcomes

    def keep(self, outcomes: Mapping[str, np.ndarray]) -> None:
        """Write all outcomes so far; a reader finds the file of before or of now, never half of one."""
        dimensions = {
            name: ("done", *(f"{name}_{axis}" for axis in range(1, values.ndim))) for name, values in outcomes.items()
        }
        data = xr.Dataset({name: (dimensions[name], values) for name, values in outcomes.items()})
        data.attrs["settings"] = self._settings
        self.path.parent.mkdir(parents=True, exist_ok=True)
        written = self.path.with_name(f".{self.path.name}.new")
        try:
            write_netcdf(data, written)
            written.replace(self.path)
        finally:
            written.unlink(missing_ok=True)

    @staticmethod
    def n_done(outcomes: Mapping[str, np.ndarray]) -> int:
        """Samples in outcomes."""
        return len(next(iter(outcomes.values()))) if outcomes else 0

    def words(self) -> str:
        """What is kept."""
        return f"{self.n_done(self.load())} runs are kept in {self.path}; the same command goes on from there."

    def delete(self) -> None:
        """Take the file away, because the results are whole."""
        self.path.unlink(missing_ok=True)
