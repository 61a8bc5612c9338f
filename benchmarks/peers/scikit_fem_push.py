"""A push in 100 steps with scikit-fem and scipy (not part of this project), run by `benchmarks.mechanics` on its own.

python -m benchmarks.peers.scikit_fem_push

Needs `pip install scikit-fem`. Biquadratic elements on the half plane (r, z), change of volume integrated at 2 x 2
points so that nothing locks, Newmark's method, one SuperLU factorisation for all steps: what a careful user writes.
There are no gradients.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import time

import numpy as np
import scipy.sparse.linalg
import skfem
from skfem.helpers import dot, grad

CELLS = (90, 180)
SIZE = (0.02, 0.04)
"""Of the domain [m]."""

SHEAR_MODULUS, BULK_MODULUS, DENSITY = 2e3, 5e5, 1060.0
TIME_STEP, N_STEPS = 5e-6, 100


def _strains(u, w) -> tuple:
    """Strains rr, zz, tt and the engineering shear."""
    slopes = grad(u)
    return slopes[0, 0], slopes[1, 1], u[0] / w.x[0], slopes[0, 1] + slopes[1, 0]


@skfem.BilinearForm
def shape_stiffness(u, v, w):
    """Against change of shape."""
    ours, theirs = _strains(u, w), _strains(v, w)
    third = (ours[0] + ours[1] + ours[2]) / 3.0
    normal = sum(2.0 * (a - third) * b for a, b in zip(ours[:3], theirs[:3], strict=True))
    return 2.0 * np.pi * w.x[0] * SHEAR_MODULUS * (normal + ours[3] * theirs[3])


@skfem.BilinearForm
def volume_stiffness(u, v, w):
    """Against change of volume."""
    return 2.0 * np.pi * w.x[0] * BULK_MODULUS * sum(_strains(u, w)[:3]) * sum(_strains(v, w)[:3])


@skfem.BilinearForm
def mass(u, v, w):
    """Of the solid."""
    return 2.0 * np.pi * w.x[0] * DENSITY * dot(u, v)


@skfem.LinearForm
def load(v, w):
    """Of the push."""
    force = 1e5 * np.exp(-((w.x[0] / 6e-4) ** 2) - ((w.x[1] - 0.5 * SIZE[1]) / 4e-3) ** 2)
    return 2.0 * np.pi * w.x[0] * force * v[1]


def main() -> None:
    """Seconds of one push, as JSON on the last line."""
    edges = [np.linspace(0.0, size, n + 1) for size, n in zip(SIZE, CELLS, strict=True)]
    mesh = skfem.MeshQuad.init_tensor(*edges)
    start = time.perf_counter()
    element = skfem.ElementVector(skfem.ElementQuad2())
    basis = skfem.Basis(mesh, element, intorder=5)
    reduced = skfem.Basis(mesh, element, intorder=3)
    stiffness = shape_stiffness.assemble(basis) + volume_stiffness.assemble(reduced)
    inertia, force = mass.assemble(basis), load.assemble(basis)
    walls = basis.get_dofs(lambda x: (x[0] > SIZE[0] - 1e-9) | (x[1] < 1e-9) | (x[1] > SIZE[1] - 1e-9)).all()
    axis = basis.get_dofs(lambda x: x[0] < 1e-9).all(["u^1"])
    free = np.setdiff1d(np.arange(basis.N), np.concatenate([walls, axis]))
    stiffness, inertia, force = stiffness[free][:, free], inertia[free][:, free], force[free]
    assembled = time.perf_counter()
    gain = 0.25 * TIME_STEP**2
    solve = scipy.sparse.linalg.splu((inertia + gain * stiffness).tocsc(), permc_spec="MMD_AT_PLUS_A").solve
    acceleration = scipy.sparse.linalg.splu(inertia.tocsc(), permc_spec="MMD_AT_PLUS_A").solve(force)
    factored = time.perf_counter()
    displacement, velocity = np.zeros_like(force), np.zeros_like(force)
    for _ in range(N_STEPS):
        predicted = displacement + TIME_STEP * velocity + gain * acceleration
        new = solve(force - stiffness @ predicted)
        displacement = predicted + gain * new
        velocity = velocity + 0.5 * TIME_STEP * (acceleration + new)
        acceleration = new
    end = time.perf_counter()
    parts = {"assembly": assembled - start, "factorisation": factored - assembled, "steps": end - factored}
    print(json.dumps({"unknowns": int(basis.N), "steps": N_STEPS, "seconds": {"all": end - start, **parts}}))


if __name__ == "__main__":
    main()
