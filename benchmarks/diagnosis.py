"""How often the diagnosis is right: detection, attribution and false alarms on data sets with hidden effects, as JSON.

python -m benchmarks.diagnosis --sets 100 --out results/benchmarks/diagnosis.json

The data come from `tests/blind`, which shares no code with the package, on seeds that chose no threshold. Beside each
rate stands its limit: the same for known white noise and known directions, by the largest projection.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import platform
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

import arfjax as ax
from inverse.datasets.dma import read_dma
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.dma_problem import dma_problem
from inverse.diagnosis.examination import Examined, examine
from inverse.diagnosis.screening import Screen
from inverse.dma_fit import FRACTIONAL
from tests.blind import dma_generator as blind

TESTABLE = [name for name in blind.EFFECTS if name != "clamp-compliance"]
NOISES = ("white", "tails", "correlated-0.3", "correlated-0.6", "loud")


def examined(seed: int, *, without: str = "", **hidden) -> Examined:
    """Examine one data set; `without` takes a cause out of the library."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data.csv"
        blind.write(data, Path(folder) / "key.json", seed=blind.TEST_SEEDS + seed, **hidden)
        problem, _ = dma_problem(read_dma(data), FRACTIONAL)
    causes = [cause for cause in DMA_CAUSES if cause.name != without]
    return examine(problem, causes, np.random.default_rng(seed))


def rates(name: str, sets: int, first_seed: int, **hidden) -> dict[str, float]:
    """Of one hidden effect: found, ranked first, inside the reported set, called unexplained, size of the set."""
    found, first, inside, unexplained, sizes = [], [], [], [], []
    for seed in range(first_seed, first_seed + sets):
        one = examined(seed, name=name, **hidden)
        decision = one.decision
        ranked = decision.omnibus.ranked(list({a.name for a in one.seen}))
        found.append(decision.verdict != "adequate")
        first.append(ranked[0] == name)
        if found[-1]:
            inside.append(name in decision.named)
            unexplained.append(decision.verdict == "unexplained")
            sizes.append(len(decision.named))
    return {
        "detected": float(np.mean(found)),
        "first": float(np.mean(first)),
        "in the set, if detected": float(np.mean(inside)),
        "unexplained, if detected": float(np.mean(unexplained)),
        "causes in the set": float(np.mean(sizes)),
        "sets": sets,
    }


def limits(d_prime: float, sets: int = 4000) -> dict[str, dict[str, float]]:
    """Detected and ranked first if noise and directions were known: largest projection, threshold at 5 %."""
    one = examined(0)
    screen = Screen(one.fitted, one.seen, one.family[:1])
    rng = np.random.default_rng(1)
    directions = screen.projected()
    signs = np.array([alternative.sign for alternative in screen.alternatives])
    owners = np.array([alternative.name for alternative in screen.alternatives])

    def evidence(data):
        projected = directions.T @ data
        return np.where(signs[:, None] > 0, projected, np.abs(projected))

    noise = rng.standard_normal((len(one.residuals), sets))
    threshold = np.quantile(evidence(noise).max(axis=0), 0.95)
    found = {}
    for name in dict.fromkeys(owners):
        member = np.flatnonzero(owners == name)
        seen = evidence(d_prime * directions[:, [member[len(member) // 2]]] + noise)
        found[name] = {
            "detected": float(np.mean(seen.max(axis=0) > threshold)),
            "first": float(np.mean(owners[seen.argmax(axis=0)] == name)),
        }
    return found


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--sets", type=int, default=20, help="data sets of each kind")
    parser.add_argument("--only", default="", help="part of the study: known, null, unknown or removed")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    begun, result = time.perf_counter(), {}
    parts = {"known": _known, "null": _null, "unknown": _unknown, "removed": _removed}
    for part, measure in parts.items():
        if given.only in ("", part):
            result[part] = measure(given.sets)
    result |= {
        "benchmark": "diagnosis",
        "seconds": round(time.perf_counter() - begun, 1),
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
    }
    if given.out is not None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        given.out.write_text(json.dumps(result, indent=2) + "\n")


def _known(sets: int) -> dict:
    found = {}
    for d_prime in (4.5, 6.0):
        limit = limits(d_prime)
        for index, name in enumerate(TESTABLE):
            one = rates(name, sets, 1000 * (index + 1) + int(100 * d_prime), d_prime=d_prime) | {"limit": limit[name]}
            found[f"{name}, d' = {d_prime}"] = one
            print(
                f"d' {d_prime} {name:22s} detected {one['detected']:.2f} ({limit[name]['detected']:.2f})  "
                f"first {one['first']:.2f} ({limit[name]['first']:.2f})  in set {one['in the set, if detected']:.2f}  "
                f"unexplained {one['unexplained, if detected']:.2f}  size {one['causes in the set']:.1f}",
                flush=True,
            )
    return found


def _verdicts(sets: int, first_seed: int, **options) -> dict[str, float]:
    verdicts = [examined(seed, **options).decision.verdict for seed in range(first_seed, first_seed + sets)]
    return {verdict: verdicts.count(verdict) / sets for verdict in sorted(set(verdicts))}


def _null(sets: int) -> dict:
    found = {}
    for index, noise in enumerate(NOISES):
        found[noise] = _verdicts(sets, 30_000 + 1000 * index, noise=noise)
        print(f"nothing hidden, {noise:15s}", found[noise], flush=True)
    return found


def _unknown(sets: int) -> dict:
    found = {}
    for index, name in enumerate(blind.UNKNOWN):
        for d_prime in (5.0, 9.0):
            found[f"{name}, d' = {d_prime}"] = _verdicts(
                sets, 40_000 + 1000 * index + int(10 * d_prime), name=name, d_prime=d_prime
            )
            print(f"d' {d_prime} {name:16s}", found[f"{name}, d' = {d_prime}"], flush=True)
    return found


def _removed(sets: int) -> dict:
    found = {}
    for index, name in enumerate(TESTABLE):
        found[name] = _verdicts(sets, 60_000 + 1000 * index, name=name, d_prime=9.0, without=name)
        print(f"d' 9 taken out of the library: {name:22s}", found[name], flush=True)
    return found


if __name__ == "__main__":
    main()
