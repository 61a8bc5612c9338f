"""How far estimates of strengths are off without any noise, for the sets of the record of curves, as JSON.

python -m benchmarks.diagnosis_intervals --workers 2

Every set of `benchmarks.diagnosis_hmi` in which a known cause has an estimate is simulated again, on the generator's
mesh and without noise, and fitted with its cause by the diagnosis's own simulation. What remains is what the mesh and
what is believed of the constants do to the strength, in standard errors of the noise that the set has; intervals know
nothing of it. Beside it is the error in the record, noise and all, in quarters of its interval (which is four standard
errors long): of causes that come out on one side there, it tells chance from a fault.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import platform
from pathlib import Path
from typing import Any

import jax
import numpy as np
from scipy import stats

import arfjax as ax
from benchmarks.diagnosis_hmi import TRUE_SHAPES, Condition, measured, prepared_bench
from benchmarks.diagnosis_record import lines_of
from benchmarks.spread import spread
from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.prepare import hmi_problem_of
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.refit import fit_in_full
from inverse.diagnosis.regression import INTERVAL_LEVEL
from inverse.inference.experiment import inference_settings

RECORD = Path("benchmarks/records/diagnosis_hmi.jsonl")
_NOISELESS = 1e-9
"""Relative size of the noise: a data file has ten digits."""


def one_set(line: dict[str, Any]) -> dict[str, Any]:
    """One line of the record with the error of its strength, and with what is left of it without noise."""
    problem = _without_noise(line)
    cause = next(one for one in HMI_CAUSES if one.name == line["name"])
    extension = Extension(cause, TRUE_SHAPES.get(cause.name, cause.shapes[0]))
    white, start = problem.noise_family()[0], problem.program.null()
    fit = fit_in_full(
        problem, [extension], white, size=line["size"], start=start, strengths=np.array([line["strength"]])
    )
    error = (float(fit.strengths[0]) - line["strength"]) / _standard_error(fit, line["size"])
    lower, upper = line["interval"]
    return {
        "name": line["name"],
        "seed": line["seed"],
        "d_prime": line["d_prime"],
        "strength": line["strength"],
        "without noise": error if fit.converged else None,
        "in the record": (line["estimate"] - line["strength"]) / (0.25 * (upper - lower)),
        "covered": line["covered"],
    }


def _without_noise(line: dict[str, Any]) -> HmiDiagnosisProblem:
    bench = prepared_bench()
    condition = Condition(line["part"], line["name"], line["d_prime"], size=_NOISELESS)
    data, _ = measured(bench, condition, line["seed"], strength=line["strength"])
    settings = inference_settings(bench.described, "suomi2016_experiment")
    return hmi_problem_of(bench.prepared, data, bench.described, settings, HMI_CAUSES, program=bench.program)


def _standard_error(fit: HmiFit, size: float) -> float:
    """Of the strength in noise of a size, from the interval that the fit has by its own residuals."""
    reach = stats.t.ppf(0.5 + 0.5 * INTERVAL_LEVEL, fit.freedom)
    return float((fit.intervals[0, 1] - fit.strengths[0]) / reach * size / np.sqrt(fit.variance))


def summed_up(found: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean and largest of the errors, of all sets and by cause."""

    def of(lines: list[dict[str, Any]]) -> dict[str, Any]:
        errors = {
            kind: [line[kind] for line in lines if line[kind] is not None]
            for kind in ("without noise", "in the record")
        }
        return {"sets": len(lines), "covered": sum(line["covered"] for line in lines)} | {
            kind: {"mean": float(np.mean(some)), "largest": float(max(some, key=abs))}
            for kind, some in errors.items()
            if some
        }

    names = sorted({line["name"] for line in found})
    return {"all": of(found)} | {name: of([line for line in found if line["name"] == name]) for name in names}


def main() -> None:
    """Measure and sum up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/diagnosis_intervals.json"))
    parser.add_argument("--record", type=Path, default=RECORD, help="of benchmarks.diagnosis_hmi")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    lines = lines_of(given.record)
    todo = [(line,) for line in lines if line["part"] == "known" and "estimate" in line]
    found = list(spread(one_set, todo, workers=given.workers))
    content = {
        "benchmark": "diagnosis_intervals",
        "errors": summed_up(found),
        "sets": found,
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
    }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
