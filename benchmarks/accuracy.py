"""Errors of every solver against exact solutions, and of the chain against a finer one, as JSON and a table.

python -m benchmarks.accuracy --out results/benchmarks/accuracy.json
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import arfjax as ax
from arfjax.exact.bioheat import gaussian_source_rise
from arfjax.exact.oneil import axial_pressure
from arfjax.grid import graded_positions
from arfjax.thermal.bioheat import uniform_field
from inverse.datasets.shipped import shipped
from tests.mechanics.problems import Reference, reference_mesh


def acoustics() -> dict[str, float]:
    """Linear water, the paper's bowl, against O'Neil's formula from 55 to 70 mm on the axis."""
    bowl, drive = ax.FocusedBowl(32e-3, 10e-3, 62.6e-3), ax.Drive(1.1e6, 50.0)
    water = ax.AcousticMedium(1000.0, 1482.0, 0.0, 2.0, 5.0)
    z = np.arange(55e-3, 70e-3, 0.05e-3)
    field = ax.solve_field(bowl, drive, [ax.AcousticLayer(water, 0.1)], r=np.array([0.0]), z=z)
    exact = axial_pressure(
        bowl,
        z,
        wavenumber=2.0 * np.pi * 1.1e6 / 1482.0,
        source_pressure=float(drive.source_pressure(bowl, 1000.0 * 1482.0)),
    )
    pressure = np.asarray(field.pressure[0, 0])
    return {
        "sound field on the axis: peak, against O'Neil": abs(np.abs(pressure).max() / np.abs(exact).max() - 1.0),
        "sound field on the axis: L2 over 55 to 70 mm": float(np.linalg.norm(pressure - exact) / np.linalg.norm(exact)),
    }


def heat() -> dict[str, float]:
    """A Gaussian source heated for 10 s in perfused tissue, against the integral over time in closed form."""
    medium = ax.ThermalMedium(0.51, 3.8e6, 1e5)
    grid = ax.AxisymmetricGrid(
        graded_positions(0.0, 3e-2, 0.0, finest=6e-5, growth=1.06, coarsest=3e-3),
        graded_positions(-3.5e-2, 3.5e-2, 0.0, finest=3e-4, growth=1.08, coarsest=3e-3),
    )
    r, z = grid.r[:, None], grid.z[None, :]
    source = 2e7 * np.exp(-((r / 1e-3) ** 2) - (z / 5e-3) ** 2)
    history = ax.solve_bioheat(
        uniform_field(medium, grid),
        source,
        grid,
        initial_temperature=37.0,
        arterial_temperature=37.0,
        phases=[ax.Phase(10.0, 100)],
    )
    exact = gaussian_source_rise(r, z, 10.0, medium, heat=2e7, radius=1e-3, half_length=5e-3, heating_duration=10.0)
    error = np.abs(np.asarray(history.temperature[-1]) - 37.0 - exact).max() / exact.max()
    return {"temperature rise after 10 s, largest error over peak": float(error)}


def mechanics() -> dict[str, float]:
    """A Gaussian push of an infinite medium, against the semi-analytic solution, up to 1 ms."""
    mesh = reference_mesh(0.15e-3, 0.8e-3)
    labels = {"elastic": "elastic", "zener": "Zener", "fzener": "fractional Zener"}
    errors = {}
    for kind, label in labels.items():
        reference = Reference(kind)
        result = reference.solve(mesh, time_step=2.5e-5, end=1e-3)
        errors[f"displacement, {label}, largest error over peak"] = reference.error(result)
    return errors


def sonication() -> dict[str, float]:
    """The shipped sonication with feedback: against finer updates, steps and grid, and against no updates."""
    described = ax.read_experiment(shipped("suomi2016_experiment"))
    model, plan = described.sonicated(), described.sonication.plan()

    def heated(tolerance: float, finer: int = 1, refinement: float = 1.0) -> np.ndarray:
        settings = ax.discretise(model, refinement=refinement)
        phases = (ax.Phase(plan.phases[0].duration, finer * plan.phases[0].n_steps),)
        fine = ax.Sonication(phases, plan.start_temperature, tolerance)
        result = eqx.filter_jit(lambda model: ax.sonicate(model, fine, settings))(model)
        last = np.asarray(result.temperature[-1]) - plan.start_temperature
        return np.asarray([result.focal_temperature[-1] - plan.start_temperature, last.max()])

    usual, fine = heated(plan.field_tolerance), heated(plan.field_tolerance / 8.0, 8)
    finer_grid, frozen = heated(plan.field_tolerance, 1, 2.0), heated(np.inf)
    return {
        "rise of a 60 s sonication, against 8 x finer steps and updates": float(np.abs(usual / fine - 1.0).max()),
        "rise of a 60 s sonication, against a twice finer grid": float(np.abs(usual / finer_grid - 1.0).max()),
        "the same with the field of the start throughout": float(np.abs(frozen / fine - 1.0).max()),
    }


def chain() -> dict[str, float]:
    """Displacement of the paper's protocol with default and with three times finer spacings and steps."""
    described = ax.read_experiment(shipped("suomi2016_experiment"))
    model, protocol = described.model(), described.stepwise()
    temperatures = jnp.asarray(described.protocol.temperatures_c)
    curves = []
    for refinement in (1.0, 3.0):
        settings = ax.discretise(model, refinement=refinement)
        run = eqx.filter_jit(lambda model, settings=settings: ax.run_stepwise(model, temperatures, protocol, settings))
        curves.append(np.asarray(run(model).displacement))
    default, fine = curves
    return {
        "focal displacement of the protocol, against 3 x finer": float(np.abs(default / fine - 1.0).max()),
        "normalised displacement, against 3 x finer": float(np.abs(default / default[0] - fine / fine[0]).max()),
    }


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    jax.config.update("jax_enable_x64", True)
    errors = acoustics() | heat() | sonication() | mechanics() | chain()
    out.parent.mkdir(parents=True, exist_ok=True)
    result = {"benchmark": "accuracy", "versions": {"arfjax": ax.__version__, "jax": jax.__version__}, "errors": errors}
    out.write_text(json.dumps(result, indent=2) + "\n")
    for name, error in errors.items():
        print(f"{name:60s} {error:.1e}")


if __name__ == "__main__":
    main()
