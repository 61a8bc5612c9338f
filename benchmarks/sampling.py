"""Samplers on one posterior of real data: agreement, effective samples per second, evaluations per second; as JSON.

python -m benchmarks.sampling --out results/benchmarks/sampling.json
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import platform
import time
from pathlib import Path

import emcee
import jax
import numpy as np

from inverse.datasets.dma import group_sweeps, read_dma
from inverse.datasets.shipped import shipped
from inverse.inference.dma import dma_problem
from inverse.inference.problem import Problem
from inverse.sampling import (
    bridge_evidence,
    compare,
    diagnose_draws,
    importance_evidence,
    laplace,
    sample_ensemble,
    sample_importance,
    sample_nuts,
    walkers_from_laplace,
)
from inverse.sampling.target import batched_log_density

SWEEP = 18
"""85 degC: every constant is informed, along a bent ridge."""


def evaluations(problem: Problem, points: np.ndarray, repeats: int) -> dict[str, float]:
    """Log densities a second by the size of the batch, after compilation; the fastest of several calls."""
    found, evaluate = {}, batched_log_density(problem)
    for count in (1, 32, 128, 1024):
        batch, times = points[:count], []
        evaluate(batch)
        for _ in range(repeats):
            begun = time.perf_counter()
            evaluate(batch)
            times.append(time.perf_counter() - begun)
        found[str(count)] = count / min(times)
    return found


def case(problem: Problem, *, draws: int, most_steps: int, walkers: int, repeats: int) -> dict:
    """All samplers on a problem; times include compilation, as a user meets it, but for the second run of NUTS."""
    begun = time.monotonic()
    found = laplace(problem)
    seconds = time.monotonic() - begun
    points = found.draw(jax.random.key(0), 1024)
    start = walkers_from_laplace(problem, found, count=walkers)
    runs = {"nuts": sample_nuts(problem, found, seed=1, draws=draws, target_acceptance=0.95)}
    again = sample_nuts(problem, found, seed=2, draws=draws, target_acceptance=0.95)
    moves = [(emcee.moves.StretchMove(), 1.0)]
    runs["emcee, differential evolution"] = sample_ensemble(problem, start, seed=1, most_steps=most_steps)
    runs["emcee, stretch"] = sample_ensemble(problem, start, seed=1, most_steps=most_steps, moves=moves)
    weighted = sample_importance(problem, found, seed=1, draws=draws, evaluations=20_000, most_evaluations=400_000)
    compared = compare(problem, {"nuts": runs["nuts"], "nuts, compiled": again, **runs, "importance": weighted})
    evidences = {name: bridge_evidence(problem, run) for name, run in runs.items()}
    evidences["importance"] = importance_evidence(weighted)
    runs["importance"] = weighted
    return {
        "parameters": list(problem.parameters.names),
        "laplace": {"seconds": seconds, "log evidence": found.log_evidence, "message": found.message},
        "evaluations per second by batch": evaluations(problem, points, repeats),
        "comparison": compared.as_dict(),
        "messages": {name: run.message for name, run in runs.items()},
        "complaints": {name: list(diagnose_draws(problem, run).complaints) for name, run in runs.items()},
        "log evidence": {
            name: {"value": one.log_evidence, "standard error": one.standard_error, "warnings": list(one.warnings)}
            for name, one in evidences.items()
        },
    }


def main() -> None:
    """Measure and write JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one short case: does it run?")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    sweeps = group_sweeps(read_dma(shipped("pyvisco_polymer")))
    single = dma_problem(sweeps[SWEEP : SWEEP + 1])
    several = dma_problem(sweeps[SWEEP : SWEEP + 3], across="temperature")
    cases = {
        "one sweep": (single, {"draws": 1000, "most_steps": 20_000, "walkers": 128, "repeats": 20}),
        "three sweeps of one population": (several, {"draws": 500, "most_steps": 5_000, "walkers": 128, "repeats": 20}),
    }
    if options.quick:
        cases = {"one sweep": (single, {"draws": 100, "most_steps": 400, "walkers": 32, "repeats": 2})}
    found: dict = {"machine": platform.machine(), "jax": jax.__version__}
    options.out.parent.mkdir(parents=True, exist_ok=True)
    for name, (problem, settings) in cases.items():
        found[name] = case(problem, **settings)
        options.out.write_text(json.dumps(found, indent=1))  # after each, since they take minutes
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
