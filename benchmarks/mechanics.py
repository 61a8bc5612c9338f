"""Times, memory and errors of the moving tissue, beside two other codes, as JSON.

python -m benchmarks.mechanics --out results/benchmarks/mechanics.json [--peers PYTHON] [--quick]

Every run gets moduli that no run had before, so that factors are computed in each. Errors are the largest over the
peak, against the stored solutions of `tests/reference/mechanics`. PYTHON is an interpreter that has jax-fem and
scikit-fem (see `benchmarks/peers`); without it their rows are left out.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import itertools
import json
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import arfjax as ax
from arfjax.grid import AxisymmetricGrid, graded_positions
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.elements.refinement import focused_mesh
from arfjax.mechanics.explicit.grid import node_positions, refined
from arfjax.mechanics.explicit.result import extrapolated
from arfjax.mechanics.explicit.settings import explicit_settings
from arfjax.mechanics.explicit.solver import solve_push_explicitly
from arfjax.mechanics.harmonic.motion import solve_harmonic
from arfjax.mechanics.material.harmonic import solid_field
from arfjax.mechanics.material.viscoelastic import (
    ShearModulus,
    ViscoelasticField,
    prony_of_fractional_zener,
    prony_of_zener,
    viscoelastic_field,
)
from arfjax.mechanics.transient.push import PushSettings, solve_push
from arfjax.media import FractionalZener, Prony, Zener

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "tests" / "reference" / "mechanics"
TARGETS = {
    "push of 0.5 ms to 1e-3 [s]": 1.0,
    "129k unknowns, 100 steps [s]": 5.0,
    "its gradient, times the run": 2.5,
    "its gradient, memory [GB]": 2.0,
    "explicit push to 1 % [s]": 0.05,
    "50 Hz [s]": 2.0,
    "value and gradient, times faster than jax-fem": 20.0,
}
_FRESH = itertools.count(1)


def fresh() -> jax.Array:
    """A factor of moduli that no run had before, and that changes nothing."""
    return jnp.asarray(1.0 + 1e-12 * next(_FRESH))


def timed_in_turn(functions: dict[str, Callable], repeats: int) -> dict[str, dict[str, float]]:
    """Seconds of the first call (compilation included), median and minimum of the next; taken in turn."""
    firsts = {name: _seconds(function) for name, function in functions.items()}
    rounds = [{name: _seconds(function) for name, function in functions.items()} for _ in range(repeats)]
    return {
        name: {
            "first_s": round(first, 3),
            "median_s": round(statistics.median(each[name] for each in rounds), 4),
            "min_s": round(min(each[name] for each in rounds), 4),
            "repeats": repeats,
        }
        for name, first in firsts.items()
    }


def _seconds(function: Callable) -> float:
    start = time.perf_counter()
    jax.block_until_ready(function(fresh()))
    return time.perf_counter() - start


class Medium:
    """The infinite medium of a stored solution."""

    def __init__(self, kind: str):
        """Read it."""
        stored = dict(np.load(REFERENCE / f"gauss_{kind}_K500k.npz"))
        self.times, self.points, self.displacement = stored["t"], stored["pts"], stored["uz"]
        self.constants = {name: float(value) for name, value in stored.items() if value.ndim == 0}
        self.kind = kind

    def material(self, mesh: Mesh, scale: jax.Array) -> ViscoelasticField:
        """At the Gauss points, its moduli times `scale`."""
        return self.material_of((len(mesh.gauss_r), len(mesh.gauss_z)), scale)

    def material_of(self, shape: tuple[int, int], scale: jax.Array) -> ViscoelasticField:
        """As a field of that shape."""
        c = self.constants
        relaxed, unrelaxed = scale * c["G0"], scale * (c["G0"] + c["dG"])
        if self.kind == "elastic":
            prony = Prony(relaxed, jnp.zeros(0), jnp.zeros(0))
        elif self.kind == "zener":
            prony = prony_of_zener(Zener(relaxed, unrelaxed, c["tau"]))
        else:
            prony = prony_of_fractional_zener(FractionalZener(relaxed, unrelaxed, c["tau"], c["beta"]))
        return viscoelastic_field(
            prony, shape, density=c["rho"], bulk_modulus=c["K"], reading=ShearModulus(), poisson_ratio=0.5
        )

    def force(self, mesh: Mesh) -> np.ndarray:
        """At the Gauss points."""
        c = self.constants
        return c["F0"] * np.exp(-((mesh.gauss_r[:, None] / c["a"]) ** 2) - (mesh.gauss_z[None, :] / c["b"]) ** 2)


def mesh_of(finest_r: float, finest_z: float, size: float) -> Mesh:
    """Finest at the focus, in a box of that radius and half length [m]."""
    return focused_mesh(
        focus=0.0, radius=size, front=-size, back=size, finest_r=finest_r, finest_z=finest_z, coarsest=3e-3
    )


def push_of_half_a_millisecond(repeats: int, finest: tuple[float, float] = (0.15e-3, 0.6e-3)) -> dict:
    """One push, watched to its end at 0.5 ms, walls further than its pressure wave gets and returns."""
    found = {}
    for kind in ("elastic", "zener", "fzener"):
        medium, mesh = Medium(kind), mesh_of(*finest, 14e-3)
        until = np.flatnonzero(medium.times <= 0.5e-3 * (1.0 + 1e-9))
        settings = PushSettings(2e-5, 25, medium.constants["push"])

        def displacement(scale, medium=medium, mesh=mesh, settings=settings):
            return solve_push(
                mesh, medium.material(mesh, scale), medium.force(mesh), settings=settings, points=medium.points
            ).displacement_at_points[..., 1]

        run = jax.jit(displacement)
        gradient = jax.jit(jax.value_and_grad(lambda scale, run=run: run(scale)[-1, 0]))
        steps = np.rint(medium.times[until] / settings.time_step).astype(int)
        error = np.asarray(run(fresh()))[steps] - medium.displacement[until]
        found[kind] = {
            "unknowns": mesh.n_unknowns,
            "steps": settings.n_steps,
            "error": float(np.max(np.abs(error)) / np.max(np.abs(medium.displacement[until]))),
            **timed_in_turn({"run": run, "value and gradient": gradient}, repeats),
        }
    return found


def large_case(cells: tuple[int, int], n_steps: int) -> tuple[Callable, Callable, int]:
    """A push on an even mesh: its run, its value and gradient to the shear modulus of every point, its unknowns."""
    medium = Medium("zener")
    mesh = Mesh(np.linspace(0.0, 20e-3, cells[0] + 1), np.linspace(-20e-3, 20e-3, cells[1] + 1))
    settings, force = PushSettings(5e-6, n_steps, 0.5e-3), medium.force(mesh)

    def displacement(scales):
        return solve_push(mesh, medium.material(mesh, scales), force, settings=settings).at_focus(0.0)[-1]

    both = jax.jit(jax.value_and_grad(displacement))
    run, field = jax.jit(displacement), jnp.ones((len(mesh.gauss_r), len(mesh.gauss_z)))
    return lambda scale: run(scale * field), lambda scale: both(scale * field), mesh.n_unknowns


def large(repeats: int, cells: tuple[int, int] = (90, 180), n_steps: int = 100) -> dict:
    """129 000 unknowns, 100 steps."""
    run, both, n_unknowns = large_case(cells, n_steps)
    times = timed_in_turn({"run": run, "value and gradient": both}, repeats)
    ratio = times["value and gradient"]["min_s"] / times["run"]["min_s"]
    command = [sys.executable, "-m", "benchmarks.mechanics", "--memory-of", *map(str, (*cells, n_steps))]
    return {
        "unknowns": n_unknowns,
        "steps": n_steps,
        "derivatives_to": "the shear modulus at every Gauss point",
        **times,
        "gradient_over_run": round(ratio, 2),
        **_of_own_process(command),
    }


def memory_of(cells: tuple[int, int], n_steps: int) -> dict:
    """Largest resident memory of this process over one gradient, and before it."""
    _, both, _ = large_case(cells, n_steps)
    before = _largest_memory()
    jax.block_until_ready(both(fresh()))
    return {"memory_gb": _largest_memory(), "memory_before_gb": before}


def _largest_memory() -> float | None:
    # Not `getrusage`, which counts what the parent had when it started this process.
    status = Path("/proc/self/status")
    if not status.exists():
        return None
    line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
    return round(int(line.split()[1]) / 2**20, 2)


def growth(repeats: int, sizes: tuple[int, ...] = (30, 60, 90)) -> dict:
    """Minimal times over unknowns at 20 steps, and the exponents with which they grow."""
    rows = []
    for n in sizes:
        run, both, n_unknowns = large_case((n, 2 * n), 20)
        times = timed_in_turn({"run": run, "gradient": both}, repeats)
        rows.append((n_unknowns, times["run"]["min_s"], times["gradient"]["min_s"]))
    unknowns, forward, gradient = np.asarray(rows, float).T
    return {
        "unknowns": unknowns.astype(int).tolist(),
        "run_s": forward.tolist(),
        "gradient_s": gradient.tolist(),
        "run_exponent": round(float(np.polyfit(np.log(unknowns), np.log(forward), 1)[0]), 2),
        "gradient_exponent": round(float(np.polyfit(np.log(unknowns), np.log(gradient), 1)[0]), 2),
    }


def steady(repeats: int) -> dict:
    """50 Hz in an infinite fractional solid."""
    stored = dict(np.load(REFERENCE / "hmi50_fzener.npz"))
    c = {name: float(value) for name, value in stored.items() if value.ndim == 0}
    mesh = focused_mesh(
        focus=0.0, radius=11e-3, front=-12e-3, back=12e-3, finest_r=0.15e-3, finest_z=0.6e-3, coarsest=1.5e-3
    )
    force = c["F0"] * np.exp(-((mesh.gauss_r[:, None] / c["a"]) ** 2) - (mesh.gauss_z[None, :] / c["b"]) ** 2)

    def amplitudes(scale):
        solid = FractionalZener(scale * c["G0"], scale * (c["G0"] + c["dG"]), c["tau"], c["beta"])
        material = solid_field(
            solid,
            (len(mesh.gauss_r), len(mesh.gauss_z)),
            density=c["rho"],
            bulk_modulus=c["K"],
            reading=ShearModulus(),
            poisson_ratio=0.5,
        )
        result = solve_harmonic(mesh, material, force, frequency=c["freq"])
        return result.at_points(stored["pts"])[:, 1]

    run = jax.jit(amplitudes)
    gradient = jax.jit(jax.value_and_grad(lambda scale: jnp.abs(run(scale)[0])))
    error = np.max(np.abs(np.asarray(run(fresh())) - stored["uz"])) / np.max(np.abs(stored["uz"]))
    return {
        "unknowns_without_layer": mesh.n_unknowns,
        "error": float(error),
        **timed_in_turn({"run": run, "value and gradient": gradient}, repeats),
    }


def explicit(repeats: int, finest: tuple[float, float] = (0.15e-3, 0.4e-3)) -> dict:
    """One push by the fast path, its error and what it estimates, alone and for 64 materials at once."""
    found = {}
    for kind in ("elastic", "zener"):
        medium, grid = Medium(kind), refined(refined(_graded_cells(*finest)))
        r, z = node_positions(grid)
        c = medium.constants
        force = jnp.asarray(c["F0"] * np.exp(-((r / c["a"]) ** 2) - (z / c["b"]) ** 2))
        settings = explicit_settings(
            grid, medium.material_of(grid.shape, jnp.asarray(1.0)), end=0.5e-3, push_duration=c["push"]
        )

        def push(scale, medium=medium, grid=grid, force=force, settings=settings):
            return solve_push_explicitly(
                grid, medium.material_of(grid.shape, scale), force, settings=settings, points=medium.points
            )

        def displacement(scale, push=push):
            result = push(scale)
            return [each.displacement_at_points[-1, :, 1] for each in (result, extrapolated(result))]

        run = jax.jit(displacement)
        batch = jax.jit(lambda scale, push=push: jax.vmap(lambda s: push(s).at_focus(0.0)[-1])(scale * _SIXTY_FOUR))
        exact = medium.displacement[np.argmin(np.abs(medium.times - 0.5e-3))]
        errors = [float(np.max(np.abs(each - exact)) / np.max(np.abs(exact))) for each in run(jnp.asarray(1.0))]
        found[kind] = {
            "cells": list(grid.shape),
            "steps": settings.n_steps,
            "error": errors[0],
            "error_extrapolated": errors[1],
            **timed_in_turn({"run": run, "64 at once": batch}, repeats),
        }
    return found


_SIXTY_FOUR = jnp.linspace(0.5, 1.0, 64)


def _graded_cells(finest_r: float, finest_z: float) -> AxisymmetricGrid:
    r = graded_positions(0.0, 12e-3, 0.0, finest=4.0 * finest_r, growth=1.3, coarsest=3e-3)
    z = graded_positions(-14e-3, 14e-3, 0.0, finest=4.0 * finest_z, growth=1.3, coarsest=4e-3)
    return AxisymmetricGrid(r, z)


def peers(python: str, ours: dict) -> dict:
    """The same number of unknowns in other codes, and by how much they are slower."""
    jax_fem = _of_own_process([python, "-m", "benchmarks.peers.jax_fem_step"])
    scikit_fem = _of_own_process([python, "-m", "benchmarks.peers.scikit_fem_push"])
    steps, both = ours["steps"], ours["value and gradient"]["median_s"]
    whole = {name: steps * seconds for name, seconds in jax_fem["seconds_a_step"].items()}
    return {
        "jax-fem": {
            **jax_fem,
            "extrapolated_to_all_steps_s": whole,
            "value_and_gradient_over_ours": round(whole["value and gradient"] / both, 1),
        },
        "scikit-fem and scipy": {
            **scikit_fem,
            "value_over_ours": round(scikit_fem["seconds"]["all"] / ours["run"]["median_s"], 1),
        },
    }


def _of_own_process(command: list[str]) -> dict:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"benchmarks.mechanics: {' '.join(command)} failed:\n{done.stderr[-2000:]}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--peers", metavar="PYTHON")
    parser.add_argument("--quick", action="store_true", help="small cases, to see that it runs")
    parser.add_argument("--memory-of", nargs=3, type=int, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if asked.memory_of is not None:
        print(json.dumps(memory_of((asked.memory_of[0], asked.memory_of[1]), asked.memory_of[2])))
        return
    if asked.out is None:
        parser.error("--out is needed")
    repeats = 1 if asked.quick else 5
    found: dict = {
        "machine": {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count()},
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
        "targets": TARGETS,
        "push of 0.5 ms": push_of_half_a_millisecond(repeats, (0.6e-3, 3e-3) if asked.quick else (0.15e-3, 0.6e-3)),
        "explicit push of 0.5 ms": explicit(repeats),
        "50 Hz": steady(repeats),
        "large": large(repeats, (8, 16), 5) if asked.quick else large(3),
        "growth at 20 steps": growth(repeats, (6, 12)) if asked.quick else growth(2),
    }
    if asked.peers is not None:
        found["other codes"] = peers(asked.peers, found["large"])
    asked.out.parent.mkdir(parents=True, exist_ok=True)
    asked.out.write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
