"""A push in an infinite medium against its exact solution, and the order in space."""

import numpy as np
import pytest

from arfjax.mechanics.elements.mesh import Mesh
from tests.checks import assert_order
from tests.mechanics.problems import Reference, reference_mesh


@pytest.mark.parametrize("kind", ["elastic", "zener", "fzener"])
def test_infinite_medium(kind):
    # Walls at 24 mm are further than the pressure wave (22 m/s) travels and returns within 1 ms.
    reference = Reference(kind)
    mesh = reference_mesh(0.15e-3, 0.8e-3)
    assert mesh.n_unknowns < 10_000
    assert reference.error(reference.solve(mesh, time_step=2.5e-5, end=1e-3)) < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["elastic", "zener", "fzener"])
def test_infinite_medium_to_a_ten_thousandth(kind):
    reference = Reference(kind)
    mesh = reference_mesh(0.1e-3, 0.2e-3, growth=1.05, coarsest=1e-3)
    assert reference.error(reference.solve(mesh, time_step=5e-6, end=1e-3)) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["elastic", "zener", "fzener"])
def test_infinite_medium_with_few_unknowns(kind):
    reference = Reference(kind)
    mesh = reference_mesh(0.1e-3, 0.2e-3, growth=1.1)
    assert mesh.n_unknowns < 25_000
    assert reference.error(reference.solve(mesh, time_step=1e-5, end=1e-3)) < 5e-4


def halved(edges: np.ndarray) -> np.ndarray:
    return np.sort(np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])]))


@pytest.mark.slow
def test_third_order_in_space():
    reference, errors = Reference("elastic"), []
    mesh = reference_mesh(0.8e-3, 3e-3, growth=1.4)
    for _ in range(3):
        result = reference.solve(mesh, time_step=1.25e-5, end=5e-4)
        difference = np.asarray(result.displacement_at_points)[-1, :, 1] - reference.displacement[4]
        errors.append(float(np.linalg.norm(difference) / np.linalg.norm(reference.displacement[4])))
        mesh = Mesh(halved(mesh.r_edges), halved(mesh.z_edges))
    assert_order([4.0, 2.0, 1.0], errors, order=2.65)
