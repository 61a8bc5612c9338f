"""Whether draws can be trusted, in one table and in sentences."""

import dataclasses

import numpy as np
from jaxtyping import Float

from inverse.inference.problem import Problem
from inverse.sampling.autocorrelation import integrated_time
from inverse.sampling.draws import Draws
from inverse.sampling.inference_data import bulk_size, rank_r_hat, standard_error, tail_size
from inverse.sampling.target import batched_values

LARGEST_R_HAT = 1.01
SMALLEST_SIZE = 400.0
LEVEL = 0.9
"""Level of intervals: between the 5 % and the 95 % quantile."""


@dataclasses.dataclass(frozen=True)
class Row:
    """One value of a posterior.

    Attributes:
        name: Of the value.
        unit: Of the numbers from `mean` to `upper` and of both errors.
        mean: Of the draws.
        sd: Of the draws.
        median: Of the draws.
        lower: 5 % quantile.
        upper: 95 % quantile.
        r_hat: Rank-normalised; NaN for a single chain of few draws.
        bulk_size: Effective sample size of the bulk.
        tail_size: Of the 5 % and 95 % quantiles.
        autocorrelation_time: Integrated [draws].
        mean_error: Monte Carlo standard error of the mean.
        sd_error: Of the standard deviation.
    """

    name: str
    unit: str
    mean: float
    sd: float
    median: float
    lower: float
    upper: float
    r_hat: float
    bulk_size: float
    tail_size: float
    autocorrelation_time: float
    mean_error: float
    sd_error: float


@dataclasses.dataclass(frozen=True)
class Diagnostics:
    """A table, and what is wrong.

    Attributes:
        rows: One a value, in the order of the problem's columns.
        complaints: A sentence for each threshold that is not met; empty where all are.
    """

    rows: tuple[Row, ...]
    complaints: tuple[str, ...]

    @property
    def sound(self) -> bool:
        """Whether all thresholds are met."""
        return not self.complaints

    @property
    def columns(self) -> tuple[str, ...]:
        """Headings of the table; the interval's level stands in them."""
        share = f"{100.0 * (1.0 - LEVEL) / 2.0:g}"
        upper = f"{100.0 * (1.0 + LEVEL) / 2.0:g}"
        head = ("parameter", "unit", "mean", "sd", f"{share} %", "median", f"{upper} %")
        return (*head, "R-hat", "bulk ESS", "tail ESS", "tau", "error of mean")

    @property
    def table(self) -> list[list[str]]:
        """Rows of the table, as text."""
        return [
            [
                row.name,
                row.unit,
                *(f"{value:.4g}" for value in (row.mean, row.sd, row.lower, row.median, row.upper)),
                _shown(row.r_hat, ".3f"),
                *(f"{value:.0f}" for value in (row.bulk_size, row.tail_size)),
                _shown(row.autocorrelation_time, ".3g"),
                f"{row.mean_error:.2g}",
            ]
            for row in self.rows
        ]


def _shown(value: float, form: str) -> str:
    """A number, or a dash where there is none, such as R-hat of draws that are no chains."""
    return "–" if np.isnan(value) else format(value, form)


def values_of(problem: Problem, draws: Draws) -> Float[np.ndarray, "chain draw m"]:
    """Values of all draws, in their units."""
    flat = batched_values(problem, draws.flat)
    return flat.reshape(draws.n_chains, draws.n_draws, flat.shape[1])


def diagnose_draws(problem: Problem, draws: Draws) -> Diagnostics:
    """Moments, quantiles, R-hat, effective sizes, autocorrelation times and Monte Carlo errors of every value."""
    values = values_of(problem, draws)
    worth = draws.settings.get("effective_size")
    rows = tuple(
        _row(name, unit, values[:, :, index], None if worth is None else float(worth))
        for index, (name, unit, _) in enumerate(problem.parameters.columns)
    )
    return Diagnostics(rows, tuple(_complaints(rows, draws)))


def _row(name: str, unit: str, values: Float[np.ndarray, "chain draw"], worth: float | None) -> Row:
    lower, median, upper = np.quantile(values, [0.5 - 0.5 * LEVEL, 0.5, 0.5 + 0.5 * LEVEL])
    sd = float(np.std(values, ddof=1)) if values.size > 1 else float("nan")
    if worth is not None:
        # Resampled with weights: chains are no chains, and draws are worth what the weights say.
        return Row(
            name, unit, float(np.mean(values)), sd, float(median), float(lower), float(upper), float("nan"), worth,
            worth, float("nan"), sd / np.sqrt(worth), sd / np.sqrt(2.0 * worth),
        )  # fmt: skip
    return Row(
        name,
        unit,
        float(np.mean(values)),
        sd,
        float(median),
        float(lower),
        float(upper),
        rank_r_hat(values),
        bulk_size(values),
        tail_size(values),
        float(integrated_time(values.T[:, :, None])[0]),
        standard_error(values, "mean"),
        standard_error(values, "sd"),
    )


def _complaints(rows: tuple[Row, ...], draws: Draws) -> list[str]:
    found = []
    # Written so that NaN, of chains that never moved, fails, too.
    has_chains = "effective_size" not in draws.settings
    apart = [row for row in rows if not row.r_hat <= LARGEST_R_HAT] if has_chains else []
    if apart:
        worst = max(apart, key=lambda row: np.nan_to_num(row.r_hat, nan=np.inf))
        found.append(
            f"Chains do not agree on {_listed(apart)}: R-hat of {worst.name} is {worst.r_hat:.3f}, above "
            f"{LARGEST_R_HAT}. Run longer; if it stays, the posterior has several modes or a long ridge."
        )
    few = [row for row in rows if not min(row.bulk_size, row.tail_size) >= SMALLEST_SIZE]
    if few:
        worst = min(few, key=lambda row: np.nan_to_num(min(row.bulk_size, row.tail_size), nan=-1.0))
        found.append(
            f"Draws of {_listed(few)} tell too little: effective sample size of {worst.name} is "
            f"{min(worst.bulk_size, worst.tail_size):.0f}, below {SMALLEST_SIZE:g}. Run longer."
        )
    if draws.divergences:
        found.append(
            f"{draws.divergences} of {draws.log_density.size} trajectories diverged: narrow corners of the posterior "
            "may be missing. Raise `target_acceptance` (`--target-acceptance`), or look for a parameter that the data "
            "do not determine."
        )
    if not draws.finished and not draws.divergences:
        found.append(f"The sampler did not finish: {draws.message}.")
    return found


def _listed(rows: list[Row]) -> str:
    names = [row.name for row in rows]
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
