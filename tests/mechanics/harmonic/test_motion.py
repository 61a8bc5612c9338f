"""Harmonic motion: exact solution, order, invariants, limits, the transient's spectrum, derivatives."""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.grid import graded_positions
from arfjax.mechanics.elements.axisymmetric import load
from arfjax.mechanics.elements.mesh import Mesh, Walls
from arfjax.mechanics.harmonic.absorbing import AbsorbingLayer
from arfjax.mechanics.harmonic.motion import power_balance, solve_harmonic
from arfjax.mechanics.material.complex_modulus import complex_modulus
from arfjax.mechanics.material.harmonic import HarmonicField, harmonic_field, solid_field
from arfjax.mechanics.material.viscoelastic import ShearModulus, YoungModulus, prony_of, viscoelastic_field
from arfjax.mechanics.transient.push import PushSettings, solve_push
from arfjax.media import Elastic, FractionalKelvinVoigt, FractionalZener, KelvinVoigt, Prony, Zener
from tests.checks import assert_gradient_of_each_leaf, assert_order
from tests.mechanics.problems import REFERENCES, gaussian_force, small_force, small_mesh, uneven_material

LAYER = AbsorbingLayer(thickness=0.1, growth=2.0)
"""Thin and coarse: what holds for any matrix holds for this one."""


def uneven_field(mesh: Mesh, *, shear: complex = 2e3 + 900j, bulk: float = 5e5) -> HarmonicField:
    """Every constant varies in space."""
    material = uneven_material(mesh, bulk_modulus=bulk)
    return HarmonicField(
        material.density, material.bulk_modulus, shear * material.relaxed_shear_modulus.astype(complex) / 2e3
    )


@functools.cache
def compiled(layer: AbsorbingLayer | None, fixed: bool = True) -> Callable:
    mesh = small_mesh(Walls(fixed, fixed, fixed))

    @jax.jit
    def solution(material, axial_force, radial_force, frequency):
        return solve_harmonic(
            mesh, material, axial_force, frequency=frequency, layer=layer, radial_force=radial_force
        ).displacement

    return solution


def run(
    material: HarmonicField,
    frequency: float,
    axial: np.ndarray | None = None,
    radial: np.ndarray | None = None,
    *,
    layer: AbsorbingLayer | None = None,
    fixed: bool = True,
) -> jnp.ndarray:
    """Amplitudes on the small mesh, compiled once for all tests."""
    axial = small_force(small_mesh()) if axial is None else axial
    radial = np.zeros_like(axial) if radial is None else radial
    return compiled(layer, fixed)(material, jnp.asarray(axial), jnp.asarray(radial), frequency)


def reference_error(finest_r: float, finest_z: float, coarsest: float, layer: AbsorbingLayer) -> float:
    stored = np.load(REFERENCES / "hmi50_fzener.npz")
    c = {name: float(stored[name]) for name in stored if stored[name].ndim == 0}
    r = graded_positions(0.0, 11e-3, 0.0, finest=finest_r, growth=1.2, coarsest=coarsest)
    z = graded_positions(-12e-3, 12e-3, 0.0, finest=finest_z, growth=1.2, coarsest=coarsest)
    mesh = Mesh(r, z)
    material = solid_field(
        FractionalZener(c["G0"], c["G0"] + c["dG"], c["tau"], c["beta"]),
        (len(mesh.gauss_r), len(mesh.gauss_z)),
        density=c["rho"],
        bulk_modulus=c["K"],
        reading=ShearModulus(),
        poisson_ratio=0.5,
    )
    force = gaussian_force(mesh, c["F0"], c["a"], c["b"])
    result = jax.jit(lambda m: solve_harmonic(mesh, m, force, frequency=c["freq"], layer=layer))(material)
    difference = np.asarray(result.at_points(stored["pts"]))[:, 1] - stored["uz"]
    np.testing.assert_allclose(result.at_focus(0.0), result.at_points(stored["pts"])[0, 1], rtol=1e-12)
    return float(np.max(np.abs(difference)) / np.max(np.abs(stored["uz"])))


def test_infinite_fractional_medium_at_50_hz():
    assert reference_error(0.1e-3, 0.4e-3, 2e-3, AbsorbingLayer()) < 1e-4


@pytest.mark.slow
def test_infinite_fractional_medium_at_50_hz_on_a_coarse_and_a_fine_mesh():
    assert reference_error(0.15e-3, 0.6e-3, 3e-3, AbsorbingLayer(thickness=0.2)) < 4e-4
    assert reference_error(0.05e-3, 0.3e-3, 1.5e-3, AbsorbingLayer()) < 1e-4  # the layer's own error is left


@pytest.mark.slow
@pytest.mark.parametrize("layer", [None, AbsorbingLayer(growth=1.2)])
def test_third_order_in_space(layer):
    # At 400 Hz waves are 4 mm long; the change at each halving of the elements.
    answers = []
    for n in (4, 8, 16, 32):
        mesh = Mesh(np.linspace(0.0, 4e-3, n + 1), np.linspace(-4e-3, 4e-3, 2 * n + 1))
        force = gaussian_force(mesh, 1e5, 1.5e-3, 2e-3)
        material = uneven_field(mesh, shear=2e3 + 400j)
        solution = jax.jit(
            lambda m, f, mesh=mesh: solve_harmonic(mesh, m, f, frequency=400.0, layer=layer).displacement
        )
        answers.append(np.asarray(solution(material, force))[:: n // 4, :: n // 4])
    changes = [np.linalg.norm(after - before) for before, after in zip(answers, answers[1:], strict=False)]
    assert_order([4.0, 2.0, 1.0], changes, order=3.0, slack=0.1)


@pytest.mark.parametrize("layer", [None, LAYER])
def test_power_in_equals_power_out(layer):
    mesh = small_mesh(Walls(True, False, True))
    powers = jax.jit(lambda m: power_balance(mesh, m, small_force(mesh), frequency=150.0, layer=layer))(
        uneven_field(mesh)
    )
    assert float(powers.dissipated) > 0.1 * float(powers.supplied) > 0.0
    assert float(powers.radiated) > 0.01 * float(powers.supplied) or layer is None
    np.testing.assert_allclose(powers.dissipated + powers.radiated, powers.supplied, rtol=1e-9)


@pytest.mark.parametrize("layer", [None, LAYER])
def test_reciprocity(layer):
    mesh, material = small_mesh(), uneven_field(small_mesh())
    here, there = small_force(mesh), gaussian_force(mesh, 2e4, 2e-3, 1e-3, centre=5e-4)
    first = run(material, 120.0, here, 0.3 * there, layer=layer)
    second = run(material, 120.0, 0.5 * there, there, layer=layer)
    at = mesh.element_values
    load_first = load(mesh, at(here), at(0.3 * there)).transpose(1, 0, 2)
    load_second = load(mesh, at(0.5 * there), at(there)).transpose(1, 0, 2)
    np.testing.assert_allclose(jnp.sum(load_second * first), jnp.sum(load_first * second), rtol=1e-9)


def test_regular_on_the_axis():
    """The slope of the axial motion vanishes there, by a difference of second order."""
    slopes = []
    for n in (8, 16):
        mesh = Mesh(np.linspace(0.0, 4e-3, n + 1), np.linspace(-4e-3, 4e-3, n + 1))
        force = gaussian_force(mesh, 1e5, 1.5e-3, 2e-3)
        result = solve_harmonic(mesh, uneven_field(mesh, shear=2e3 + 400j), force, frequency=400.0, layer=None)
        start, half, whole = np.asarray(result.displacement)[:3, n, 1]
        slopes.append(abs(4.0 * half - whole - 3.0 * start) / mesh.r_edges[1] / (abs(start) / 1.5e-3))
    assert slopes[1] < 0.02 and slopes[1] < 0.3 * slopes[0]


def test_a_free_body_under_uniform_force_is_inertia_alone():
    material = uneven_field(small_mesh())
    for frequency in (20.0, 150.0, 2000.0):
        displacement = run(material, frequency, 30.0 * material.density, fixed=False)
        expected = np.zeros(displacement.shape)
        expected[..., 1] = -30.0 / (2.0 * np.pi * frequency) ** 2
        np.testing.assert_allclose(displacement, expected, rtol=0.0, atol=1e-8 * np.max(np.abs(expected)))


def test_inertia_rules_far_above_all_waves():
    # Wavelength of both waves far below the mesh size: each mass moves by itself, u = -F / (rho omega^2).
    mesh = small_mesh()
    material = uneven_field(mesh, shear=1e-3 + 1e-4j, bulk=1e-3)
    material = dataclasses.replace(material, density=jnp.full_like(material.density, 1e3))
    r, z = mesh.gauss_r[:, None], mesh.gauss_z[None, :]
    force = 1e3 * (2.0 + 100.0 * z + 4e4 * r**2)  # in the space of the elements
    displacement = run(material, 300.0, force, fixed=False)
    nodes = 1e3 * (2.0 + 100.0 * mesh.node_z[None, :] + 4e4 * mesh.node_r[:, None] ** 2)
    np.testing.assert_allclose(displacement[..., 1], -nodes / (1e3 * (600.0 * np.pi) ** 2), rtol=1e-5)


def test_no_locking_near_incompressibility():
    material = uneven_field(small_mesh())

    def answer(bulk: float) -> np.ndarray:
        return np.asarray(run(dataclasses.replace(material, bulk_modulus=bulk * material.bulk_modulus), 120.0))

    reference = answer(1e4)
    for bulk, bound in ((1.0, 2e-2), (1e2, 2e-4), (1e6, 1e-4)):
        assert np.linalg.norm(answer(bulk) - reference) < bound * np.linalg.norm(reference)
    fine = small_mesh()
    fine = Mesh(_halved(_halved(fine.r_edges)), _halved(_halved(fine.z_edges)))
    stiff, force = uneven_field(fine, bulk=5e9), small_force(fine)
    motion = jax.jit(lambda: solve_harmonic(fine, stiff, force, frequency=120.0, layer=None).displacement)()[::4, ::4]
    assert np.linalg.norm(motion - reference) < 0.02 * np.linalg.norm(reference)


def _halved(edges: np.ndarray) -> np.ndarray:
    return np.sort(np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])]))


@pytest.mark.slow
def test_the_spectrum_of_a_transient_run_is_the_harmonic_motion():
    # A push of 2 ms in a lossy box, until all is at rest; its spectrum over that of the push.
    mesh, material, frequency = small_mesh(), uneven_material(small_mesh(), bulk_modulus=5e4), 180.0
    settings = PushSettings(time_step=4e-5, n_steps=750, push_duration=2e-3)
    force = small_force(mesh)
    push = jax.jit(lambda m: solve_push(mesh, m, force, settings=settings))(material)
    history = np.asarray(push.axial_displacement_on_axis)
    assert np.max(np.abs(history[-1])) < 1e-4 * np.max(np.abs(history))
    omega = 2.0 * np.pi * frequency
    spectrum = settings.time_step * np.exp(-1j * omega * settings.times) @ history
    of_push = (1.0 - np.exp(-1j * omega * settings.push_duration)) / (1j * omega)
    ours = run(harmonic_field(material, omega), frequency)[0, :, 1]
    np.testing.assert_allclose(ours, spectrum / of_push, rtol=0.0, atol=5e-4 * float(np.max(np.abs(ours))))


SOLIDS = {
    "elastic": Elastic(4e3),
    "zener": Zener(500.0, 1e4, 2e-3),
    "fractional": FractionalZener(500.0, 1e4, 2e-3, 0.4),
    "kelvin_voigt": KelvinVoigt(2e3, 1.5),
    "fractional_kelvin_voigt": FractionalKelvinVoigt(2e3, 20.0, 0.5),
    "prony": Prony(800.0, jnp.array([2e3, 3e3]), jnp.array([1e-3, 1e-2])),
}


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_solid_is_the_same_in_harmonic_and_transient_runs(kind):
    # Sums of exponentials stand for viscosities and fractional orders; 2 (omega t)^2 and the kernel's error at 50 Hz.
    settings = {"density": 1e3, "bulk_modulus": 1e6, "reading": YoungModulus(), "poisson_ratio": 0.49}
    solid, omega = SOLIDS[kind], 2.0 * np.pi * 50.0
    exact = harmonic_field(solid_field(solid, (2, 3), **settings), omega)
    assert exact.shear_modulus.shape == exact.density.shape == (2, 3)
    np.testing.assert_allclose(exact.shear_modulus, complex_modulus(solid, omega) / 2.98, rtol=1e-13)
    ours = harmonic_field(viscoelastic_field(prony_of(solid), (2, 3), **settings), omega)
    np.testing.assert_allclose(ours.shear_modulus, exact.shear_modulus, rtol=3e-4)


def test_a_field_of_branches_has_its_modulus_at_any_frequency():
    field = uneven_material(small_mesh(), n_branches=1)
    relaxed, branch, time = field.relaxed_shear_modulus, field.branch_shear_moduli[0], field.relaxation_times[0]
    for omega in (0.0, 1e-3, 1.0, 1e3, 1e9, 1e200):
        ours, expected = harmonic_field(field, omega), complex_modulus(Zener(relaxed, relaxed + branch, time), omega)
        np.testing.assert_allclose(ours.shear_modulus, expected, rtol=1e-12)


def test_gradient():
    mesh = small_mesh()
    shape = (len(mesh.gauss_r), len(mesh.gauss_z))
    waves = uneven_material(mesh)
    ripple = waves.bulk_modulus / 5e5
    start = {
        "solid": solid_field(
            FractionalZener(800.0 * ripple, 6e3 / ripple, 2e-3 * ripple, 0.5 * ripple),
            shape,
            density=waves.density,
            bulk_modulus=waves.bulk_modulus,
            reading=YoungModulus(),
            poisson_ratio=0.49,
        ),
        "sum_of_exponentials": waves,
        "axial": jnp.asarray(small_force(mesh)),
        "radial": jnp.asarray(0.4 * small_force(mesh)),
        "frequency": jnp.asarray(110.0),
    }

    def observed(x):
        forces = {"axial_force": x["axial"], "radial_force": x["radial"]}
        here = solve_harmonic(mesh, x["solid"], frequency=x["frequency"], layer=LAYER, **forces).at_focus(1e-4)
        there = solve_harmonic(mesh, x["sum_of_exponentials"], frequency=60.0, layer=LAYER, **forces).at_focus(1e-4)
        return 1e6 * (jnp.abs(here) + 0.3 * here.real + there.real - 0.7 * there.imag)

    assert_gradient_of_each_leaf(observed, start)


def test_a_batch_of_materials_equals_a_loop():
    materials = [uneven_field(small_mesh(), bulk=bulk) for bulk in (1e5, 5e5)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *materials)
    zero, force = jnp.zeros((12, 15)), jnp.asarray(small_force(small_mesh()))
    batch = jax.jit(jax.vmap(lambda m: compiled(None)(m, force, zero, 90.0)))(stacked)
    for ours, material in zip(batch, materials, strict=True):
        expected = run(material, 90.0)
        np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-10 * float(jnp.max(jnp.abs(expected))))


def test_nonsense_is_refused():
    mesh = small_mesh()
    material, force = uneven_field(mesh), small_force(mesh)
    with pytest.raises(InputError, match="`frequency` must not be negative"):
        solve_harmonic(mesh, material, force, frequency=-1.0)
    with pytest.raises(InputError, match="`axial_force` must have shape"):
        solve_harmonic(mesh, material, force[1:], frequency=50.0)
    elsewhere = uneven_field(Mesh(mesh.r_edges, mesh.z_edges[1:]))
    with pytest.raises(InputError, match="`density` must have shape"):
        solve_harmonic(mesh, elsewhere, force, frequency=50.0)
