"""The absorbing layer against exact motion of an infinite medium, for waves shorter and longer than the mesh."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.mechanics.elements.mesh import Mesh, Wall, Walls
from arfjax.mechanics.harmonic.absorbing import AbsorbingLayer, stretched
from arfjax.mechanics.harmonic.motion import layer_error, power_balance, solve_harmonic
from arfjax.mechanics.material.harmonic import HarmonicField, shear_wavelength
from tests.mechanics.unbounded import UnboundedMedium

WIDTH, DENSITY, FREQUENCY = 2e-3, 1000.0, 50.0
POINTS = 1e-3 * np.array([[1.0, 0.0], [3.0, 0.0], [5.0, 0.0], [0.0, 2.0], [0.0, 6.0], [3.0, 5.0], [4.0, -4.0]])


def box() -> Mesh:
    """Small, with ends 5 mm and 7 mm away: no symmetry hides a mistake."""
    return Mesh(1e-3 * np.linspace(0.0, 6.0, 11), 1e-3 * np.linspace(-5.0, 7.0, 21))


def gaussian(mesh: Mesh) -> np.ndarray:
    return np.exp(-(mesh.gauss_r[:, None] ** 2 + mesh.gauss_z[None, :] ** 2) / WIDTH**2)


def homogeneous(mesh: Mesh, shear: complex | jnp.ndarray, bulk: float | jnp.ndarray) -> HarmonicField:
    ones = jnp.ones((len(mesh.gauss_r), len(mesh.gauss_z)))
    return HarmonicField(DENSITY * ones, bulk * ones, shear * ones)


def modulus(wavelength: float, loss: float) -> complex:
    """Shear modulus that gives about this wavelength."""
    return DENSITY * (wavelength * FREQUENCY) ** 2 * (1.0 + 1j * loss)


@functools.cache
def compiled(layer: AbsorbingLayer | None) -> Callable:
    mesh = box()

    @jax.jit
    def motion(shear, bulk):
        material = homogeneous(mesh, shear, bulk)
        return solve_harmonic(mesh, material, gaussian(mesh), frequency=FREQUENCY, layer=layer).at_points(POINTS)

    return motion


def error(layer: AbsorbingLayer | None, wavelength: float, loss: float = 0.0, stiffness: float = 2e3) -> float:
    """Largest error of the axial amplitude over its largest value, the bulk modulus `stiffness` shear moduli."""
    shear = modulus(wavelength, loss)
    bulk = stiffness * abs(shear)
    medium = UnboundedMedium(width=WIDTH, shear=shear, bulk=bulk, density=DENSITY, frequency=FREQUENCY)
    exact = np.array([medium.axial_displacement(r, z) for r, z in POINTS])
    ours = np.asarray(compiled(layer)(shear, bulk))[:, 1]
    return float(np.max(np.abs(ours - exact)) / np.max(np.abs(exact)))


@pytest.mark.parametrize(
    ("wavelength", "loss"), [(8e-3, 0.0), (0.02, 0.0), (0.05, 0.0), (0.2, 0.0), (0.5, 0.0), (0.02, 0.5), (0.1, 5.0)]
)
def test_infinite_medium(wavelength, loss):
    # The rest is the error of elements of 0.6 mm in the tissue, most where waves are shorter than the box.
    assert error(AbsorbingLayer(), wavelength, loss) < (1e-3 if wavelength < 0.01 else 6e-4)


@pytest.mark.parametrize("stiffness", [1.0, 1e6])
def test_pressure_waves_are_absorbed_too(stiffness):
    assert error(AbsorbingLayer(), 0.02, 0.1, stiffness) < 5e-4


def test_waves_longer_than_the_layer_and_thin_layers_are_wrong_as_told():
    assert 2e-4 < error(AbsorbingLayer(), 10.0) < 1e-2
    thin = AbsorbingLayer(thickness=0.015)
    assert 2e-2 < error(thin, 0.05) < 0.1
    assert error(None, 0.05) > 0.2


@pytest.mark.slow
def test_the_layer_tells_its_own_error():
    mesh = box()
    for layer in (AbsorbingLayer(thickness=0.015), AbsorbingLayer(thickness=0.05)):

        @jax.jit
        def told(shear, bulk, layer=layer):
            material = homogeneous(mesh, shear, bulk)
            return layer_error(mesh, material, gaussian(mesh), frequency=FREQUENCY, layer=layer)

        for wavelength in (0.02, 0.05, 0.2):
            actual, shear = error(layer, wavelength), modulus(wavelength, 0.0)
            estimate = float(told(shear, 2e3 * abs(shear)))
            if actual > 1e-3:
                assert 0.5 < estimate / actual < 2.0, (layer, wavelength, estimate, actual)
            else:
                assert estimate < 1e-3


def test_an_elastic_medium_radiates_the_exact_power():
    mesh = box()
    layer = AbsorbingLayer()

    @jax.jit
    def balance(shear, bulk):
        material = homogeneous(mesh, shear, bulk)
        return power_balance(mesh, material, gaussian(mesh), frequency=FREQUENCY, layer=layer)

    for wavelength, stiffness in ((0.01, 2e3), (0.05, 2e3), (0.02, 1.0)):
        shear = modulus(wavelength, 0.0)
        medium = UnboundedMedium(
            width=WIDTH, shear=shear, bulk=stiffness * shear.real, density=DENSITY, frequency=FREQUENCY
        )
        powers = balance(shear, stiffness * shear.real)
        exact = medium.radiated_power(2.0 * np.pi * FREQUENCY)
        assert float(powers.dissipated) == 0.0
        np.testing.assert_allclose(powers.supplied, exact, rtol=5e-3)
        np.testing.assert_allclose(powers.radiated, powers.supplied, rtol=1e-8)


def test_without_stretch_a_layer_is_more_tissue():
    mesh = Mesh(1e-3 * np.linspace(0.0, 4.0, 5), 1e-3 * np.linspace(-4.0, 4.0, 9), Walls(False, False, False))
    layer = AbsorbingLayer(thickness=6e-3, strength=0.0, bottom=False)
    whole = stretched(mesh, layer).mesh
    walls = whole.walls
    assert (walls.outer, walls.bottom, walls.top) == (Wall.FIXED, Wall.FREE, Wall.FIXED)
    np.testing.assert_allclose([whole.r_edges[-1], whole.z_edges[0], whole.z_edges[-1]], [1e-2, -4e-3, 1e-2])
    shear = modulus(0.02, 0.3)

    force = gaussian(mesh)
    padded = np.zeros((len(whole.gauss_r), len(whole.gauss_z)))
    padded[: force.shape[0], : force.shape[1]] = force

    def motion(where, forced, around):
        material = homogeneous(where, shear, 1e6)
        return solve_harmonic(where, material, forced, frequency=FREQUENCY, layer=around).displacement

    ours, wide = jax.jit(lambda: (motion(mesh, force, layer), motion(whole, padded, None)))()
    expected = wide[: len(mesh.node_r), : len(mesh.node_z)]
    np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-9 * float(jnp.max(jnp.abs(expected))))


def test_a_refined_layer_is_four_times_as_thick_with_twice_as_many_elements_to_every_size():
    layer = AbsorbingLayer(thickness=0.1, strength=0.7, growth=1.5, top=False)
    finer = layer.refined()
    assert (finer.thickness, finer.strength, finer.top) == (pytest.approx(0.4), 0.7, False)
    assert finer.growth**2 == pytest.approx(1.5) and AbsorbingLayer(growth=1.0).refined().growth == 1.0
    assert finer.beyond(1e-3)[-1] == pytest.approx(4.0 * layer.beyond(1e-3)[-1])


def test_walls_without_a_layer_keep_their_kind():
    walls = Walls(outer=Wall.SLIDING, bottom=Wall.FREE, top=Wall.SLIDING)
    mesh = Mesh(1e-3 * np.linspace(0.0, 4.0, 3), 1e-3 * np.linspace(-4.0, 4.0, 4), walls)
    for side in ("outer", "bottom", "top"):
        layer = AbsorbingLayer(**{name: name == side for name in ("outer", "bottom", "top")})
        kinds = {name: Wall.FIXED if name == side else getattr(walls, name) for name in ("outer", "bottom", "top")}
        assert stretched(mesh, layer).mesh.walls == Walls(**kinds)


def test_no_sides_no_layer():
    mesh = box()
    alone = stretched(mesh, AbsorbingLayer(outer=False, bottom=False, top=False))
    assert alone.mesh.shape == mesh.shape and alone.mesh.walls == mesh.walls
    assert float(jnp.max(jnp.abs(alone.volume_weights().imag))) == 0.0


def test_wavelength():
    field = homogeneous(box(), modulus(0.02, 0.0), 1e6)
    np.testing.assert_allclose(shear_wavelength(field, FREQUENCY), 0.02, rtol=1e-12)


@pytest.mark.parametrize("setting", [{"thickness": 0.0}, {"strength": -1.0}, {"growth": 0.9}, {"thickness": np.nan}])
def test_nonsense_is_refused(setting):
    with pytest.raises(InputError, match="absorbing layer needs"):
        AbsorbingLayer(**setting)
