r"""The march in time, and its derivatives.

Unknown is the change of displacement in each step, $\delta_n = u_{n+1} - u_n$. All steps together are one linear
system, whose rows are the balance of each step,

$$ R_n(\delta_0, \dots, \delta_n) = b_n , $$

which the march solves step by step with the factors of the one matrix on its diagonal. Its derivatives are those of
the system: a change of the solid or of the force changes the balance at the motion as it is, which takes no solve, and
the same march, forward or backward in time, turns that into a change of motion.
"""

import functools
import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.mechanics.elements.axisymmetric import deviatoric_stiffness, mass_matrices, volumetric_stiffness
from arfjax.mechanics.elements.gauss_points import (
    AtPoints,
    Nodal,
    Volumetric,
    at_points,
    deviatoric_stress,
    kinematics,
    nodal_force,
    nodal_mass,
    volumes,
    volumetric,
)
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.elements.pattern import displacement_pattern
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.numerics.decay import mean_decay
from arfjax.numerics.sparse_direct import Factor, Pattern, factorise, solve

History = Float[Array, "step 2 row column"]


class Scheme(eqx.Module):
    """Constants of the generalised-alpha method: the balance is taken at weighted means of a step's two ends."""

    time_step: float = eqx.field(static=True)
    spectral_radius: float = eqx.field(static=True)

    @property
    def old_inertia(self) -> float:
        """alpha_m: share of the inertia at the start of the step."""
        return (2.0 * self.spectral_radius - 1.0) / (self.spectral_radius + 1.0)

    @property
    def old_stress(self) -> float:
        """alpha_f: share of stress and force at the start of the step."""
        return self.spectral_radius / (self.spectral_radius + 1.0)

    @property
    def velocity_gain(self) -> float:
        """Newmark's gamma times the time step [s]."""
        return (0.5 - self.old_inertia + self.old_stress) * self.time_step

    @property
    def displacement_gain(self) -> float:
        """Newmark's beta times the time step squared [s^2]."""
        return (0.5 * (1.0 - self.old_inertia + self.old_stress) * self.time_step) ** 2

    def update(self) -> tuple[Float[np.ndarray, "2 2"], Float[np.ndarray, " 2"]]:
        """Velocity and acceleration at the end of a step, from those at its start and from the change of displacement.

        With both in one vector: the first matrix times that at the start, plus the second times the change.
        """
        per_change = 1.0 / self.displacement_gain
        half_square = 0.5 * self.time_step**2 - self.displacement_gain
        acceleration = -per_change * np.array([self.time_step, half_square])
        velocity = np.array([1.0, self.time_step - self.velocity_gain]) + self.velocity_gain * acceleration
        return np.stack([velocity, acceleration]), per_change * np.array([self.velocity_gain, 1.0])


class PreparedSolid(eqx.Module):
    """The solid at the Gauss points, everything times the volume of the point.

    In a step the stress that a branch holds is multiplied by `decay` and grows by `gain` times the change of shape.
    """

    inertia: AtPoints
    relaxed: AtPoints
    gain: Float[Array, "branch 9 ez er"]
    decay: Float[Array, "branch 9 ez er"]
    volume: Volumetric


def prepare(mesh: Mesh, material: ViscoelasticField, time_step: float) -> PreparedSolid:
    """The solid of a march with that time step [s]."""
    at_branches = jax.vmap(functools.partial(at_points, mesh))
    volume = volumes(mesh)
    decrement = time_step / at_branches(material.relaxation_times)
    kept = mean_decay(decrement)
    return PreparedSolid(
        inertia=volume * at_points(mesh, material.density),
        relaxed=2.0 * volume * at_points(mesh, material.relaxed_shear_modulus),
        gain=2.0 * volume[None] * kept * at_branches(material.branch_shear_moduli),
        decay=jnp.exp(-decrement),
        volume=volumetric(mesh, at_points(mesh, material.bulk_modulus)),
    )


class _State(eqx.Module):
    """Velocity, acceleration, stresses 2 G d and moments of the dilatation at the Gauss points."""

    rates: Float[Array, "2 9 2 ez er"]
    relaxed: Float[Array, "3 9 ez er"]
    branches: Float[Array, "branch 3 9 ez er"]
    moments: Float[Array, "3 ez er"]


def _at_rest(solid: PreparedSolid) -> _State:
    _, *elements = solid.inertia.shape
    n_branches, dtype = len(solid.gain), solid.inertia.dtype
    return _State(
        jnp.zeros((2, 9, 2, *elements), dtype),
        jnp.zeros((3, 9, *elements), dtype),
        jnp.zeros((n_branches, 3, 9, *elements), dtype),
        jnp.zeros((3, *elements), dtype),
    )


def _struck(state: _State, acceleration: Float[Array, "9 2 ez er"]) -> _State:
    return eqx.tree_at(lambda s: s.rates, state, state.rates.at[1].add(acceleration))


def _advanced(mesh: Mesh, scheme: Scheme, solid: PreparedSolid, state: _State, change: Nodal) -> _State:
    moved = kinematics(mesh, change)
    matrix, gain = scheme.update()
    velocity, acceleration = state.rates
    rates = [m[0] * velocity + m[1] * acceleration + g * moved.motion for m, g in zip(matrix, gain, strict=True)]
    return _State(
        jnp.stack(rates),
        state.relaxed + solid.relaxed[None] * moved.shape,
        solid.decay[:, None] * state.branches + solid.gain[:, None] * moved.shape[None],
        state.moments + solid.volume.of(moved.dilatation),
    )


def _balance(mesh: Mesh, scheme: Scheme, solid: PreparedSolid, old: _State, new: _State) -> Nodal:
    """Inertia and internal force of a step with these two ends."""
    old_inertia, old_stress = scheme.old_inertia, scheme.old_stress
    momentum = solid.inertia[:, None] * ((1.0 - old_inertia) * new.rates[1] + old_inertia * old.rates[1])
    stress = (1.0 - old_stress) * (new.relaxed + jnp.sum(new.branches, axis=0))
    stress = stress + old_stress * (old.relaxed + jnp.sum(old.branches, axis=0))
    pressure = solid.volume.pressure((1.0 - old_stress) * new.moments + old_stress * old.moments)
    return _free(mesh) * nodal_force(mesh, deviatoric_stress(stress), pressure, momentum)


def _unmoved(scheme: Scheme, solid: PreparedSolid, state: _State) -> _State:
    # The end of a step in which nothing moves.
    (_, per_rate), _ = scheme.update()
    acceleration = per_rate[0] * state.rates[0] + per_rate[1] * state.rates[1]
    rates = jnp.stack([state.rates[0], acceleration])
    return _State(rates, state.relaxed, solid.decay[:, None] * state.branches, state.moments)


def _free(mesh: Mesh) -> Nodal:
    return jnp.asarray(mesh.free.transpose(2, 0, 1), dtype=float)


class Loads(eqx.Module):
    """What moves the solid.

    Attributes:
        balance: Force at the nodes in the balance of each step [N]; zero where nodes are held.
        jumps: How often the jump of acceleration occurs before each step.
        jump: Jump of acceleration of the nodes [m/s^2].
    """

    balance: History
    jumps: Float[Array, " step"]
    jump: Nodal


def march(mesh: Mesh, scheme: Scheme, solid: PreparedSolid, factor: Factor, loads: Loads) -> History:
    """Change of displacement [m] of the nodes in each step of a solid at rest at first.

    Args:
        mesh: Elements and walls.
        scheme: Of the integration in time.
        solid: The solid.
        factor: Factors of `matrix_of_a_step` of that solid; no derivative flows through them.
        loads: What moves it.

    Differentiability: forward and reverse, any number of times, in solid and loads. Memory in reverse mode: four
        histories (step, node), and the state at the Gauss points about 2 sqrt(step) times.
    """

    @jax.custom_jvp
    def solved(solid: PreparedSolid, factor: Factor, loads: Loads) -> History:
        return _steps(mesh, scheme, solid, factor, loads)

    @solved.defjvp
    def _derivative(primals: tuple, tangents: tuple) -> tuple[History, History]:
        solid, factor, loads = primals
        solid_change, _, loads_change = tangents
        changes = solved(solid, factor, loads)

        def imbalance(solid: PreparedSolid, loads: Loads) -> History:
            return loads.balance - _residual(mesh, scheme, solid, loads, changes)

        missing = jax.jvp(imbalance, (solid, loads), (solid_change, loads_change))[1]
        return changes, _linear_march(mesh, scheme, solid, factor, missing)

    return solved(solid, factor, loads)


def _steps(mesh: Mesh, scheme: Scheme, solid: PreparedSolid, factor: Factor, loads: Loads) -> History:
    jump = kinematics(mesh, loads.jump).motion

    def step(state: _State, load: tuple[Array, Array]) -> tuple[_State, Array]:
        force, times = load
        state = _struck(state, times * jump)
        missing = force - _balance(mesh, scheme, solid, state, _unmoved(scheme, solid, state))
        change = solve(factor, missing.ravel()).reshape(missing.shape)
        return _advanced(mesh, scheme, solid, state, change), change

    return jax.lax.scan(step, _at_rest(solid), (loads.balance, loads.jumps))[1]


def _linear_march(mesh: Mesh, scheme: Scheme, solid: PreparedSolid, factor: Factor, balance: History) -> History:
    """The motion that these forces in the balance of the steps cause.

    What a motion in one step does to the balance of a later one depends on the steps between them alone, by a symmetric
    matrix. So the whole system is symmetric once its rows are taken backward in time, and its transpose is the same
    march. Held nodes have neither row nor column in it: in reverse mode what is asked of them is left out, as nothing
    moves them.
    """

    def without_jumps(history: History) -> Loads:
        return Loads(history, jnp.zeros(len(history), history.dtype), jnp.zeros_like(history[0]))

    def backward_rows(changes: History) -> History:
        return _residual(mesh, scheme, solid, without_jumps(changes), changes)[::-1]

    def forward(_: Callable, forces: History) -> History:
        return _steps(mesh, scheme, solid, factor, without_jumps(_free(mesh)[None] * forces[::-1]))

    return jax.lax.custom_linear_solve(backward_rows, balance[::-1], forward, symmetric=True)


def _residual(mesh: Mesh, scheme: Scheme, solid: PreparedSolid, loads: Loads, changes: History) -> History:
    """Inertia and internal force in the balance of every step of a given motion.

    Steps are taken in segments, whose states are computed again in reverse mode.
    """
    n_steps = len(changes)
    length = math.isqrt(max(n_steps - 1, 0)) + 1
    n_segments = -(-n_steps // length)
    jump = kinematics(mesh, loads.jump).motion

    def step(state: _State, given: tuple[Array, Array]) -> tuple[_State, Nodal]:
        change, times = given
        state = _struck(state, times * jump)
        new = _advanced(mesh, scheme, solid, state, change)
        return new, _balance(mesh, scheme, solid, state, new)

    @jax.checkpoint
    def segment(state: _State, given: tuple[Array, Array]) -> tuple[_State, History]:
        return jax.lax.scan(step, state, given)

    def split(history: Array) -> Array:
        missing = [(0, n_segments * length - n_steps)] + [(0, 0)] * (history.ndim - 1)
        return jnp.pad(history, missing).reshape(n_segments, length, *history.shape[1:])

    _, rows = jax.lax.scan(segment, _at_rest(solid), (split(changes), split(loads.jumps)))
    return rows.reshape(n_segments * length, *changes.shape[1:])[:n_steps]


def matrix_of_a_step(
    mesh: Mesh, scheme: Scheme, material: ViscoelasticField, pattern: Pattern
) -> Float[Array, " entry"]:
    """What multiplies the change of displacement in the balance of a step [N/m]."""
    at_elements = mesh.element_values
    kept = mean_decay(scheme.time_step / material.relaxation_times)
    shear = material.relaxed_shear_modulus + jnp.sum(kept * material.branch_shear_moduli, axis=0)
    stiffness = deviatoric_stiffness(mesh, at_elements(shear)) + volumetric_stiffness(
        mesh, at_elements(material.bulk_modulus)
    )
    mass = mass_matrices(mesh, at_elements(material.density))
    both = jnp.einsum("zrij,cd->zricjd", mass, jnp.eye(2, dtype=mass.dtype)).reshape(stiffness.shape)
    inertia = (1.0 - scheme.old_inertia) / scheme.displacement_gain
    total = inertia * both + (1.0 - scheme.old_stress) * stiffness
    return pattern.assemble(total.reshape(-1, *total.shape[2:]))


def factor_of_a_step(mesh: Mesh, scheme: Scheme, material: ViscoelasticField, *, backend: str = "superlu") -> Factor:
    """Factors for `march`."""
    pattern = displacement_pattern(mesh)
    material = jax.lax.stop_gradient(material)
    return factorise(pattern, matrix_of_a_step(mesh, scheme, material, pattern), backend=backend)


def acceleration(mesh: Mesh, solid: PreparedSolid, force: Nodal) -> Nodal:
    """Acceleration [m/s^2] of the nodes by a force [N], by conjugate gradients on the scaled mass matrix.

    Biquadratic elements have a mass matrix whose condition, scaled to a unit diagonal, does not depend on the mesh: 40
    iterations reach the rounding error.
    """
    free = _free(mesh)
    scale = jax.lax.rsqrt(jax.lax.stop_gradient(nodal_mass(mesh, solid.inertia)))
    no_stress, no_pressure = jnp.zeros((3, *solid.inertia.shape), force.dtype), jnp.zeros_like(solid.inertia)

    def scaled_mass(scaled: Nodal) -> Nodal:
        motion = kinematics(mesh, free * scale * scaled).motion
        return (
            free * scale * nodal_force(mesh, no_stress, no_pressure, solid.inertia[:, None] * motion)
            + (1.0 - free) * scaled
        )

    tolerance = 10.0 * float(jnp.finfo(force.dtype).eps)
    scaled, _ = jax.scipy.sparse.linalg.cg(scaled_mass, free * scale * force, tol=tolerance, maxiter=100)
    return scale * scaled
