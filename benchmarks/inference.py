"""Times and errors of the fast model of HMI curves that posteriors are sampled with, as JSON.

python -m benchmarks.inference --out results/benchmarks/inference.json
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import platform
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import arfjax as ax
from benchmarks.chain import timed
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.fast_hmi import FastHmi, prepare_fast
from inverse.hmi_fit import CalibrationSettings, Constants, constants_of
from inverse.hmi_model import Sweep, plan_sweeps

DESCRIBED = ax.read_experiment(shipped("suomi2016_experiment"))
TEMPERATURES = np.asarray(DESCRIBED.protocol.temperatures_c)
WIDER = 1.3
"""Draws to prepare with are this much wider than the prior."""
LIMITS = {"single": 0.050, "gradient over value": 5.0, "error": 0.005}
"""What is asked for: seconds, and two ratios."""


def curve_of() -> tuple[Sweep, ...]:
    """The paper's eight temperatures, as data that a posterior would be of."""
    n = len(TEMPERATURES)
    data = HmiData(Path("paper"), ("1",) * n, TEMPERATURES, None, np.full(n, 100.0), True, None, ())
    return plan_sweeps(data, DESCRIBED.stepwise(), float(TEMPERATURES[0]))


def draws_of(constants: Constants, count: int, *, seed: int, width: float = 1.0) -> list[ax.Model]:
    """Models with constants drawn from the prior, the first its centre."""
    rng = np.random.default_rng(seed)
    model = DESCRIBED.model()
    apply = jax.jit(lambda z: constants.apply(model, constants.values(z)))
    n = len(constants.parameters)
    return [apply(jnp.asarray(width * rng.normal(size=n) if i else np.zeros(n))) for i in range(count)]


def prepared(
    constants: Constants, effort: ax.Effort, refinement: float, count: int
) -> tuple[FastHmi, dict[str, float | int]]:
    """The fast model, and what making it took."""
    start = time.perf_counter()
    model = DESCRIBED.model()
    draws = draws_of(constants, count, seed=0, width=WIDER)
    fast = prepare_fast(draws, curve_of(), ax.discretise(model, refinement=refinement), effort=effort)
    facts: dict[str, float | int] = {"seconds": time.perf_counter() - start, "shapes": fast.curve.solid.n_modes}
    facts |= {"points": len(fast.curve.solid.r), "draws": count, "pushes": effort.n_pushes}
    return fast, facts


def times(fast: FastHmi, constants: Constants, walkers: tuple[int, ...], repeats: int) -> dict[str, dict | float]:
    """Of a curve, of a misfit and of its gradient, alone and for many walkers at once."""
    model, n = DESCRIBED.model(), len(TEMPERATURES)

    def rows(z: jax.Array) -> jax.Array:
        return fast.predict(constants.apply(model, constants.values(z)), n_rows=n, in_percent=True)

    def misfit(z: jax.Array) -> jax.Array:
        return 0.5 * jnp.sum(((rows(z) - 95.0) / 3.0) ** 2) + 0.5 * jnp.sum(z**2)

    at = jnp.zeros(len(constants.parameters))
    cases: dict[str, dict | float] = {
        "single": timed(jax.jit(rows), at, repeats=repeats),
        "value": timed(jax.jit(misfit), at, repeats=repeats),
        "value and gradient": timed(jax.jit(jax.value_and_grad(misfit)), at, repeats=repeats),
    }
    cases["gradient over value"] = _median(cases["value and gradient"]) / _median(cases["value"])
    rng = np.random.default_rng(1)
    for count in walkers:
        many = jnp.asarray(0.5 * rng.normal(size=(count, len(at))))
        value = timed(jax.jit(jax.vmap(misfit)), many, repeats=repeats)
        both = timed(jax.jit(jax.vmap(jax.value_and_grad(misfit))), many, repeats=repeats)
        cases[f"{count} walkers"] = value | {"per_walker_s": _median(value) / count}
        cases[f"{count} walkers, gradient"] = both | {"over value": _median(both) / _median(value)}
    return cases


def errors(fast: FastHmi, constants: Constants, count: int, refinement: float) -> dict[str, float | list[float]]:
    """Against the reference setting, for fresh draws of the prior."""
    settings = ax.discretise(DESCRIBED.model(), refinement=refinement)
    checked = fast.verify(draws_of(constants, count, seed=7), settings, n_rows=len(TEMPERATURES), in_percent=True)
    points = np.max(np.abs(checked.fast - checked.full), axis=1)[checked.covered]
    return {
        "largest": checked.largest_error,
        "median": float(np.median(checked.errors[checked.covered])),
        "covered": float(np.mean(checked.covered)),
        "largest difference of each, percent points": points.tolist(),
    }


def _median(case: dict | float) -> float:
    assert isinstance(case, dict)
    return case["median_s"]


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--quick", action="store_true", help="small cases, to see that it runs")
    parser.add_argument("--draws", type=int, default=24, help="models that the error is measured at")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    constants = constants_of(DESCRIBED.model(), CalibrationSettings())
    effort = ax.Effort(n_pushes=12, n_modes=16, n_terms=6) if given.quick else ax.Effort()
    fast, preparation = prepared(constants, effort, 0.5 if given.quick else 2.0, 20 if given.quick else 120)
    print(f"preparation {preparation['seconds']:.0f} s, {preparation['points']} points", flush=True)
    cases = times(fast, constants, (4,) if given.quick else (16, 64), 1 if given.quick else 7)
    print(json.dumps(cases, indent=1), flush=True)
    error = errors(fast, constants, 2 if given.quick else given.draws, 0.5 if given.quick else 3.0)
    print(f"largest error {error['largest']}", flush=True)
    result = {
        "benchmark": "inference",
        "device": str(jax.devices()[0]),
        "machine": platform.machine(),
        "cpu_count": os.cpu_count(),
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
        "asked_for": LIMITS,
        "preparation": preparation,
        "cases": cases,
        "errors": error,
    }
    if given.out is not None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        given.out.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
