"""ArviZ, hidden: what differs between its versions is here and nowhere else.

ArviZ 0.23 keeps a posterior in its own `InferenceData`, later versions in a `DataTree` of xarray; the groups are the
same, and so are the files. Functions take plain arrays, and no interval is ever left to a default, which differs, too.
"""

import importlib
import importlib.metadata
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from arfjax.errors import InputError
from inverse.sampling.checkpoint import replaced

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # announces its own next version at every import
    import arviz as az

ENGINE = "h5netcdf"

ARVIZ_VERSION = importlib.metadata.version("arviz")
# By its number: later versions warn when they are asked for what they no longer have.
_HAS_INFERENCE_DATA = ARVIZ_VERSION.startswith("0.")


def bundle(groups: Mapping[str, xr.Dataset], attributes: Mapping[str, str | int | float]) -> Any:
    """Groups as one object of ArviZ.

    Args:
        groups: By ArviZ's names: `posterior`, `sample_stats` and so on.
        attributes: Of the whole.

    Returns:
        `arviz.InferenceData`, or `xarray.DataTree` where ArviZ has none.
    """
    if _HAS_INFERENCE_DATA:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of groups that it does not know
            gathered: Any = az.InferenceData
            return gathered(attrs=dict(attributes), **groups)
    tree = xr.DataTree.from_dict(dict(groups))
    tree.attrs.update(attributes)
    return tree


def groups_of(data: Any) -> dict[str, xr.Dataset]:
    """Groups of an object of ArviZ by name."""
    if isinstance(data, xr.DataTree):
        return {name: child.to_dataset(inherit=False) for name, child in data.children.items()}
    return {name: data[name] for name in data.groups()}


def save_posterior(data: Any, path: Path) -> None:
    """Write an object of ArviZ as NetCDF, in place at once."""
    tree = xr.DataTree.from_dict(groups_of(data))
    tree.attrs.update(data.attrs)
    with replaced(path) as beside:
        tree.to_netcdf(beside, engine=ENGINE)


def load_posterior(path: Path) -> Any:
    """Read what `save_posterior` wrote.

    Raises:
        InputError: if the file is none of these.
    """
    try:
        with xr.open_datatree(path, engine=ENGINE) as opened:
            tree = opened.load()
    except (OSError, ValueError):
        raise InputError(f"{path}: is no NetCDF file of a posterior; give one that `save_posterior` wrote.") from None
    if "posterior" not in tree.children:
        raise InputError(f"{path}: has no group `posterior`; give a file that `save_posterior` wrote.")
    groups = {name: child.to_dataset(inherit=False) for name, child in tree.children.items()}
    return bundle(groups, {str(name): value for name, value in tree.attrs.items()})


def rank_r_hat(draws: Float[np.ndarray, "chain draw"]) -> float:
    """Rank-normalised split R-hat, the larger of bulk and tails (Vehtari et al. 2021)."""
    return _number(az.rhat, draws)


def bulk_size(draws: Float[np.ndarray, "chain draw"]) -> float:
    """Effective sample size of the bulk."""
    return _number(az.ess, draws, method="bulk")


def tail_size(draws: Float[np.ndarray, "chain draw"]) -> float:
    """The smaller of the effective sample sizes of the 5 % and 95 % quantiles."""
    return _number(az.ess, draws, method="tail", prob=(0.05, 0.95))


def mean_size(draws: Float[np.ndarray, "chain draw"]) -> float:
    """Effective sample size for the mean."""
    return _number(az.ess, draws, method="mean")


def standard_error(draws: Float[np.ndarray, "chain draw"], of: str, probability: float | None = None) -> float:
    """Monte Carlo standard error of the `mean`, the `sd`, or the `quantile` of a probability, in the draws' unit."""
    if of == "quantile":
        return _number(az.mcse, draws, method=of, prob=probability)
    return _number(az.mcse, draws, method=of)


def _number(function: Any, draws: Float[np.ndarray, "chain draw"], **settings: Any) -> float:
    if draws.shape[1] < 4 or not np.all(np.isfinite(draws)) or np.ptp(draws) == 0.0:
        return float("nan")
    with np.errstate(all="ignore"):
        return float(np.asarray(function(np.asarray(draws), **settings)))


def smoothed_weights(logs: Float[np.ndarray, " point"]) -> tuple[Float[np.ndarray, " point"], float]:
    """Logarithms of importance weights that sum to one, the largest smoothed by a Pareto law, and the shape of that."""
    if _HAS_INFERENCE_DATA:
        smooth, shape = az.psislw(logs.copy())
    else:
        arrays: Any = importlib.import_module("arviz_stats.base").array_stats
        smooth, shape = arrays.psislw(logs.copy())
    smooth = np.asarray(smooth)
    return smooth - np.logaddexp.reduce(smooth), float(np.asarray(shape))
