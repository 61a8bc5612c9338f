"""The operating characteristic of the diagnosis summed up: rates beside their limits."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

Line = dict[str, Any]
Rate = dict[str, float]
DETECTED = ("named", "confusable", "unexplained")
"""Verdicts that say that the simulation is wrong: of noise alone each is a false alarm. That the noise is another than
one thought (`noise-model`) is none of them."""

NO_DATA = "no data"
"""In place of a verdict: in this tissue no strength has the wanted d', or none that there can be."""
SEEN = 0.9
"""Power above which what a stand-in leaves of a cause taken out is enough to be seen: as many are to be unexplained."""


def rate(happened: Sequence[bool]) -> Rate:
    """Share, its standard error (of Wilson's interval, which has a width at 0 and 1, too), and of how many."""
    count = len(happened)
    if not count:
        return {"rate": float("nan"), "error": float("nan"), "sets": 0}
    share = float(np.mean(happened))
    error = np.sqrt(share * (1.0 - share) / count + 0.25 / count**2) / (1.0 + 1.0 / count)
    return {"rate": share, "error": float(error), "sets": count}


def summarise(
    lines: Sequence[Line],
    limit: dict[str, dict[str, dict[str, float]]],
    removed: dict[str, dict[str, dict[str, Any]]] | None = None,
    nameless: dict[str, dict[str, dict[str, Any]]] | None = None,
    in_unequal: dict[str, dict[str, dict[str, float]]] | None = None,
) -> dict[str, Any]:
    """All rates of a record.

    Args:
        lines: One for each data set.
        limit: From `limits`; causes that its designs cannot show have none.
        removed: What stand-ins leave of causes taken out, from `benchmarks.diagnosis_rests`.
        nameless: The same of effects in no list.
        in_unequal: As `limit`, in noise of which magnitude and phase are unequal, its sizes known.
    """
    every, lines = lines, [line for line in lines if line["verdict"] != NO_DATA]
    # A cause that a diagnosis lists as one that the data cannot show is none that it can name: see `_unseen`.
    hidden = [line for line in lines if line["part"] in ("known", "unequal")]
    known, unequal = ([line for line in hidden if line["part"] == part] for part in ("known", "unequal"))
    return {
        **_of_known(known, limit),
        "unequal": _of_known(unequal, in_unequal or {}),
        "null": {
            noise: {
                "alarm": rate([line["verdict"] in DETECTED for line in part]),
                "noise-model": rate([line["verdict"] == "noise-model" for line in part]),
            }
            for noise, part in _grouped((ln for ln in lines if ln["part"] == "null"), lambda ln: ln["noise"]).items()
        },
        **{part: _strange([line for line in lines if line["part"] == part]) for part in ("unknown", "removed")},
        "removed limit": removed or {},
        "unknown limit": nameless or {},
        "removed, to be seen": _to_be_seen(lines, removed or {}),
        "data sets": len(lines),
        "no such data": len(every) - len(lines),
        "not testable": _unseen([line for line in hidden if not _is_testable(line)]) | {"of": len(hidden)},
        "seconds a set": float(np.median([line["seconds"] for line in lines])) if lines else float("nan"),
    }


def _of_known(lines: Sequence[Line], limit: dict[str, dict[str, dict[str, float]]]) -> dict[str, Any]:
    """Rates of known causes by d', of each and of all."""
    known = _grouped((line for line in lines if _is_testable(line)), lambda line: f"{line['d_prime']:g}")
    return {
        "known": {
            d: {
                name: _known(part) | ({"limit": limit[d][name]} if name in limit.get(d, {}) else {})
                for name, part in _grouped(of_d, _name).items()
            }
            for d, of_d in known.items()
        },
        "all known": {
            d: _known(of_d) | ({"limit": _mean_limit(of_d, limit[d])} if d in limit else {})
            for d, of_d in known.items()
        },
    }


def _known(lines: Sequence[Line]) -> dict[str, Any]:
    found = [line for line in lines if line["verdict"] in DETECTED]
    return {
        "detected": rate([line["verdict"] in DETECTED for line in lines]),
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
                **{verdict: rate([line["verdict"] == verdict for line in part]) for verdict in DETECTED},
                "any name": rate([line["verdict"] in ("named", "confusable") for line in part]),
                "not found": rate([line["verdict"] not in DETECTED for line in part]),
            }
            for kind, part in kinds.items()
        }
    return found


def _to_be_seen(lines: Sequence[Line], removed: dict[str, dict[str, dict[str, Any]]]) -> dict[str, Any]:
    """Causes taken out of which who knows what the best stand-in leaves would see it in `SEEN` of all."""
    seen = {(d, name): one.get("noise unknown", 0.0) for d, of_d in removed.items() for name, one in of_d.items()}
    kept = {which for which, power in seen.items() if power >= SEEN}
    left = [line for line in lines if line["part"] == "removed" and (f"{line['d_prime']:g}", line["name"]) in kept]
    return {d: one["all"] for d, one in _strange(left).items()}


def _mean_limit(lines: Sequence[Line], limit: dict[str, dict[str, float]]) -> dict[str, float]:
    names = [line["name"] for line in lines if line["name"] in limit]
    keys = next(iter(limit.values()), {})
    return {key: float(np.mean([limit[name][key] for name in names])) for key in keys}


def _unseen(lines: Sequence[Line]) -> dict[str, Any]:
    """What became of hidden causes that the diagnosis lists as not testable."""
    named = [line["named"] + line["confusable"] for line in lines]
    return {
        "names": sorted({line["name"] for line in lines}),
        "sets": len(lines),
        "given other names": sum(bool(names) for names in named),
    }


def _is_testable(line: Line) -> bool:
    """Whether the diagnosis takes the hidden cause for one that it could find in these data."""
    return line.get("testable", True)


def _name(line: Line) -> str:
    return line["name"]


def _grouped(lines: Iterable[Line], key: Callable[[Line], str]) -> dict[str, list[Line]]:
    groups: dict[str, list[Line]] = {}
    for line in lines:
        groups.setdefault(key(line), []).append(line)
    return groups
