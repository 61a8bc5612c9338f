"""Dynamic mechanical analysis against closed forms: springs in series, masses, bath, delay, bonded blocks."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.instruments.dma import (
    DynamicMechanicalAnalyser,
    ModulusReadings,
    bonded_block_factor,
    magnitude_of_mean,
    mean_of_magnitudes,
)
from arfjax.mechanics.elements.axisymmetric import strain_energy
from arfjax.mechanics.elements.mesh import Mesh
from tests.checks import assert_gradient, assert_gradient_of_each_leaf

OMEGA = 2.0 * np.pi * np.geomspace(0.1, 200.0, 12)
MODULUS = 2000.0 * (1.0 + (1j * OMEGA * 0.01) ** 0.4)
SHAPE = 10e-3 / 400e-6


def read(modulus: Any = MODULUS, key=None, **settings):
    return DynamicMechanicalAnalyser(**settings)(modulus, OMEGA, key=key)


def test_perfect_analyser_reads_the_modulus():
    shown = read()
    np.testing.assert_allclose(shown.modulus, MODULUS, rtol=1e-15)
    np.testing.assert_allclose(shown.magnitude, np.abs(MODULUS), rtol=1e-15)
    np.testing.assert_allclose(shown.storage + 1j * shown.loss, MODULUS, rtol=1e-15)


def test_mass_lowers_the_storage_modulus():
    shown = read(moving_mass=5e-3)
    np.testing.assert_allclose(shown.modulus, MODULUS - 5e-3 * OMEGA**2 * SHAPE, rtol=1e-14)
    # At 200 Hz 5 g make -197 kPa of 2 kPa: an analysis of liver there is one of its clamp.
    np.testing.assert_allclose(5e-3 * OMEGA[-1] ** 2 * SHAPE, 197.4e3, rtol=1e-3)


def test_bath_adds_to_the_loss_modulus():
    shown = read(bath_damping=0.3)
    np.testing.assert_allclose(shown.loss - MODULUS.imag, 0.3 * OMEGA * SHAPE, rtol=1e-9)
    np.testing.assert_allclose(shown.storage, MODULUS.real, rtol=1e-14)


def test_springs_in_series():
    compliance = 3e-3
    stiffness = MODULUS / SHAPE
    np.testing.assert_allclose(
        read(frame_compliance=compliance).modulus, SHAPE / (1.0 / stiffness + compliance), rtol=1e-13
    )
    rigid = read(np.full(len(OMEGA), 1e15 + 0j), frame_compliance=compliance).modulus
    np.testing.assert_allclose(rigid, SHAPE / compliance, rtol=1e-9)


def test_all_together_is_the_chain_of_masses_and_springs():
    """Drive's force per displacement, from the equations of motion of the two masses."""
    mass, bath, compliance, frame = 4e-3, 0.2, 2e-3, 1.5e-2
    settings = {"moving_mass": mass, "bath_damping": bath, "frame_compliance": compliance, "frame_mass": frame}
    expected = []
    for omega, modulus in zip(OMEGA, MODULUS, strict=True):
        between = 1.3 * modulus / SHAPE + 1j * omega * bath
        stiffness = np.asarray([[between, -between], [-between, between + 1.0 / compliance]])
        dynamic = stiffness - omega**2 * np.diag([mass, frame])
        frame_motion = np.linalg.solve(dynamic[1:, 1:], -dynamic[1:, 0])
        expected.append(SHAPE * (dynamic[0, 0] + dynamic[0, 1:] @ frame_motion))
    np.testing.assert_allclose(read(stiffening=1.3, **settings).modulus, expected, rtol=1e-10)


def test_delay_turns_the_modulus():
    """Displacement read late lags further behind the force: the loss angle grows by phase plus omega times delay."""
    shown = read(delay=2e-4, phase_error=0.02)
    np.testing.assert_allclose(np.angle(shown.modulus), np.angle(MODULUS) + 0.02 + 2e-4 * OMEGA, rtol=1e-12)
    np.testing.assert_allclose(shown.magnitude, np.abs(MODULUS), rtol=1e-14)


def test_floor_is_what_the_magnitude_does_not_fall_below():
    shown = read(noise_floor=4e3)
    np.testing.assert_allclose(shown.magnitude, np.hypot(np.abs(MODULUS), 4e3), rtol=1e-14)
    nothing = ModulusReadings(jnp.zeros(3, complex), 50.0)
    np.testing.assert_allclose(nothing.magnitude, 50.0)
    slope = jax.grad(lambda floor: jnp.sum(ModulusReadings(jnp.zeros(3, complex), floor).magnitude))(0.0)
    assert float(slope) == 0.0


def test_noise_has_its_deviation_and_its_seed():
    samples = np.broadcast_to(MODULUS, (4000, len(MODULUS)))
    shown = read(samples, key=jax.random.key(2), relative_noise=0.03)
    relative = np.asarray(shown.modulus) / MODULUS - 1.0
    # Four standard errors of a standard deviation of 48000 values.
    for part in (relative.real, relative.imag):
        assert abs(part.std() / 0.03 - 1.0) < 4.0 / np.sqrt(2.0 * 48_000)
    np.testing.assert_array_equal(shown.modulus, read(samples, key=jax.random.key(2), relative_noise=0.03).modulus)
    np.testing.assert_allclose(read(samples, relative_noise=0.03).modulus, samples, rtol=1e-15)


def test_averages_over_samples():
    samples = MODULUS[None] * np.asarray([0.8, 0.9, 1.0, 1.2, 1.3j])[:, None]
    mean, error = mean_of_magnitudes(np.abs(samples))
    np.testing.assert_allclose(mean, np.abs(MODULUS) * 1.04, rtol=1e-13)
    spread = np.std([0.8, 0.9, 1.0, 1.2, 1.3], ddof=1) / np.sqrt(5.0)
    np.testing.assert_allclose(error, np.abs(MODULUS) * spread, rtol=1e-13)
    np.testing.assert_allclose(magnitude_of_mean(samples), np.abs(MODULUS) * np.hypot(3.9, 1.3) / 5.0, rtol=1e-13)
    assert np.all(magnitude_of_mean(samples) < mean)
    alike = jax.grad(lambda x: jnp.sum(mean_of_magnitudes(x)[1]))(jnp.ones((3, 2)))
    np.testing.assert_array_equal(alike, 0.0)
    with pytest.raises(InputError, match="two samples or more"):
        mean_of_magnitudes(np.abs(samples[:1]))


def test_bonded_square_has_the_factor_of_torsion():
    """1 + 4 psi / h^2 with Prandtl's mean psi: 0.1406 of a square's fourth power is its torsion constant."""
    np.testing.assert_allclose(bonded_block_factor(width=20e-3, depth=20e-3, thickness=10e-3), 1.5623, rtol=1e-4)
    # By the shape factor, a / (4 h) of a square: 1 + 2.25 S^2; Gent & Lindley's 2 holds for a disc.
    factor = float(bonded_block_factor(width=8e-3, depth=8e-3, thickness=1e-3))
    np.testing.assert_allclose((factor - 1.0) / (8.0 / 4.0) ** 2, 2.25, atol=2e-3)


def test_bonded_strip_is_a_parabola():
    """Far from its ends the pressure of a long strip is a parabola, of mean b^2 / (3 h^2)."""
    long = float(bonded_block_factor(width=3e-3, depth=3.0, thickness=2e-3))
    np.testing.assert_allclose(long - 1.0, 2.25 / 3.0 * (1.0 - 0.63024 * 1e-3), rtol=1e-5)


def test_bonded_rectangle_solves_poissons_equation():
    """Against the double sine series of the same pressure."""
    width, depth, thickness = 30e-3, 20e-3, 10e-3
    odd = np.arange(1, 400, 2)
    m, n = np.meshgrid(odd, odd, indexing="ij")
    mean = np.sum(64.0 / (np.pi**6 * m**2 * n**2 * ((m / width) ** 2 + (n / depth) ** 2)))
    factor = bonded_block_factor(width=width, depth=depth, thickness=thickness)
    np.testing.assert_allclose(factor, 1.0 + 4.0 * mean / thickness**2, rtol=1e-6)
    np.testing.assert_allclose(factor, bonded_block_factor(width=depth, depth=width, thickness=thickness), rtol=1e-14)


def full():
    return DynamicMechanicalAnalyser(9e-3, 350e-6, 1.2, 4e-3, 0.2, 2e-3, 1.5e-2, 0.02, 2e-4, 300.0, 0.05)


def total(analyser, modulus: Any = MODULUS, omega: Any = OMEGA):
    shown = analyser(modulus, omega, key=jax.random.key(3))
    weights = jnp.cos(jnp.arange(12.0))
    return jnp.sum(weights * (shown.magnitude + 0.3 * shown.storage - 0.7 * shown.loss)) * 1e-3


def test_gradient_in_every_attribute():
    assert_gradient_of_each_leaf(total, full(), step=1e-4)


def test_gradient_in_modulus_and_frequency():
    def along(values):
        real, imaginary, omega = values
        return total(full(), jax.lax.complex(real, imaginary), omega)

    assert_gradient(along, (MODULUS.real, MODULUS.imag, OMEGA))
    assert_gradient(
        lambda sides: bonded_block_factor(width=sides[0], depth=sides[1], thickness=sides[2]), (20e-3, 30e-3, 10e-3)
    )


def test_gradient_of_a_perfect_analyser_is_finite():
    gradient = jax.grad(total)(jax.tree.map(jnp.asarray, DynamicMechanicalAnalyser()))
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(gradient))
    assert abs(float(gradient.moving_mass)) > 1.0 and abs(float(gradient.frame_compliance)) > 1.0
    square = jax.grad(lambda a: bonded_block_factor(width=a, depth=20e-3, thickness=10e-3))(20e-3)
    beside = jax.grad(lambda a: bonded_block_factor(width=a, depth=20e-3, thickness=10e-3))(20.0001e-3)
    np.testing.assert_allclose(square, beside, rtol=1e-4)


def test_jit_and_vmap_agree_with_one_by_one():
    masses = jnp.linspace(0.0, 1e-2, 3)
    analysers = eqx.filter_vmap(lambda m: DynamicMechanicalAnalyser(moving_mass=m))(masses)
    batched = eqx.filter_jit(eqx.filter_vmap(total))(analysers)
    single = [total(DynamicMechanicalAnalyser(moving_mass=float(m))) for m in masses]
    np.testing.assert_allclose(batched, single, rtol=1e-12)


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        ({"thickness": 10.0}, "`thickness` is 10 m. Millimetres? Pass m."),
        ({"area": 400.0}, "`area` is 400 m^2. Millimetres? Pass m^2."),
        ({"thickness": 0.0}, "`thickness` must be a finite number above 0 [m], got 0.0"),
        ({"stiffening": np.nan}, "`stiffening` must be a finite number above 0 [1]"),
        ({"moving_mass": -1e-3}, "`moving_mass` must be a finite number not below 0 [kg], got -0.001"),
        ({"bath_damping": -1.0}, "`bath_damping` must be a finite number not below 0 [N s/m]"),
        ({"frame_compliance": -1.0}, "`frame_compliance` must be a finite number not below 0 [m/N]"),
        ({"delay": np.inf}, "`delay` must be a finite number [s]"),
        ({"relative_noise": np.nan}, "`relative_noise` must be a finite number not below 0 [1]"),
    ],
)
def test_impossible_settings(settings, cause):
    with pytest.raises(InputError) as error:
        DynamicMechanicalAnalyser(**settings)
    assert cause in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("modulus", "omega", "cause"),
    [
        (MODULUS, OMEGA[:-1], "`modulus` has shape (12,) for 11 frequencies; its last axis is frequency."),
        (MODULUS, -OMEGA, "`angular_frequency` must be finite and not negative [rad/s]"),
        (MODULUS, np.full(12, np.nan), "`angular_frequency` must be finite"),
    ],
)
def test_impossible_readings(modulus, omega, cause):
    with pytest.raises(InputError) as error:
        DynamicMechanicalAnalyser()(modulus, omega)
    assert cause in str(error.value) and "\n" not in str(error.value)


def test_impossible_block():
    with pytest.raises(InputError, match="`width` must be a finite number above 0"):
        bonded_block_factor(width=0.0, depth=1e-3, thickness=1e-3)


def bonded_disc(radius, thickness, poisson_ratio=0.49999):
    """Apparent over true modulus of a disc by finite elements: one half, above its plane of symmetry."""
    platen = 0.5 * thickness * (1.0 - np.linspace(1.0, 0.0, 5) ** 1.5)
    mesh = Mesh(radius * (1.0 - np.linspace(1.0, 0.0, 9) ** 1.5), platen)
    shape, points = (len(mesh.node_r), len(mesh.node_z), 2), jnp.ones((len(mesh.gauss_r), len(mesh.gauss_z)))
    shear, bulk = 0.5 / (1.0 + poisson_ratio), 1.0 / (3.0 - 6.0 * poisson_ratio)
    stiffness = np.asarray(
        jax.jit(jax.hessian(lambda u: strain_energy(mesh, shear * points, bulk * points, u.reshape(shape))))(
            jnp.zeros(np.prod(shape))
        )
    )
    held, motion = np.zeros(shape, bool), np.zeros(shape)
    held[0, :, 0], held[:, 0, 1], held[:, -1] = True, True, True
    motion[:, -1, 1] = -0.5
    free, motion = ~held.ravel(), motion.ravel()
    motion[free] = np.linalg.solve(stiffness[np.ix_(free, free)], -stiffness[np.ix_(free, ~free)] @ motion[~free])
    return 2.0 * motion @ stiffness @ motion * thickness / (np.pi * radius**2)


@pytest.mark.parametrize(("shape_factor", "error"), [(0.5, -0.03), (1.0, 0.015)])
def test_bonded_disc_by_finite_elements(shape_factor, error):
    """What is claimed of 1 + 2 S^2; on twice as many elements the factor changes by 1e-3."""
    by_elements = bonded_disc(1.0, 0.5 / shape_factor)
    np.testing.assert_allclose((1.0 + 2.0 * shape_factor**2) / by_elements - 1.0, error, atol=2e-3)
