"""One implicit step in time with jax-fem (GPL-3, not part of this project), run by `benchmarks.mechanics` on its own.

python -m benchmarks.peers.jax_fem_step

Needs `pip install jax-fem fenics-basix gmsh meshio pyfiglet`. jax-fem keeps its sparse matrices in PETSc. Its solves
are asked of scipy here (its option `umfpack_solver`), so that PETSc would be no more than a container; `_Matrix` is
one on scipy's arrays, which spares building PETSc. The step is that of a solid with the unknowns of ours: plane
strain on bilinear squares, whose matrix is sparser than that of quadratic elements, so that it is faster to solve.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import logging
import statistics
import sys
import time
import types

import jax
import numpy as np
import scipy.sparse

CELLS = (180, 360)
SIZE = (0.02, 0.04)
"""Of the domain [m]."""

SHEAR_MODULUS, BULK_MODULUS, DENSITY = 2e3, 5e5, 1060.0
STEP_SCALE = 1.0 / (0.25 * 5e-6**2)
"""One over beta dt^2, for steps of 5 us [1/s^2]."""


class _Matrix:
    """What jax-fem asks of a PETSc matrix, for its solves by scipy."""

    def __init__(self, matrix: scipy.sparse.csr_array):
        self.matrix = matrix

    def createAIJ(self, size, csr):
        starts, columns, values = csr
        return _Matrix(scipy.sparse.csr_array((np.array(values), columns, starts), shape=size))

    def zeroRows(self, rows):
        starts, values = self.matrix.indptr, self.matrix.data
        for row in rows:
            line = slice(starts[row], starts[row + 1])
            values[line] = np.where(self.matrix.indices[line] == row, 1.0, 0.0)

    def getValuesCSR(self):
        return self.matrix.indptr, self.matrix.indices, self.matrix.data

    def transpose(self):
        return _Matrix(self.matrix.T.tocsr())


def stand_in_for_petsc() -> None:
    """Put the container in the place of PETSc."""
    petsc = types.SimpleNamespace(IntType=np.int32, Mat=lambda: _Matrix(scipy.sparse.csr_array((1, 1))))
    module = types.ModuleType("petsc4py")
    module.PETSc = petsc
    sys.modules["petsc4py"] = module


def step():
    """A function of the shear modulus at the quadrature points: displacement at the focus after the step."""
    stand_in_for_petsc()
    import jax.numpy as jnp
    from jax_fem import logger
    from jax_fem.generate_mesh import Mesh, rectangle_mesh
    from jax_fem.problem import Problem
    from jax_fem.solver import ad_wrapper

    logger.setLevel(logging.ERROR)

    class Step(Problem):
        def get_tensor_map(self):
            def stress(gradient, modulus):
                strain = 0.5 * (gradient + gradient.T)
                trace = jnp.trace(strain)
                return 2.0 * modulus * (strain - trace / 3.0 * jnp.eye(2)) + BULK_MODULUS * trace * jnp.eye(2)

            return stress

        def get_mass_map(self):
            def inertia(displacement, position, modulus):
                force = 1e5 * jnp.exp(-((position[0] / 6e-4) ** 2) - ((position[1] - 0.5 * SIZE[1]) / 4e-3) ** 2)
                return DENSITY * STEP_SCALE * displacement - force * jnp.array([0.0, 1.0])

            return inertia

        def set_params(self, modulus):
            self.internal_vars = [modulus]

    made = rectangle_mesh(*CELLS, *SIZE)
    mesh = Mesh(made.points, made.cells_dict["quad"])
    held = [[lambda point: jnp.isclose(point[0], SIZE[0])] * 2, [0, 1], [lambda point: 0.0] * 2]
    problem = Step(mesh, vec=2, dim=2, ele_type="QUAD4", dirichlet_bc_info=held)
    solve = ad_wrapper(problem, {"umfpack_solver": {}}, {"umfpack_solver": {}})
    focus = int(np.argmin(np.hypot(mesh.points[:, 0], mesh.points[:, 1] - 0.5 * SIZE[1])))
    shape = problem.JxW.shape[0], problem.JxW.shape[2]
    return lambda modulus: solve(modulus)[0][focus, 1], shape, 2 * len(mesh.points)


def main() -> None:
    """Seconds of the value, and of value and gradient, as JSON on the last line."""
    jax.config.update("jax_enable_x64", True)
    value, shape, n_unknowns = step()
    both = jax.value_and_grad(value)
    times: dict[str, list[float]] = {"value": [], "value and gradient": []}
    for scale in (1.0, 1.01, 1.02, 1.03):
        modulus = jax.numpy.full(shape, scale * SHEAR_MODULUS)
        for name, function in (("value", value), ("value and gradient", both)):
            start = time.perf_counter()
            jax.block_until_ready(function(modulus))
            times[name].append(time.perf_counter() - start)
    later = {name: statistics.median(each[1:]) for name, each in times.items()}
    print(json.dumps({"unknowns": n_unknowns, "seconds_a_step": later}))


if __name__ == "__main__":
    main()
