"""The operating characteristic of the diagnosis summed up: rates beside their limits."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.cause import Extension, every_shape
from inverse.diagnosis.dma_problem import DmaProblem
from inverse.diagnosis.examination import LEAST_VISIBILITY
from inverse.diagnosis.noise import noise_family
from inverse.diagnosis.screening import Screen, visibility

TRUE_SHAPES = {"frame-resonance": 1.6, "temperature-lag": 0.35, "second-relaxation": 0.55, "poroelastic-drainage": 0.9}
"""What the generator has where a cause has a second parameter."""
_DRAWN = 4000
_LEVEL = 0.05

Line = dict[str, Any]
Rate = dict[str, float]


def rate(happened: Sequence[bool]) -> Rate:
    """Share, its standard error (of Wilson's interval, which has a width at 0 and 1, too), and of how many."""
    count = len(happened)
    if not count:
        return {"rate": float("nan"), "error": float("nan"), "sets": 0}
    share = float(np.mean(happened))
    error = np.sqrt(share * (1.0 - share) / count + 0.25 / count**2) / (1.0 + 1.0 / count)
    return {"rate": share, "error": float(error), "sets": count}


def summarise(lines: Sequence[Line], limit: dict[str, dict[str, dict[str, float]]]) -> dict[str, Any]:
    """All rates of a record.

    Args:
        lines: One for each data set.
        limit: From `limits`.
    """
    known = _grouped((line for line in lines if line["part"] == "known"), lambda line: f"{line['d_prime']:g}")
    return {
        "known": {
            d: {name: _known(part) | {"limit": limit[d][name]} for name, part in _grouped(of_d, _name).items()}
            for d, of_d in known.items()
        },
        "all known": {d: _known(of_d) | {"limit": _mean_limit(of_d, limit[d])} for d, of_d in known.items()},
        "null": {
            noise: rate([line["verdict"] in ("named", "confusable", "unexplained") for line in part])
            for noise, part in _grouped((ln for ln in lines if ln["part"] == "null"), lambda ln: ln["noise"]).items()
        },
        **{part: _strange([line for line in lines if line["part"] == part]) for part in ("unknown", "removed")},
        "data sets": len(lines),
        "seconds a set": float(np.median([line["seconds"] for line in lines])) if lines else float("nan"),
    }


def limits(designs: Sequence[DmaProblem], strengths: Sequence[float]) -> dict[str, dict[str, dict[str, float]]]:
    """Detected and ranked first if noise and directions were known: largest projection, threshold at 5 %.

    Args:
        designs: Data sets with their fits; the limit is the mean over them.
        strengths: d'.

    Returns:
        By d', then by cause.
    """
    found: dict[str, dict[str, dict[str, float]]] = {}
    for number, problem in enumerate(designs):
        for d_prime, name, part in _limits_of(problem, strengths, np.random.default_rng(number)):
            into = found.setdefault(f"{d_prime:g}", {}).setdefault(name, {"detected": 0.0, "first": 0.0})
            for key, value in part.items():
                into[key] += value / len(designs)
    return found


def _limits_of(problem: DmaProblem, strengths: Sequence[float], rng: np.random.Generator):
    fitted = problem.fitted_directions()
    alternatives = [
        a for a in problem.directions(every_shape(DMA_CAUSES)) if visibility(a.directions, fitted)[0] > LEAST_VISIBILITY
    ]
    white = Screen(fitted, alternatives, noise_family(problem.orderings(), problem.frequencies())[:1])
    directions = white.projected()
    owners = np.array([alternative.name for alternative in white.alternatives])
    signs = np.array([alternative.sign for alternative in white.alternatives])
    noise = rng.standard_normal((fitted.shape[0], _DRAWN))

    def evidence(data: Float[np.ndarray, "n batch"]) -> Float[np.ndarray, "alternative batch"]:
        projected = directions.T @ data
        return np.where(signs[:, None] > 0, projected, np.abs(projected))

    threshold = np.quantile(evidence(noise).max(axis=0), 1.0 - _LEVEL)
    basis = np.linalg.qr(fitted / np.linalg.norm(fitted, axis=0))[0]
    for cause in DMA_CAUSES:
        if cause.name not in owners:
            continue
        extension = Extension(cause, TRUE_SHAPES.get(cause.name, cause.shapes[0]))
        truth = problem.directions([extension])[0].directions[:, 0]
        truth = truth - basis @ (basis.T @ truth)
        for d_prime in strengths:
            seen = evidence(d_prime * (truth / np.linalg.norm(truth))[:, None] + noise)
            yield (
                d_prime,
                cause.name,
                {
                    "detected": float(np.mean(seen.max(axis=0) > threshold)),
                    "first": float(np.mean(owners[seen.argmax(axis=0)] == cause.name)),
                },
            )


def _known(lines: Sequence[Line]) -> dict[str, Any]:
    found = [line for line in lines if line["verdict"] != "adequate"]
    return {
        "detected": rate([line["verdict"] != "adequate" for line in lines]),
        "first": rate([line["first"] == line["name"] for line in lines]),
        "possible, if detected": rate([line["name"] in line["possible"] for line in found]),
        "in the set, if detected": rate([line["name"] in line["named"] + line["confusable"] for line in found]),
        "unexplained, if detected": rate([line["verdict"] == "unexplained" for line in found]),
        "wrongly named, if detected": rate(
            [line["verdict"] == "named" and line["name"] not in line["named"] for line in found]
        ),
        "covered": rate([line["covered"] for line in lines if "covered" in line]),
        "causes in the set": float(np.mean([len(line["possible"]) for line in found])) if found else float("nan"),
    }


def _strange(lines: Sequence[Line]) -> dict[str, Any]:
    """Effects that no cause of the library has."""
    found = {}
    for d_prime, of_d in _grouped(lines, lambda line: f"{line['d_prime']:g}").items():
        kinds = {"all": of_d} | _grouped(of_d, _name)
        found[d_prime] = {
            kind: {
                verdict: rate([line["verdict"] == verdict for line in part])
                for verdict in ("unexplained", "named", "confusable", "adequate")
            }
            for kind, part in kinds.items()
        }
    return found


def _mean_limit(lines: Sequence[Line], limit: dict[str, dict[str, float]]) -> dict[str, float]:
    names = [line["name"] for line in lines]
    return {key: float(np.mean([limit[name][key] for name in names])) for key in ("detected", "first")}


def _name(line: Line) -> str:
    return line["name"]


def _grouped(lines: Iterable[Line], key: Callable[[Line], str]) -> dict[str, list[Line]]:
    groups: dict[str, list[Line]] = {}
    for line in lines:
        groups.setdefault(key(line), []).append(line)
    return groups
