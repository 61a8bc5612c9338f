"""Small problems and runs that the tests of the explicit path share."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from arfjax.grid import AxisymmetricGrid
from arfjax.mechanics.elements.mesh import Wall, Walls
from arfjax.mechanics.explicit.grid import (
    DampingLayer,
    cell_positions,
    coarsened,
    node_positions,
)
from arfjax.mechanics.explicit.result import ExplicitResult
from arfjax.mechanics.explicit.settings import ExplicitSettings, explicit_settings
from arfjax.mechanics.explicit.solver import solve_push_explicitly
from arfjax.mechanics.material.viscoelastic import (
    Prony,
    ShearModulus,
    ViscoelasticField,
    viscoelastic_field,
)
from tests.mechanics.problems import Reference

FREE = Walls(Wall.FREE, Wall.FREE, Wall.FREE)
MIXED = Walls(Wall.SLIDING, Wall.FIXED, Wall.FREE)
LAYER = DampingLayer(2e-3, 4e4)


def quick_jit(f: Callable) -> Callable:
    """Compiled with few optimisations: what runs here takes longer to compile than to run."""
    return jax.jit(f, compiler_options={"xla_backend_optimization_level": 0})


def sizes(finest: float, *, growth: float, end: float) -> np.ndarray:
    """Positions of pairs of cells of one size, so that every other of them is a graded grid too."""
    spacings = [finest]
    while 4.0 * sum(spacings) < end:
        spacings.append(spacings[-1] * growth)
    return np.concatenate([[0.0], np.cumsum(np.repeat(spacings, 4))])


@functools.cache
def beam_grid() -> AxisymmetricGrid:
    """80 x 88 cells, 0.05 x 0.2 mm at the focus; walls beyond what the pressure wave reaches and returns from."""
    r, z = sizes(0.05e-3, growth=1.22, end=12e-3), sizes(0.2e-3, growth=1.22, end=14e-3)
    return AxisymmetricGrid(r, np.concatenate([-z[:0:-1], z]))


def beam_force(grid: AxisymmetricGrid) -> np.ndarray:
    r, z = node_positions(grid)
    return 1e5 * np.exp(-((r / 0.5945e-3) ** 2) - (z / 3.822e-3) ** 2)


def reference_material(kind: str, grid: AxisymmetricGrid) -> ViscoelasticField:
    reference = Reference(kind)
    c, prony = reference.constants, reference.prony()
    if kind == "elastic":
        prony = Prony(jnp.asarray(c["G0"]), jnp.zeros(0), jnp.zeros(0))
    return viscoelastic_field(
        prony, grid.shape, density=c["rho"], bulk_modulus=c["K"], reading=ShearModulus(), poisson_ratio=0.5
    )


def reference_run(kind: str, grid: AxisymmetricGrid, **options) -> ExplicitResult:
    material, points = reference_material(kind, grid), Reference(kind).points
    settings = explicit_settings(grid, material, end=5e-4, push_duration=5e-4, **options)
    run = quick_jit(lambda m, f: solve_push_explicitly(grid, m, f, settings=settings, points=points))
    return run(material, beam_force(grid))


def error_at_end(kind: str, at_points: jax.Array | np.ndarray) -> float:
    """Largest error of the axial displacement at the stored points at 0.5 ms, over the largest displacement."""
    reference = Reference(kind)
    stored = reference.displacement[4]
    assert reference.times[4] == 5e-4
    difference = np.asarray(at_points)[-1, :, 1] - stored
    return float(np.max(np.abs(difference)) / np.max(np.abs(stored)))


@functools.cache
def coarse_run(kind: str) -> ExplicitResult:
    return reference_run(kind, coarsened(beam_grid()))


@functools.cache
def small_grid() -> AxisymmetricGrid:
    """Uneven, so that no symmetry hides a mistake."""
    r = np.array([0.0, 0.7, 1.5, 2.2, 3.1, 4.2, 5.0])
    z = np.array([-3.0, -2.2, -1.5, -0.9, -0.1, 0.7, 1.2, 2.0, 2.9])
    return AxisymmetricGrid(1e-3 * r, 1e-3 * z)


def elongated_grid() -> AxisymmetricGrid:
    """Four times as long as wide at the focus, as for a beam, and graded."""
    r, z = sizes(0.1e-3, growth=1.3, end=1.5e-3), sizes(0.4e-3, growth=1.3, end=3e-3)
    return AxisymmetricGrid(r, np.concatenate([-z[:0:-1], z]))


def uneven_material(grid: AxisymmetricGrid, *, bulk_modulus: float = 5e5, n_branches: int = 2) -> ViscoelasticField:
    r, z = (jnp.asarray(1e3 * x) for x in cell_positions(grid))
    bump = 0.2 * jnp.sin(r + 0.5 * z)
    branches = jnp.arange(1.0, n_branches + 1.0)[:, None, None]
    return ViscoelasticField(
        density=1060.0 * (1.0 + 0.3 * bump),
        bulk_modulus=bulk_modulus * (1.0 - bump),
        relaxed_shear_modulus=2000.0 * (1.0 + bump),
        branch_shear_moduli=1500.0 * branches * (1.0 + 0.5 * bump)[None],
        relaxation_times=2e-4 * branches * (1.0 - bump)[None],
    )


def small_force(grid: AxisymmetricGrid, centre: float = -2e-4, width: float = 1e-3) -> np.ndarray:
    r, z = node_positions(grid)
    return 1e5 * np.exp(-((r / width) ** 2) - ((z - centre) / 1.5e-3) ** 2)


SMALL = ExplicitSettings(2e-5, 24, 3.1e-4, n_maps=2, steps_per_checkpoint=4)


@functools.cache
def compiled(settings: ExplicitSettings, walls: Walls, layer: DampingLayer | None) -> Callable:
    grid = small_grid()
    options = {"settings": settings, "walls": walls, "damping": layer, "estimate_error": False}
    return quick_jit(lambda m, a, r: solve_push_explicitly(grid, m, a, radial_force=r, **options))


def run(
    material: ViscoelasticField,
    axial_force: np.ndarray | jax.Array | None = None,
    radial_force: np.ndarray | jax.Array | None = None,
    *,
    settings: ExplicitSettings = SMALL,
    walls: Walls = MIXED,
    layer: DampingLayer | None = LAYER,
) -> ExplicitResult:
    axial = small_force(small_grid()) if axial_force is None else axial_force
    radial = np.zeros_like(axial) if radial_force is None else radial_force
    return compiled(settings, walls, layer)(material, axial, radial)
