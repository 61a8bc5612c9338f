"""Small problems that the tests of mechanics share."""

import functools
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from arfjax.grid import graded_positions
from arfjax.mechanics.elements.mesh import Mesh, Walls
from arfjax.mechanics.material.viscoelastic import (
    Prony,
    ShearModulus,
    ViscoelasticField,
    prony_of_fractional_zener,
    prony_of_zener,
    viscoelastic_field,
)
from arfjax.mechanics.transient.push import PushResult, PushSettings, solve_push
from arfjax.media import FractionalZener, Zener

REFERENCES = Path(__file__).parents[1] / "reference" / "mechanics"


class Reference:
    """The stored solution of an infinite medium."""

    def __init__(self, kind: str):
        stored = np.load(REFERENCES / f"gauss_{kind}_K500k.npz")
        self.kind = kind
        self.times, self.points, self.displacement = stored["t"], stored["pts"], stored["uz"]
        self.constants = {name: float(stored[name]) for name in stored if stored[name].ndim == 0}

    def prony(self) -> Prony:
        c = self.constants
        if self.kind == "fzener":
            return prony_of_fractional_zener(FractionalZener(c["G0"], c["G0"] + c["dG"], c["tau"], c["beta"]))
        return prony_of_zener(Zener(c["G0"], c["G0"] + c["dG"], c["tau"]))

    def solve(self, mesh: Mesh, *, time_step: float, end: float) -> PushResult:
        c = self.constants
        shape = (len(mesh.gauss_r), len(mesh.gauss_z))
        material = viscoelastic_field(
            self.prony(), shape, density=c["rho"], bulk_modulus=c["K"], reading=ShearModulus(), poisson_ratio=0.5
        )
        settings = PushSettings(time_step, round(end / time_step), c["push"])
        force = gaussian_force(mesh, c["F0"], c["a"], c["b"])
        edges = (tuple(mesh.r_edges.tolist()), tuple(mesh.z_edges.tolist()))
        return _compiled(*edges, settings, tuple(map(tuple, self.points.tolist())))(material, force)

    def error(self, result: PushResult) -> float:
        """Largest difference at the stored points and times of the run, over the peak of the stored solution."""
        times = np.asarray(result.time)
        stored = self.times <= times[-1] * (1.0 + 1e-9)
        steps = np.rint(self.times[stored] / times[1]).astype(int)
        difference = np.asarray(result.displacement_at_points)[steps, :, 1] - self.displacement[stored]
        return float(np.max(np.abs(difference)) / np.max(np.abs(self.displacement)))


@functools.cache
def _compiled(r_edges: tuple, z_edges: tuple, settings: PushSettings, points: tuple) -> Callable:
    mesh = Mesh(np.array(r_edges), np.array(z_edges))
    return jax.jit(lambda m, f: solve_push(mesh, m, f, settings=settings, points=np.array(points)))


def gaussian_force(mesh: Mesh, amplitude: float, a: float, b: float, centre: float = 0.0) -> np.ndarray:
    return amplitude * np.exp(-((mesh.gauss_r[:, None] / a) ** 2) - ((mesh.gauss_z[None, :] - centre) / b) ** 2)


def reference_mesh(
    finest_r: float, finest_z: float, *, growth: float = 1.2, size: float = 0.024, coarsest: float = 3e-3
) -> Mesh:
    r = graded_positions(0.0, size, 0.0, finest=finest_r, growth=growth, coarsest=coarsest)
    z = graded_positions(-size, size, 0.0, finest=finest_z, growth=growth, coarsest=coarsest)
    return Mesh(r, z)


def small_mesh(walls: Walls | None = None) -> Mesh:
    """Uneven, so that no symmetry hides a mistake."""
    r_edges, z_edges = np.array([0.0, 0.7, 1.5, 2.7, 4.2]), np.array([-3.0, -1.8, -0.9, 0.2, 1.0, 2.2])
    return Mesh(1e-3 * r_edges, 1e-3 * z_edges, Walls() if walls is None else walls)


def small_force(mesh: Mesh) -> np.ndarray:
    """Not centred, so that no symmetry hides a mistake."""
    return gaussian_force(mesh, 1e5, 1e-3, 1.5e-3, centre=-2e-4)


def uneven_material(mesh: Mesh, *, n_branches: int = 2, bulk_modulus: float = 5e5) -> ViscoelasticField:
    """Every constant varies in space."""
    r, z = 1e3 * jnp.asarray(mesh.gauss_r)[:, None], 1e3 * jnp.asarray(mesh.gauss_z)[None, :]
    bump = 0.2 * jnp.sin(r + 0.5 * z)
    branches = jnp.arange(1.0, n_branches + 1.0)[:, None, None]
    return ViscoelasticField(
        density=1060.0 * (1.0 + 0.3 * bump),
        bulk_modulus=bulk_modulus * (1.0 - bump),
        relaxed_shear_modulus=2000.0 * (1.0 + bump),
        branch_shear_moduli=1500.0 * branches * (1.0 + 0.5 * bump)[None],
        relaxation_times=2e-4 * branches * (1.0 - bump)[None],
    )
