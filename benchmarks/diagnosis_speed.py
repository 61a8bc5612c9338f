"""How long a diagnosis takes, step by step, as JSON.

python -m benchmarks.diagnosis_speed --out results/benchmarks/diagnosis_speed.json

Whole diagnoses, held-out gain included, of shipped measurements as a person runs them: everything compiled. Then what
testing all causes takes once it is compiled, on simulated data sets (development seeds): nothing hidden, so that
screening is all there is, and an effect that is found, so that causes are refitted as well. What is asked for stands
beside what it took, in the file and on the terminal.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import platform
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import jax

import arfjax as ax
import inverse
from benchmarks.diagnosis_hmi import Condition, measured, prepared_bench
from inverse.datasets.dma import read_dma
from inverse.datasets.shipped import shipped
from inverse.diagnosis import diagnose_dma, diagnose_hmi
from tests.blind import dma_generator

EXAMPLES = Path(__file__).parents[1] / "examples"
TESTING_DMA, TESTING_CURVES, WHOLE = "testing all causes of a DMA", "testing all causes of curves", "whole diagnosis"
NOTHING, FOUND = "nothing hidden", "found"
LIMITS = {TESTING_DMA: 2.0, TESTING_CURVES: 30.0, WHOLE: 600.0}
"""What is asked for [s], of screening where nothing is found and refitted."""
TESTING = "testing all causes"
SEEDS = (520, 521, 522, 523)
"""Of sets of a DMA; the first compiles."""


class Clock:
    """Seconds of each step, by the first words that it is told with."""

    def __init__(self) -> None:
        """Begin."""
        self._begun: list[tuple[str, float]] = []

    def __call__(self, words: str) -> None:
        """Note the time at which a step begins."""
        self._begun.append((words.split(" with ")[0].split(":")[0], time.perf_counter()))

    def steps(self) -> dict[str, float]:
        """Steps of one name together; the last ends now."""
        ends = [at for _, at in self._begun[1:]] + [time.perf_counter()]
        found: dict[str, float] = {}
        for (name, at), end in zip(self._begun, ends, strict=True):
            found[name] = round(found.get(name, 0.0) + end - at, 2)
        return found


def whole(**given) -> dict:
    """A diagnosis as the command makes it, report and figures written; the last step has these."""
    clock, start = Clock(), time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        found = inverse.diagnose(**given, out=Path(folder) / "out", on_step=clock)
    steps = clock.steps()
    return {"verdict": found.verdict, "seconds": round(time.perf_counter() - start, 2), "steps": steps}


def whole_of_curves(name: str, d_prime: float, seed: int) -> dict:
    """The same of three simulated sonications of 57 readings, with all nine constants free."""
    bench = prepared_bench()
    data = measured(bench, Condition("known", name, d_prime), seed)[0]
    jax.clear_caches()  # of what made the data
    return whole(hmi=data, experiment=bench.described)


def tested(diagnose: Callable[[int, Callable[[str], None]], str], seeds: tuple[int, ...]) -> dict:
    """Testing all causes of several data sets after one that compiles: median and all."""
    runs, verdicts = [], []
    for seed in seeds:
        clock = Clock()
        verdicts.append(diagnose(seed, clock))
        runs.append(clock.steps()[TESTING])
    return {"seconds": statistics.median(runs[1:]), "first_s": runs[0], "runs_s": runs[1:], "verdicts": verdicts[1:]}


def of_dma(**hidden) -> dict:
    """Of a dynamic mechanical analysis with an effect in it, or none."""

    def diagnose(seed: int, clock: Callable[[str], None]) -> str:
        with tempfile.TemporaryDirectory() as folder:
            data, key = Path(folder) / "data.csv", Path(folder) / "key.json"
            dma_generator.write(data, key, seed=seed, **hidden)
            return diagnose_dma(read_dma(data), gain=False, on_step=clock).verdict

    return tested(diagnose, SEEDS)


def of_curves(name: str, d_prime: float, seeds: tuple[int, ...]) -> dict:
    """The same of curves of displacement."""
    bench = prepared_bench()
    condition = Condition("known" if d_prime else "null", name, d_prime)

    def diagnose(seed: int, clock: Callable[[str], None]) -> str:
        return diagnose_hmi(
            measured(bench, condition, seed)[0], bench.described, seed=seed, gain=False, prepared=bench.prepared,
            program=bench.program, on_step=clock,
        ).verdict  # fmt: skip

    return tested(diagnose, seeds)


PARTS: dict[str, dict[str, Callable[[], dict]]] = {
    # First, so that nothing of them has been compiled for others.
    WHOLE: {
        "pyvisco_polymer, conventional": lambda: whole(dma=shipped("pyvisco_polymer"), model="zener"),
        "suomi2016_hmi": lambda: whole(hmi=shipped("suomi2016_hmi"), experiment=EXAMPLES / "suomi2016_published.toml"),
        "three sonications": lambda: whole_of_curves("output-drift", 9.0, 4501),
    },
    TESTING_DMA: {NOTHING: of_dma, FOUND: lambda: of_dma(name="sweep-drift", d_prime=9.0)},
    TESTING_CURVES: {
        NOTHING: lambda: of_curves("none", 0.0, (4501, 4502, 4503)),
        FOUND: lambda: of_curves("output-drift", 9.0, (4501, 4502)),
    },
}


def beside_limit(name: str, part: str, took: dict) -> dict:
    """What a part took, and whether that is what was asked for, where anything was."""
    if part == FOUND:
        return took
    return {**took, "limit_s": LIMITS[name], "met": took["seconds"] <= LIMITS[name]}


def in_words(name: str, part: str, took: dict) -> str:
    """A line of what was measured."""
    asked = f" ({took['limit_s']:.0f} asked for: {'met' if took['met'] else 'not met'})" if "met" in took else ""
    return f"{name}, {part}: {took['seconds']:.2f} s{asked}"


def main() -> None:
    """Measure, writing each part as it comes: all of them take an hour."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/diagnosis_speed.json"))
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    content: dict = {
        "benchmark": "diagnosis_speed",
        "complete": False,
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
    }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    for name, parts in PARTS.items():
        for part, measure in parts.items():
            took = content.setdefault(name, {})[part] = beside_limit(name, part, measure())
            print(in_words(name, part, took), flush=True)
            content["complete"] = all(len(content.get(each, {})) == len(PARTS[each]) for each in PARTS)
            given.out.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
