"""A stiff ellipsoid in a box, pushed: the stored solution of another finite-element code."""

import jax
import numpy as np
import pytest

from arfjax.mechanics.elements.refinement import focused_mesh
from arfjax.mechanics.material.inclusion import Inclusion, material_at
from arfjax.mechanics.material.lesion import Ellipsoid, EllipsoidalLesion
from arfjax.mechanics.material.viscoelastic import YoungModulus
from arfjax.mechanics.transient.push import PushSettings, solve_push
from arfjax.media import Elastic, Solid, Zener
from tests.mechanics.problems import REFERENCES, gaussian_force


def solid(kind: str, constants: np.ndarray) -> Solid:
    """Moduli are Young's; the elastic solid has the unrelaxed one."""
    relaxed, unrelaxed, time = (float(each) for each in constants[:3])
    return Elastic(unrelaxed) if kind == "elastic" else Zener(relaxed, unrelaxed, time)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["elastic", "zener"])
def test_stored_lesion(kind):
    """To 1e-3 of the peak, which is the accuracy of the stored solution, at all its points and every 20 us of 1 ms.

    Six elements lie across the lesion's radius of 0.3 mm: the share has a kink on the surface and a tip in the centre.
    """
    stored = dict(np.load(REFERENCES / f"lesion_{kind}_60.npz"))
    length, diameter = (float(each) for each in stored["lesion"][3:])
    half, radius, push = float(stored["Z"]), float(stored["R"]), float(stored["push"])
    mesh = focused_mesh(
        focus=0.0,
        radius=radius,
        front=-half,
        back=half,
        finest_r=0.05e-3,
        finest_z=0.15e-3,
        fine_radius=0.6e-3,
        fine_length=4e-3,
        coarsest=3e-3,
    )
    lesion = EllipsoidalLesion(Ellipsoid.of_length_and_diameter(length, diameter, centre=0.0))
    material = material_at(
        mesh,
        Inclusion(solid(kind, stored["bg"]), solid(kind, stored["lesion"]), lesion),
        density=float(stored["rho"]),
        reading=YoungModulus(),
        poisson_ratio=float(stored["nu"]),
    )
    force = gaussian_force(mesh, float(stored["F0"]), float(stored["a"]), float(stored["b"]))
    settings = PushSettings(2e-5, 50, push)
    result = jax.jit(lambda m: solve_push(mesh, m, force, settings=settings, points=stored["pts"]))(material)
    steps = np.rint(settings.times / stored["t"][1]).astype(int)
    expected = np.stack([stored["ur"], stored["uz"]], axis=-1)[steps]
    difference = np.asarray(result.displacement_at_points) - expected
    assert np.max(np.abs(difference)) < 1e-3 * np.max(np.abs(expected))
