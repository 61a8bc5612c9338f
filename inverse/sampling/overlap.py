"""Columns of a record one by one, and how much of each prior the data have left."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

_GRID = 512


@dataclasses.dataclass(frozen=True)
class Column:
    """One value of a record.

    Attributes:
        name: Of its variable, with the group in brackets where there are several.
        title: For figures.
        unit: Of the numbers.
        posterior: Draws.
        prior: Draws.
    """

    name: str
    title: str
    unit: str
    posterior: Float[np.ndarray, "chain draw"]
    prior: Float[np.ndarray, " believed"]

    @property
    def overlap(self) -> float:
        """See `overlap_coefficient`."""
        return overlap_coefficient(self.prior, self.posterior.ravel())


def record_columns(data: Any) -> list[Column]:
    """All values of a record, groups one by one."""
    found = []
    for name, values in data["posterior"].data_vars.items():
        drawn, believed = values.to_numpy(), data["prior"][name].to_numpy()
        title, unit = values.attrs["long_name"], values.attrs["units"]
        if values.ndim == 2:
            found.append(Column(str(name), title, unit, drawn, believed.ravel()))
            continue
        for index, group in enumerate(values[values.dims[2]].to_numpy()):
            one = (f"{name}[{group}]", f"{title}, {group}", unit, drawn[:, :, index], believed[:, :, index].ravel())
            found.append(Column(*one))
    return found


def overlap_coefficient(prior: Float[np.ndarray, " draw"], posterior: Float[np.ndarray, " other"]) -> float:
    """Area common to the densities of prior and posterior: near 1 where the data said nothing, near 0 where much [1].

    The same in every coordinate of the value, so that it is taken in the prior's own ranks, in which the prior is flat.

    Accuracy: a few hundredths with some thousand draws each; it cannot fall below one over the draws of the prior.
    """
    ordered = np.sort(prior)
    ranks = (np.arange(len(ordered)) + 0.5) / len(ordered)
    density, places = rank_density(np.interp(posterior, ordered, ranks, left=0.0, right=1.0))
    return float(np.clip(np.trapezoid(np.minimum(density, 1.0), places), 0.0, 1.0))


def rank_density(
    ranks: Float[np.ndarray, " draw"],
) -> tuple[Float[np.ndarray, " place"], Float[np.ndarray, " place"]]:
    """Density of numbers between 0 and 1 by normal kernels that are reflected at both ends, and where it is given."""
    spread = min(float(np.std(ranks)), float(np.ptp(np.quantile(ranks, [0.25, 0.75]))) / 1.34)
    width = max(0.9 * spread * len(ranks) ** -0.2, 1e-6)
    lowest, highest = float(np.min(ranks)) - 5.0 * width, float(np.max(ranks)) + 5.0 * width
    places = np.linspace(max(lowest, 0.0), min(highest, 1.0), _GRID)
    thinned = ranks[:: max(len(ranks) // 4000, 1)]
    both = np.concatenate([thinned, -thinned, 2.0 - thinned])
    scaled = (places[:, None] - both[None, :]) / width
    density = np.sum(np.exp(-0.5 * scaled**2), axis=1) / (len(thinned) * width * np.sqrt(2.0 * np.pi))
    return density, places
