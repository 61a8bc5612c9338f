"""Kelvin-Voigt solids and sums of exponentials in the march in time, against closed forms."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.mechanics.elements.mesh import Mesh, Wall, Walls
from arfjax.mechanics.material.relaxation_spectrum import kernel_error
from arfjax.mechanics.material.viscoelastic import (
    ShearModulus,
    ViscoelasticField,
    prony_of_fractional_zener,
    prony_of_kelvin_voigt,
    viscoelastic_field,
)
from arfjax.mechanics.transient.push import PushSettings, solve_push
from arfjax.media import FractionalZener, KelvinVoigt, Prony
from tests.checks import assert_order
from tests.mechanics.problems import Reference, gaussian_force, reference_mesh

LENGTH, DENSITY, BULK, SPRING, FORCE = 4e-3, 1000.0, 4e3, 2e3, 1e4
"""Of the column: [m], [kg/m^3], [Pa], [Pa], [N/m^3]."""
END = 8e-3


def column() -> Mesh:
    """A column that slides along a rigid tube between two plates: it moves along z alone."""
    slides = Wall.SLIDING
    return Mesh(np.array([0.0, 1e-3, 2e-3]), np.linspace(0.0, LENGTH, 9), Walls(slides, slides, slides))


def oscillator(viscosity: float, times: np.ndarray) -> np.ndarray:
    r"""Middle of the column under the force $F \sin(\pi z / L)$ from t = 0 on: one mode, uniaxial strain.

    $$ \rho \ddot q + \frac{4}{3} \eta k^2 \dot q + (K + \frac{4}{3} G_0) k^2 q = F, \quad k = \pi / L . $$
    """
    square = (np.pi / LENGTH) ** 2
    stiffness = (BULK + 4.0 / 3.0 * SPRING) * square / DENSITY
    damping = 0.5 * 4.0 / 3.0 * viscosity * square / DENSITY
    frequency = np.sqrt(complex(stiffness - damping**2))  # imaginary where the motion creeps
    decay = np.exp(-damping * times)
    moved = 1.0 - decay * (np.cos(frequency * times) + damping / frequency * np.sin(frequency * times))
    return FORCE / (DENSITY * stiffness) * moved.real


def field_of(prony: Prony, mesh: Mesh) -> ViscoelasticField:
    shape = (len(mesh.gauss_r), len(mesh.gauss_z))
    return viscoelastic_field(
        prony, shape, density=DENSITY, bulk_modulus=BULK, reading=ShearModulus(), poisson_ratio=0.3
    )


@functools.cache
def column_errors(viscosity: float) -> list[float]:
    """Largest error over the largest displacement with 80, 160 and 320 steps, the fast pair as short as a step."""
    mesh, errors = column(), []
    force = FORCE * np.broadcast_to(np.sin(np.pi * mesh.gauss_z / LENGTH), (len(mesh.gauss_r), len(mesh.gauss_z)))
    for n_steps in (80, 160, 320):
        settings = PushSettings(END / n_steps, n_steps)
        material = field_of(prony_of_kelvin_voigt(KelvinVoigt(SPRING, viscosity), shortest_time=END / n_steps), mesh)
        result = jax.jit(lambda m, s=settings: solve_push(mesh, m, force, settings=s))(material)
        exact = oscillator(viscosity, settings.times)
        difference = np.asarray(result.at_focus(0.5 * LENGTH)) - exact
        errors.append(float(np.max(np.abs(difference)) / np.max(np.abs(exact))))
    return errors


@pytest.mark.parametrize("viscosity", [0.5, 10.0])
def test_a_column_swings_or_creeps_as_its_mode_does(viscosity):
    """Below critical damping and above it.

    Both the march and the pair that stands for the viscosity are second order for a smooth force. Here it jumps, and
    the pair, whose relaxation time is a step, builds its stress up over some steps: 1.5 is what can be claimed.
    """
    errors = column_errors(viscosity)
    assert_order([4.0, 2.0, 1.0], errors, order=1.5)
    assert errors[-1] < 5e-3


def test_branches_that_make_energy_are_told_from_those_of_a_viscosity():
    mesh, times = column(), jnp.array([1e-4, 2e-4])
    force, settings = np.ones((len(mesh.gauss_r), len(mesh.gauss_z))), PushSettings(1e-4, 2)
    solve = jax.jit(lambda m: solve_push(mesh, m, force, settings=settings).displacement)
    pair = prony_of_kelvin_voigt(KelvinVoigt(SPRING, 0.5), shortest_time=1e-4)
    assert np.all(np.isfinite(solve(field_of(pair, mesh))))
    # Loss is negative at a relaxation time; only far below both, where it goes with the sum of modulus times time; only
    # far above both, where it goes with the sum of modulus over time.
    for moduli in ([-100.0, 50.0], [100.0, -60.0], [-60.0, 100.0]):
        gains = Prony(SPRING, jnp.array(moduli), times)
        assert np.all(np.isnan(solve(field_of(gains, mesh))[1:-1, 1:-1, 1])), moduli


@pytest.mark.slow
def test_share_of_the_kernel_in_the_error_of_a_push():
    """Of the stored fractional solid: 24 exponentials stand within 1e-4 of the kernel, and of 40 in the motion."""
    reference, mesh = Reference("fzener"), reference_mesh(0.3e-3, 1.5e-3)
    c = reference.constants
    solid = FractionalZener(c["G0"], c["G0"] + c["dG"], c["tau"], c["beta"])
    force, settings = gaussian_force(mesh, c["F0"], c["a"], c["b"]), PushSettings(5e-5, 20, c["push"])
    shape = (len(mesh.gauss_r), len(mesh.gauss_z))

    def motion(n_branches: int) -> np.ndarray:
        material = viscoelastic_field(
            prony_of_fractional_zener(solid, n_branches=n_branches),
            shape,
            density=c["rho"],
            bulk_modulus=c["K"],
            reading=ShearModulus(),
            poisson_ratio=0.5,
        )
        return np.asarray(jax.jit(lambda m: solve_push(mesh, m, force, settings=settings).displacement)(material))

    best = motion(40)
    shares = {n: float(np.max(np.abs(motion(n) - best)) / np.max(np.abs(best))) for n in (16, 24)}
    assert kernel_error(c["beta"], 24, (1e-2, 1e2)) < 1e-4
    assert all(share < 1e-4 for share in shares.values()), shares
    assert shares[24] < shares[16], shares
