"""Times of every stage of the chain on the paper's case, and of its gradient: medians after compilation, as JSON.

python benchmarks/chain.py --out results/benchmarks/chain.json
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp

import arfjax as ax
from arfjax.numerics.sparse_direct import release_factors
from inverse.datasets.shipped import shipped

EXPERIMENT = shipped("suomi2016_experiment")


def timed(function: Callable, *arguments, repeats: int = 7) -> dict[str, float]:
    """Seconds of the first call (compilation included) and the median of the next ones.

    Factors of matrices are kept from call to call, which a model that is fitted changes each time: every call makes
    its own.
    """
    release_factors()
    start = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    first = time.perf_counter() - start
    runs = []
    for _ in range(repeats):
        release_factors()
        start = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        runs.append(time.perf_counter() - start)
    return {"first_s": round(first, 4), "median_s": round(statistics.median(runs), 4), "repeats": repeats}


def stages() -> dict[str, dict[str, float]]:
    """Every stage alone, the whole curve of eight temperatures, and its gradient to the whole model."""
    described = ax.read_experiment(EXPERIMENT)
    model, protocol = described.model(), described.stepwise()
    settings = ax.discretise(model)
    temperatures = jnp.asarray(described.protocol.temperatures_c)
    mesh = settings.mesh

    def field(model, temperature):
        return ax.layered_field(model, temperature, protocol, settings, r=mesh.gauss_r, z=mesh.gauss_z)

    heating = eqx.filter_jit(lambda model: ax.simulate_heating(model, protocol, settings))
    heated = heating(model)
    curve = eqx.filter_jit(lambda model: ax.run_stepwise(model, temperatures, protocol, settings).displacement)

    def last_over_first(numbers):
        displacement = ax.stepwise_displacement(
            numbers, temperatures, protocol, settings, heating=ax.simulate_heating(numbers, protocol, settings)
        )
        return displacement[-1] / displacement[0]

    numbers = jax.tree.map(jnp.asarray, model)
    one = jnp.asarray(50.0)
    return {
        "sound field, five layers": timed(eqx.filter_jit(field), model, one),
        "60 s of heating with dose (field included)": timed(heating, model),
        "one push (field included)": timed(
            eqx.filter_jit(
                lambda model, heated: ax.run_stepwise(model, one[None], protocol, settings, heating=heated).displacement
            ),
            model,
            heated,
        ),
        "curve of eight temperatures": timed(curve, model),
        "curve of eight temperatures, gradient": timed(jax.jit(jax.value_and_grad(last_over_first)), numbers),
    }


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    jax.config.update("jax_enable_x64", True)
    result = {
        "benchmark": "chain",
        "case": EXPERIMENT.name,
        "device": str(jax.devices()[0]),
        "machine": platform.machine(),
        "cpu_count": os.cpu_count(),
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
        "stages": stages(),
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(result, indent=2) + "\n")
    for name, seconds in result["stages"].items():
        print(f"{name:45s} {seconds['median_s']:8.3f} s   (first call {seconds['first_s']:.1f} s)")


if __name__ == "__main__":
    main()
