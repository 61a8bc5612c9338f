"""Times of the protocols on the paper's case, and of their gradients: medians after compilation, as JSON.

python -m benchmarks.protocols --out results/benchmarks/protocols.json
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import platform
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp

import arfjax as ax
from arfjax import Model
from benchmarks.chain import timed
from inverse.datasets.shipped import shipped

DESCRIBED = ax.read_experiment(shipped("suomi2016_experiment"))
TEMPERATURES = jnp.asarray(DESCRIBED.protocol.temperatures_c)
FAST, DEFAULT, REFERENCE = 0.7, 1.0, 3.0
"""Refinements: within 0.5 % of the reference, within 0.3 % of it, and the reference itself."""
LIMITS = {"stepwise, fast": 0.5, "stepwise, reference": 15.0, "gradient over run": 5.0}
"""What is asked for: seconds, and a ratio."""


def stepwise(refinement: float, repeats: int, *, gradient: bool = True) -> dict[str, dict | float]:
    """The curve of eight temperatures, its heating included, and the gradient of a misfit to it if asked for."""
    model, curve = stepwise_curve(refinement)
    numbers = jax.tree.map(jnp.asarray, model)
    if not gradient:
        return {"run": timed(eqx.filter_jit(curve), numbers, repeats=repeats)}
    return _both(curve, numbers, repeats)


def stepwise_curve(refinement: float) -> tuple[Model, Callable[[Model], jax.Array]]:
    """The paper's case, and its normalised curve at a refinement as a function of it."""
    model, protocol = DESCRIBED.model(), DESCRIBED.stepwise()
    settings = ax.discretise(model, refinement=refinement)

    def curve(model: Model) -> jax.Array:
        heating = ax.simulate_heating(model, protocol, settings)
        displacement = ax.stepwise_displacement(model, TEMPERATURES, protocol, settings, heating=heating)
        return displacement / displacement[0]

    return model, curve


def errors() -> dict[str, float]:
    """Largest difference of the normalised curve from the reference setting's."""
    curves = {}
    for refinement in (FAST, DEFAULT, REFERENCE):
        model, curve = stepwise_curve(refinement)
        curves[refinement] = eqx.filter_jit(curve)(model)
    return {
        name: float(jnp.max(jnp.abs(curves[refinement] - curves[REFERENCE])))
        for name, refinement in (("stepwise, fast", FAST), ("stepwise", DEFAULT))
    }


def transient(probe: str, repeats: int) -> dict[str, dict | float]:
    """60 s watched from 35 to about 65 degC, field and motion computed again every 2 K."""
    model = DESCRIBED.model_at(15.0 if probe == "push" else 30.0)
    settings = ax.discretise(model)
    shaking = {"frequency": 50.0, "modulation": ax.SineIntensity()}
    mover = ax.ShortPush()
    if probe == "shaking":
        mover = ax.SteadyShaking(**shaking, vibration=ax.resolving(model, 70.0, settings, **shaking))
    protocol = ax.TransientProtocol(ax.Sonication((ax.Phase(60.0, 120),), 35.0, 2.0), mover)

    def curve(model: Model) -> jax.Array:
        displacement = ax.run_transient(model, protocol, settings).displacement
        return displacement / displacement[0]

    return _both(curve, jax.tree.map(jnp.asarray, model), repeats)


def _both(curve: Callable, numbers: Model, repeats: int) -> dict[str, dict | float]:
    run = timed(eqx.filter_jit(curve), numbers, repeats=repeats)
    gradient = timed(jax.jit(jax.value_and_grad(lambda m: jnp.sum((curve(m) - 0.9) ** 2))), numbers, repeats=repeats)
    return {
        "run": run,
        "value and gradient": gradient,
        "gradient over run": round(gradient["median_s"] / run["median_s"], 2),
    }


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--quick", action="store_true", help="small cases, to see that it runs")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    repeats = 1 if given.quick else 5
    wanted: dict[str, Callable[[], dict]] = {"stepwise, fast": lambda: stepwise(0.5 if given.quick else FAST, repeats)}
    if not given.quick:
        wanted |= {
            "stepwise": lambda: stepwise(DEFAULT, repeats),
            "stepwise, reference": lambda: stepwise(REFERENCE, 2, gradient=False),
            "transient, pushes": lambda: transient("push", repeats),
            "transient, shaking at 50 Hz": lambda: transient("shaking", repeats),
        }
    cases = {}
    for name, measure in wanted.items():
        cases[name] = measure()
        print(f"{name:32s} {_line(cases[name])}", flush=True)
    result = {
        "benchmark": "protocols",
        "device": str(jax.devices()[0]),
        "machine": platform.machine(),
        "cpu_count": os.cpu_count(),
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
        "asked_for": LIMITS,
        "cases": cases,
        "errors of the curve": {} if given.quick else errors(),
    }
    if given.out is not None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        given.out.write_text(json.dumps(result, indent=2) + "\n")


def _line(case: dict) -> str:
    line = f"{case['run']['median_s']:8.3f} s"
    if "value and gradient" in case:
        line += f"   with gradient {case['value and gradient']['median_s']:8.3f} s"
        line += f"   ratio {case['gradient over run']:.2f}"
    return line


if __name__ == "__main__":
    main()
