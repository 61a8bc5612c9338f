"""Samplers beside one another on one posterior: whether they agree within Monte Carlo error, and how fast they are."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy import stats

from inverse.inference.problem import Problem
from inverse.sampling.diagnostics import values_of
from inverse.sampling.draws import Draws
from inverse.sampling.inference_data import bulk_size, standard_error, tail_size

SUMMARIES = ("mean", "sd", "5 %", "95 %")


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Summaries of a posterior by several samplers.

    Attributes:
        samplers: As they were called.
        names: Of the values.
        summaries: `SUMMARIES` of every value, in its unit.
        errors: Their Monte Carlo standard errors.
        distances: Differences from the first sampler in standard errors of the difference [1].
        sizes: Smallest effective sample size of all values, of bulk and tails.
        seconds: Of each run.
        evaluations: Of the density, or the density and its gradient.
    """

    samplers: tuple[str, ...]
    names: tuple[str, ...]
    summaries: Float[np.ndarray, "sampler value summary"]
    errors: Float[np.ndarray, "sampler value summary"]
    distances: Float[np.ndarray, "sampler value summary"]
    sizes: Float[np.ndarray, " sampler"]
    seconds: Float[np.ndarray, " sampler"]
    evaluations: Float[np.ndarray, " sampler"]

    @property
    def agree(self) -> bool:
        """Whether no summary is further from the first sampler's than chance makes one in a thousand comparisons."""
        from_others = np.abs(self.distances[1:])
        return bool(np.all(from_others < _limit(from_others.size)))

    @property
    def sizes_per_second(self) -> Float[np.ndarray, " sampler"]:
        """Effective sample size over wall time, compilation included [1/s]."""
        return self.sizes / self.seconds

    def as_dict(self) -> dict:
        """For JSON."""
        return {
            "agree": self.agree,
            "largest distance [standard errors]": float(np.max(np.abs(self.distances))),
            "samplers": {
                sampler: {
                    "effective sample size": float(self.sizes[index]),
                    "seconds": float(self.seconds[index]),
                    "effective samples per second": float(self.sizes_per_second[index]),
                    "evaluations": int(self.evaluations[index]),
                    "evaluations per second": float(self.evaluations[index] / self.seconds[index]),
                    "values": {
                        name: {
                            said: {
                                "value": float(self.summaries[index, row, column]),
                                "error": float(self.errors[index, row, column]),
                                "distance": float(self.distances[index, row, column]),
                            }
                            for column, said in enumerate(SUMMARIES)
                        }
                        for row, name in enumerate(self.names)
                    },
                }
                for index, sampler in enumerate(self.samplers)
            },
        }


def compare(problem: Problem, runs: dict[str, Draws]) -> Comparison:
    """Compare runs of one posterior with the first of them.

    Args:
        problem: Whose posterior it is.
        runs: By the name of the sampler.
    """
    values = [values_of(problem, draws) for draws in runs.values()]
    worth = [_worth(draws) for draws in runs.values()]
    summaries = np.stack([_summaries(each) for each in values])
    errors = np.stack([_errors(each, size) for each, size in zip(values, worth, strict=True)])
    with np.errstate(divide="ignore", invalid="ignore"):
        distances = (summaries - summaries[:1]) / np.sqrt(errors**2 + errors[:1] ** 2)
    count = range(values[0].shape[2])
    sizes = [
        min(min(bulk_size(each[:, :, k]), tail_size(each[:, :, k])) for k in count) if size is None else size
        for each, size in zip(values, worth, strict=True)
    ]
    return Comparison(
        tuple(runs),
        problem.parameters.names,
        summaries,
        errors,
        distances,
        np.array(sizes),
        np.array([draws.seconds for draws in runs.values()]),
        np.array([float(draws.evaluations) for draws in runs.values()]),
    )


def _summaries(values: Float[np.ndarray, "chain draw m"]) -> Float[np.ndarray, "m summary"]:
    flat = values.reshape(-1, values.shape[2])
    low, high = np.quantile(flat, [0.05, 0.95], axis=0)
    return np.stack([flat.mean(axis=0), flat.std(axis=0, ddof=1), low, high], axis=1)


def _worth(draws: Draws) -> float | None:
    """Independent draws that weighted ones are worth; None for draws of chains, whose own course tells."""
    size = draws.settings.get("effective_size")
    return None if size is None else float(size)


def _errors(values: Float[np.ndarray, "chain draw m"], worth: float | None) -> Float[np.ndarray, "m summary"]:
    columns = np.moveaxis(values, 2, 0)
    if worth is not None:
        return np.array([_of_independent(one.ravel(), worth) for one in columns])
    return np.array(
        [
            [
                standard_error(one, "mean"),
                standard_error(one, "sd"),
                standard_error(one, "quantile", 0.05),
                standard_error(one, "quantile", 0.95),
            ]
            for one in columns
        ]
    )


def _of_independent(draws: Float[np.ndarray, " draw"], worth: float) -> list[float]:
    """Of resampled draws, many of which are the same point: errors of as many independent ones as they are worth."""
    away = draws - np.mean(draws)
    variance = np.mean(away**2)
    of_sd = np.sqrt(max(np.mean(away**4) / variance**2 - 1.0, 0.0) * variance / (4.0 * worth))
    # Over two deviations of the share to both sides: over one, too few points would say how dense they lie.
    spread = 2.0 * np.sqrt(0.05 * 0.95 / worth)
    reach = [np.quantile(draws, np.clip([share - spread, share + spread], 0.0, 1.0)) for share in (0.05, 0.95)]
    return [float(np.sqrt(variance / worth)), float(of_sd), *(float(0.25 * np.ptp(each)) for each in reach)]


def _limit(count: int) -> float:
    """Standard errors that the largest of so many normal numbers exceeds once in a thousand times, if independent."""
    return float(stats.norm.isf(0.5e-3 / max(count, 1)))
