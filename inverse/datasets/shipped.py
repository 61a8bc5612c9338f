"""Real measurements that come with the package, each in a folder with its licence and its source."""

from importlib import resources
from pathlib import Path

from arfjax import InputError

_FILES = {
    "pyvisco_polymer": "freq_user_raw.csv",
    "nist_foam": "vn01_foam_10_rad_s.csv",
    "mr_hifu_60s": "heating_60s_200w.csv",
    "suomi2016_hmi": "hmi.csv",
    "suomi2016_experiment": "experiment.toml",
}


def shipped_names() -> tuple[str, ...]:
    """Names that `shipped` knows."""
    return tuple(_FILES)


def shipped(name: str) -> Path:
    """Path of a shipped file; SOURCE.md lies beside it and names the licence, LICENSE.txt where it asks for its text.

    Raises:
        InputError: if there is no set of that name.
    """
    if name not in _FILES:
        raise InputError(f"no shipped data set is called '{name}'; there are {', '.join(_FILES)}.")
    return Path(str(resources.files("inverse.datasets").joinpath("data", name, _FILES[name])))
