"""How often a dynamic mechanical analysis with an effect in it is found wrong at all, on many sets, as JSON.

python -m benchmarks.diagnosis_detection --workers 2

The test of everything alone, nothing put into the model, so that a set takes less than a second and the rate at
d' = 4.5, where it is asked for, is known to a point: the study of all rates (`benchmarks.diagnosis`) has a quarter as
many sets there. Seeds are of its own.
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

import arfjax as ax
from benchmarks.diagnosis import measured, testable
from benchmarks.diagnosis_limits import dma_design, limits
from benchmarks.diagnosis_summary import rate
from benchmarks.spread import spread
from inverse.diagnosed import MODELS
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.decision import REPLICATES
from inverse.diagnosis.dma.examination import examine_dma
from tests.blind.no_such_effect import NoSuchEffect

D_PRIME, LEVEL = 4.5, 0.05
SETS = 60
"""Of each cause."""
_FIRST_SEED = {"fractional": 3_220_000, "zener": 3_230_000}
_SEEDS_A_CAUSE = 100
_DESIGNS = 5


def one_set(model: str, name: str, seed: int) -> dict[str, Any]:
    """The p-value of one data set; none where no strength of the cause shows so much."""
    try:
        problem, _ = measured(seed, model, name=name, d_prime=D_PRIME, noise="white")
    except NoSuchEffect:
        return {"name": name, "seed": seed, "p": None}
    # At level 0 nothing is found, so that nothing is put into the model after the test of everything.
    examined = examine_dma(
        problem, DMA_CAUSES, np.random.default_rng(seed), program=DMA_CAUSES, level=0.0, replicates=REPLICATES
    )
    return {"name": name, "seed": seed, "p": examined.decision.omnibus.p_value}


def planned(sets: int, model: str) -> list[tuple[str, str, int]]:
    """Model, cause and seed of every set, a round of all causes after the other.

    Raises:
        SystemExit: if so many sets would take seeds of other causes.
    """
    if not 0 < sets <= _SEEDS_A_CAUSE:
        raise SystemExit(f"--sets: must be from 1 to {_SEEDS_A_CAUSE}, got {sets}: causes would share seeds.")
    first = _FIRST_SEED[model]
    return [
        (model, name, first + _SEEDS_A_CAUSE * place + number)
        for number in range(sets)
        for place, name in enumerate(testable(model))
    ]


def found_by_cause(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """How often sets of each cause, and of all, are found wrong."""
    made = [line for line in lines if line["p"] is not None]
    by_cause = {line["name"]: [one["p"] <= LEVEL for one in made if one["name"] == line["name"]] for line in made}
    return {
        "all": rate([line["p"] <= LEVEL for line in made]),
        "by cause": {name: rate(found) for name, found in by_cause.items()},
        "no such data": len(lines) - len(made),
    }


def main() -> None:
    """Measure and sum up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="below results/benchmarks, by the model, if not given")
    parser.add_argument("--model", choices=tuple(MODELS), default="fractional", help="null model")
    parser.add_argument("--sets", type=int, default=SETS, help="of each cause")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    given = parser.parse_args()
    out = given.out or Path("results/benchmarks") / f"diagnosis_detection_{given.model}.json"
    jax.config.update("jax_enable_x64", True)
    lines = list(spread(one_set, planned(given.sets, given.model), workers=given.workers))
    designs = [dma_design(measured(_FIRST_SEED[given.model] - 1 - i, given.model)[0]) for i in range(_DESIGNS)]
    limit = limits(designs, [D_PRIME])[f"{D_PRIME:g}"].values()
    content = {
        "benchmark": "diagnosis_detection",
        "model": given.model,
        "d_prime": D_PRIME,
        "level": LEVEL,
        "seeds": [min(line["seed"] for line in lines), max(line["seed"] for line in lines)],
        "found": found_by_cause(lines),
        "limit": float(np.mean([one["detected"] for one in limit])),
        "limit, noise unknown": float(np.mean([one["detected, noise unknown"] for one in limit])),
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
