"""Times and errors of heat: the five-layer case, a direct solve beside it, and a sonication with feedback, as JSON.

python -m benchmarks.thermal --out results/benchmarks/thermal.json
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import functools
import json
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import arfjax as ax
from arfjax import tissues
from arfjax.grid import AxisymmetricGrid
from arfjax.numerics.sparse_direct import Pattern, factorise, solve
from arfjax.protocols.sonication import Sonication, sonicate
from arfjax.thermal.bioheat import Phase, on_axis, solve_bioheat
from arfjax.thermal.conduction import Conductances, Walls, cell_conductances, cell_geometry
from arfjax.thermal.damage import ThermalDose, accumulated_damage
from arfjax.thermal.feedback import FROZEN
from arfjax.thermal.splitting import GAMMA
from inverse.datasets.shipped import shipped
from tests.thermal import five_layers

EXPERIMENT = shipped("suomi2016_experiment")
BODY = five_layers.BODY_TEMPERATURE
FIELD_TOLERANCE = 4.6
"""Change of temperature [K] after which the field is computed again, such that 60 s of heating take 8 updates."""

POWER = 15.0
"""Acoustic power [W]: the focus comes to 68 degC; with more, its attenuation runs away and it boils."""


def timed(function: Callable, *arguments, repeats: int = 5) -> dict[str, float]:
    """Seconds of the first call (compilation included), and median and minimum of the next ones."""
    return timed_in_turn([function], *arguments, repeats=repeats)[0]


def timed_in_turn(functions: list[Callable], *arguments, repeats: int) -> list[dict[str, float]]:
    """As `timed` for each of several functions, taken in turn so that other load meets all of them alike."""
    firsts = [_seconds(function, *arguments) for function in functions]
    rounds = [[_seconds(function, *arguments) for function in functions] for _ in range(repeats)]
    return [
        {
            "first_s": round(first, 4),
            "median_s": round(statistics.median(runs), 5),
            "min_s": round(min(runs), 5),
            "repeats": repeats,
        }
        for first, runs in zip(firsts, zip(*rounds, strict=True), strict=True)
    ]


def _seconds(function: Callable, *arguments) -> float:
    start = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    return time.perf_counter() - start


def with_gradient(run: Callable, scalar: Callable, *arguments, repeats: int = 5) -> dict[str, dict | float]:
    """Times of a run and of the value and gradient of a number of it, and their ratio (of the minima)."""
    functions = [jax.jit(run), jax.jit(jax.value_and_grad(scalar))]
    forward, gradient = timed_in_turn(functions, *arguments, repeats=repeats)
    return {
        "forward": forward,
        "gradient": gradient,
        "gradient_over_forward": round(gradient["min_s"] / forward["min_s"], 2),
    }


def five_layer_history(numbers, grid: AxisymmetricGrid, phases: tuple[Phase, ...]):
    """Temperatures and dose of 1 s of heating and 4 s of cooling; `numbers` are thermal constants and heat."""
    field, heat = numbers
    history = solve_bioheat(field, heat, grid, phases=phases, initial_temperature=BODY, arterial_temperature=BODY)
    return history, accumulated_damage(ThermalDose(), history.temperature, history.time)


def five_layer_numbers(grid: AxisymmetricGrid):
    """Thermal constants and heat of the five-layer case, what derivatives are taken to."""
    return jax.tree.map(jnp.asarray, (five_layers.tissue(grid), five_layers.heat("T1", grid)))


def five_layer_case(grid: AxisymmetricGrid, phases: tuple[Phase, ...], repeats: int = 25) -> dict:
    """Forward and gradient of the logarithm of the largest dose to the heat and every thermal constant."""

    def log_dose(numbers):
        return jnp.log(jnp.max(five_layer_history(numbers, grid, phases)[1][-1]))

    return with_gradient(
        lambda numbers: five_layer_history(numbers, grid, phases),
        log_dose,
        five_layer_numbers(grid),
        repeats=repeats,
    )


def direct_solve(numbers, grid: AxisymmetricGrid, phases: tuple[Phase, ...]) -> jax.Array:
    """Rises of the five-layer case by Alexander's L-stable two-stage method of order two, solved without splitting."""
    field, heat = numbers
    geometry = cell_geometry(grid)
    conductances, _ = cell_conductances(field, geometry, Walls())
    capacity, pattern = field.heat_capacity * geometry.volumes, _pattern(grid)
    rises = [jnp.zeros_like(capacity)[None]]
    for phase in phases:
        weight, length = GAMMA * phase.time_step, phase.time_step
        factor = factorise(pattern, _matrix(pattern, capacity, conductances, weight))
        power = phase.power * heat * geometry.volumes

        def rate(rise, power=power, factor=factor):
            return solve(factor, (power - conductances.leaving(rise)).ravel()).reshape(rise.shape)

        def step(rise, _, rate=rate, length=length):
            first = rate(rise)
            second = rate(rise + (1.0 - GAMMA) * length * first)
            rise = rise + length * ((1.0 - GAMMA) * first + GAMMA * second)
            return rise, rise

        rises.append(jax.lax.scan(step, rises[-1][-1], None, length=phase.n_steps)[1])
    return jnp.concatenate(rises)


def _pattern(grid: AxisymmetricGrid) -> Pattern:
    """Each pair of neighbours along r, along z, and each cell with itself."""
    cells = np.arange(grid.shape[0] * grid.shape[1]).reshape(grid.shape)
    pairs = [(cells[:-1], cells[1:]), (cells[:, :-1], cells[:, 1:]), (cells, cells)]
    return Pattern.of_elements(np.concatenate([np.stack(each, -1).reshape(-1, 2) for each in pairs]), cells.size)


def _matrix(pattern: Pattern, capacity: jax.Array, conductances: Conductances, weight: float) -> jax.Array:
    """Heat capacity plus `weight` times conduction."""
    between = jnp.array([[1.0, -1.0], [-1.0, 1.0]])
    flows = [g.ravel()[:, None, None] * weight * between[None] for g in (conductances.radial, conductances.axial)]
    own = (capacity + weight * conductances.loss).at[-1].add(weight * conductances.outer)
    alone = own.ravel()[:, None, None] * jnp.array([[1.0, 0.0], [0.0, 0.0]])[None]
    return pattern.assemble(jnp.concatenate([*flows, alone]))


def split_against_direct(grid: AxisymmetricGrid) -> list[dict]:
    """Error of the rise [K] in any cell at 1 s and 5 s, and time, of both methods in several numbers of steps."""
    numbers = five_layer_numbers(grid)

    def phases(n: int) -> tuple[Phase, ...]:
        return Phase(1.0, 2 * n), Phase(0.5, n, 0.0), Phase(3.5, 2 * n, 0.0)

    def split(numbers, n: int):
        return five_layer_history(numbers, grid, phases(n))[0].temperature - BODY

    def direct(numbers, n: int):
        return direct_solve(numbers, grid, phases(n))

    def ends(rises, n: int):
        return rises[jnp.asarray([2 * n, 3 * n, 5 * n])]

    exact = ends(jax.jit(functools.partial(split, n=320))(numbers), 320)
    rows = []
    for name, method in {"split along r and z": split, "direct solve": direct}.items():
        for n in (3, 5, 10, 20):
            run = jax.jit(functools.partial(method, n=n))
            error = jnp.abs(ends(run(numbers), n) - exact)
            rows.append(
                {
                    "method": name,
                    "steps": 5 * n,
                    "error_of_peak_k": float(jnp.max(error[0, 0])),
                    "largest_error_k": float(jnp.max(error)),
                    **timed(run, numbers, repeats=5),
                }
            )
    return rows


def sonication_case(tolerance: float, power: float = POWER, repeats: int = 3) -> dict:
    """60 s of heating of the paper's liver, whose constants follow temperature and dose, and its gradient."""
    described = ax.read_experiment(EXPERIMENT)
    model = described.model()
    liver = tissues.warming(tissues.coagulating(model.liver))
    model = eqx.tree_at(lambda m: (m.liver, m.drive.acoustic_power), model, (liver, power))
    settings = ax.discretise(model)
    numbers = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), model)
    sonication = Sonication((Phase(60.0, settings.n_heat_steps),), field_tolerance=tolerance)

    def run(numbers):
        return sonicate(numbers, sonication, settings)

    result = jax.jit(run)(numbers)
    times = with_gradient(run, lambda numbers: run(numbers).focal_temperature[-1], numbers, repeats=repeats)
    return {
        "field_tolerance_k": tolerance if np.isfinite(tolerance) else None,
        "field_updates": int(result.field_updates[-1]),
        "steps": settings.n_heat_steps,
        "cells": list(settings.heat_grid.shape),
        "focal_temperature_c": round(float(result.focal_temperature[-1]), 3),
        "hottest_c": round(float(jnp.max(result.temperature)), 3),
        "derivatives_to": len(jax.tree.leaves(numbers)),
        **times,
    }


def growth() -> dict:
    """Minimal times over cells and over steps, and the exponents with which they grow."""
    phases = five_layers.phases()
    by_cells, by_steps = [], []
    for refinement in (1.0, 2.0**0.5, 2.0):
        grid = five_layers.grid(refinement)
        times = five_layer_case(grid, phases, repeats=5)
        by_cells.append((grid.shape[0] * grid.shape[1], times["forward"]["min_s"], times["gradient"]["min_s"]))
    grid = five_layers.grid()
    for factor in (1, 2, 4):
        times = five_layer_case(grid, five_layers.phases(factor), repeats=5)
        by_steps.append((44 * factor, times["forward"]["min_s"], times["gradient"]["min_s"]))
    return {"cells": _growth(by_cells), "steps": _growth(by_steps)}


def _growth(rows: list[tuple[int, float, float]]) -> dict:
    sizes, forward, gradient = (np.asarray(column, dtype=float) for column in zip(*rows, strict=True))
    return {
        "sizes": [int(size) for size in sizes],
        "forward_s": list(forward),
        "gradient_s": list(gradient),
        "forward_exponent": round(float(np.polyfit(np.log(sizes), np.log(forward), 1)[0]), 2),
        "gradient_exponent": round(float(np.polyfit(np.log(sizes), np.log(gradient), 1)[0]), 2),
    }


def accuracy(grid: AxisymmetricGrid) -> dict[str, float]:
    """Peak rise and doses, and the rise on a twice finer grid."""
    phases, numbers = five_layers.phases(), five_layer_numbers(grid)
    history, dose = five_layer_history(numbers, grid, phases)
    finer = five_layers.grid(2.0)
    fine, _ = five_layer_history(five_layer_numbers(finer), finer, phases)
    half = accumulated_damage(ThermalDose(doublings_per_kelvin_below=1.0), history.temperature, history.time)
    return {
        "peak_rise_k": round(float(jnp.max(on_axis(history.temperature, grid))) - BODY, 4),
        "peak_rise_twice_finer_k": round(float(jnp.max(on_axis(fine.temperature, finer))) - BODY, 4),
        "dose_min": round(float(jnp.max(on_axis(dose, grid)[-1])), 2),
        "dose_with_half_throughout_min": round(float(jnp.max(on_axis(half, grid)[-1])), 2),
    }


def report(name: str, case: dict) -> None:
    """One line."""
    forward, gradient = case["forward"], case["gradient"]
    print(
        f"{name:45s} forward {forward['median_s']:.4f} s (min {forward['min_s']:.4f}), gradient "
        f"{gradient['median_s']:.4f} s (min {gradient['min_s']:.4f}), {case['gradient_over_forward']:.1f} times"
    )


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    jax.config.update("jax_enable_x64", True)
    grid = five_layers.grid()
    result = {
        "benchmark": "thermal",
        "device": str(jax.devices()[0]),
        "machine": platform.machine(),
        "cpu_count": os.cpu_count(),
        "load_before": os.getloadavg()[0],
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
        "five layers": {
            "cells": list(grid.shape),
            "steps": sum(phase.n_steps for phase in five_layers.phases()),
            **accuracy(grid),
            **five_layer_case(grid, five_layers.phases()),
        },
    }
    report("five layers, 1 s heating, 4 s cooling, dose", result["five layers"])
    result["split and direct"] = split_against_direct(grid)
    for row in result["split and direct"]:
        print(
            f"{row['method']:22s} {row['steps']:4d} steps: error of the peak {row['error_of_peak_k']:.1e} K, anywhere "
            f"{row['largest_error_k']:.1e} K, {row['median_s']:.4f} s (min {row['min_s']:.4f})"
        )
    for name, tolerance in {"field follows": FIELD_TOLERANCE, "field frozen": FROZEN}.items():
        case = sonication_case(tolerance)
        result[f"sonication of 60 s, {name}"] = case
        report(f"sonication of 60 s, {name}, {case['field_updates']} updates", case)
    result["growth"] = growth()
    for name, case in result["growth"].items():
        print(f"exponents over {name}: forward {case['forward_exponent']}, gradient {case['gradient_exponent']}")
    result["load_after"] = os.getloadavg()[0]
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
