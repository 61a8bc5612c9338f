r"""Transient response of a viscoelastic solid to a radiation force that is switched on and off.

Generalised-alpha time integration of

$$ M \ddot u + \int B^T \sigma \, dV = f(t) , $$

with the memory of each branch advanced by the exact exponential for a strain that is linear within a step. The
effective matrix is the same in every step: it is factorised once. Second order in the time step, also across the
jumps of the force, where the acceleration jumps by $M^{-1} f$.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.mechanics.axisymmetric import (
    STRESS_OVER_STRAIN,
    deviator,
    deviatoric_stiffness,
    internal_force,
    load,
    mass_matrices,
    strains,
    volumetric_stiffness,
)
from arfjax.mechanics.mesh import Mesh, interpolation_weights
from arfjax.mechanics.viscoelastic import ViscoelasticField
from arfjax.media import Scalar
from arfjax.numerics.assembly import apply_elements, assemble, constrain, from_blocks, gather, to_blocks
from arfjax.numerics.block_tridiagonal import factorise, solve

_NO_POINTS = np.zeros((0, 2))


class PushSettings(eqx.Module):
    """Steps in time.

    Attributes:
        time_step: [s].
        n_steps: Number of steps; the run ends at `n_steps * time_step`.
        push_duration: The force is on from 0 to here [s]: a whole number of steps, or at least the whole run.
        spectral_radius: Of the amplification at high frequencies, from 0 (strongest numerical damping) to 1 (none:
            energy is conserved).
    """

    time_step: float = eqx.field(static=True)
    n_steps: int = eqx.field(static=True)
    push_duration: float = eqx.field(static=True)
    spectral_radius: float = eqx.field(static=True, default=0.8)

    def __check_init__(self) -> None:
        """Refuse steps that are not positive and a push that ends between two steps."""
        if self.time_step <= 0.0 or self.n_steps < 1 or self.push_duration <= 0.0:
            raise ValueError(
                "`time_step`, `n_steps` and `push_duration` must be positive, got "
                f"{self.time_step} s, {self.n_steps}, {self.push_duration} s."
            )
        if not 0.0 <= self.spectral_radius <= 1.0:
            raise ValueError(f"`spectral_radius` must lie in 0 to 1, got {self.spectral_radius}.")
        steps = self.push_duration / self.time_step
        if round(steps) < self.n_steps and abs(steps - round(steps)) > 1e-6 * steps:
            raise ValueError(
                f"`push_duration` {self.push_duration} s is {steps:g} steps of {self.time_step} s: the end of the push "
                "must fall on a step. Take a time step that divides it."
            )

    @property
    def times(self) -> Float[np.ndarray, " time"]:
        """Times [s] of the results, from 0."""
        return self.time_step * np.arange(self.n_steps + 1)

    @property
    def push_steps(self) -> int:
        """Number of steps during which the force is on."""
        return min(round(self.push_duration / self.time_step), self.n_steps)


class PushResult(eqx.Module):
    """Motion during and after a push.

    Attributes:
        time: [s], the first is 0.
        z: Axial positions [m] of the nodes on the axis.
        axial_displacement_on_axis: [m]; the first is zero.
        displacement_at_points: Displacement r, z [m] at the points asked for; the first is zero.
        displacement: Displacement r, z [m] of all nodes at the end.
        velocity: Velocity r, z [m/s] of all nodes at the end.
        z_edges: Axial element edges [m].
    """

    time: Float[Array, " time"]
    z: Float[Array, " z"]
    axial_displacement_on_axis: Float[Array, "time z"]
    displacement_at_points: Float[Array, "time point 2"]
    displacement: Float[Array, "r z 2"]
    velocity: Float[Array, "r z 2"]
    z_edges: Float[Array, " n_z_edges"]

    def at_focus(self, z: Scalar) -> Float[Array, " time"]:
        """Axial displacement [m] on the axis at `z` [m], interpolated quadratically inside the element."""
        weights = interpolation_weights(self.z_edges, jnp.asarray(z, dtype=float)[None])[0]
        return self.axial_displacement_on_axis @ weights


def solve_push(
    mesh: Mesh,
    material: ViscoelasticField,
    axial_force: Float[Array, "rq zq"] | Float[np.ndarray, "rq zq"],
    *,
    settings: PushSettings,
    radial_force: Float[Array, "rq zq"] | Float[np.ndarray, "rq zq"] | None = None,
    points: Float[np.ndarray, "point 2"] = _NO_POINTS,
) -> PushResult:
    """Displacement of a solid, at rest at first, that a force pushes from time 0 to the end of the push.

    Args:
        mesh: Elements and walls.
        material: The solid at the Gauss points `mesh.gauss_r`, `mesh.gauss_z`.
        axial_force: Force density along z at the Gauss points [N/m^3].
        settings: Time step, number of steps, duration of the push, numerical damping.
        radial_force: Force density along r at the Gauss points [N/m^3]; none if not given.
        points: Positions r, z [m] off the axis at which to give the whole history.

    Raises:
        ValueError: if a field does not have the shape of the grid of Gauss points.

    Accuracy: second order in the time step, third in the element size (displacement). NaN if the solid is not stable
        (a negative modulus or density).
    Differentiability: in the material and the force, forward and reverse; memory in reverse mode is the state (motion
        and memory variables) once a step.
    Source: Chung & Hulbert, J. Appl. Mech. 60 (1993) 371 (generalised-alpha); Taylor, Pister & Goudreau, Int. J. Numer.
        Meth. Engng 2 (1970) 45 (recursion for the memory variables).
    """
    radial = jnp.zeros_like(axial_force) if radial_force is None else radial_force
    force = jnp.asarray(mesh.free, dtype=float) * load(
        mesh, mesh.element_values(axial_force), mesh.element_values(radial)
    )
    observe = _Observer(
        interpolation_weights(mesh.r_edges, points[:, 0]), interpolation_weights(mesh.z_edges, points[:, 1])
    )
    final, (axis, at_points) = _march(_prepare(mesh, material, settings.time_step), force, settings, observe)
    return PushResult(
        time=jnp.asarray(settings.times, dtype=float),
        z=jnp.asarray(mesh.node_z, dtype=float),
        axial_displacement_on_axis=axis,
        displacement_at_points=at_points,
        displacement=final.displacement.transpose(1, 0, 2),
        velocity=final.velocity.transpose(1, 0, 2),
        z_edges=jnp.asarray(mesh.z_edges, dtype=float),
    )


class _Scheme(eqx.Module):
    """Constants of the generalised-alpha method: the balance is taken at weighted means of a step's two ends."""

    time_step: float = eqx.field(static=True)
    spectral_radius: float = eqx.field(static=True)

    @property
    def old_inertia(self) -> float:
        """alpha_m: share of the inertia at the start of the step."""
        return (2.0 * self.spectral_radius - 1.0) / (self.spectral_radius + 1.0)

    @property
    def old_stress(self) -> float:
        """alpha_f: share of the internal force at the start of the step."""
        return self.spectral_radius / (self.spectral_radius + 1.0)

    @property
    def velocity_gain(self) -> float:
        """Newmark's gamma times the time step [s]."""
        return (0.5 - self.old_inertia + self.old_stress) * self.time_step

    @property
    def displacement_gain(self) -> float:
        """Newmark's beta times the time step squared [s^2]."""
        return (0.5 * (1.0 - self.old_inertia + self.old_stress) * self.time_step) ** 2


class _Solid(eqx.Module):
    """Element matrices and branches, sorted by elements.

    A time step multiplies what a branch remembers by `decay`, and adds `gain` times the change of strain.
    `branch_stiffness` is what all branches add to the stiffness against that change.
    """

    mesh: Mesh
    mass: Float[Array, "ez er 9 9"]
    relaxed_stiffness: Float[Array, "ez er 18 18"]
    branch_stiffness: Float[Array, "ez er 18 18"]
    branch_moduli: Float[Array, "branch ez er 9"]
    decay: Float[Array, "branch ez er 9"]
    gain: Float[Array, "branch ez er 9"]


class _State(eqx.Module):
    """Motion of the nodes, and the strain that each branch remembers at each Gauss point."""

    displacement: Float[Array, "row column 2"]
    velocity: Float[Array, "row column 2"]
    acceleration: Float[Array, "row column 2"]
    memory: Float[Array, "branch ez er 9 4"]


class _Observer(eqx.Module):
    """What is kept of every step."""

    weights_r: Float[Array, "point column"]
    weights_z: Float[Array, "point row"]

    def __call__(self, displacement: Float[Array, "row column 2"]) -> tuple[Array, Array]:
        """Axial displacement on the axis, and displacement at the points."""
        at_points = jnp.einsum("pz,pr,zrc->pc", self.weights_z, self.weights_r, displacement)
        return displacement[:, 0, 1], at_points


def _prepare(mesh: Mesh, material: ViscoelasticField, time_step: float) -> _Solid:
    at_elements = mesh.element_values
    branch_moduli = jax.vmap(at_elements)(material.branch_shear_moduli)
    decrement = time_step / jax.vmap(at_elements)(material.relaxation_times)
    gain = -jnp.expm1(-decrement) / decrement
    relaxed = deviatoric_stiffness(mesh, at_elements(material.relaxed_shear_modulus))
    return _Solid(
        mesh=mesh,
        mass=mass_matrices(mesh, at_elements(material.density)),
        relaxed_stiffness=relaxed + volumetric_stiffness(mesh, at_elements(material.bulk_modulus)),
        branch_stiffness=deviatoric_stiffness(mesh, jnp.sum(gain * branch_moduli, axis=0)),
        branch_moduli=branch_moduli,
        decay=jnp.exp(-decrement),
        gain=gain,
    )


def _march(
    solid: _Solid, force: Float[Array, "row column 2"], settings: PushSettings, observe: _Observer
) -> tuple[_State, tuple[Array, Array]]:
    scheme = _Scheme(settings.time_step, settings.spectral_radius)
    free = jnp.asarray(solid.mesh.free, dtype=force.dtype)
    effective = constrain(assemble(_effective_matrices(solid, scheme)), to_blocks(free))
    factor = factorise(effective)
    mass = constrain(assemble(_for_both_components(solid.mass)), to_blocks(free))
    jump = from_blocks(solve(mass, factorise(mass), to_blocks(force)), 2)
    on = np.arange(settings.n_steps) < settings.push_steps
    released = np.arange(settings.n_steps) == settings.push_steps

    def step(state: _State, switches: tuple[Array, Array]) -> tuple[_State, tuple[Array, Array]]:
        pushed, let_go = switches
        state = eqx.tree_at(lambda s: s.acceleration, state, state.acceleration - let_go * jump)
        right_side = free * (pushed * force - _old_force(solid, scheme, state))
        acceleration = from_blocks(solve(effective, factor, to_blocks(right_side)), 2)
        state = _advance(solid, scheme, state, acceleration)
        return state, observe(state.displacement)

    memory = jnp.zeros((*solid.branch_moduli.shape, 4), force.dtype)
    start = _State(jnp.zeros_like(force), jnp.zeros_like(force), jump, memory)
    switches = (jnp.asarray(on, dtype=force.dtype), jnp.asarray(released, dtype=force.dtype))
    final, history = jax.lax.scan(jax.checkpoint(step, policy=_keep_solutions), start, switches)
    return final, jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), observe(force * 0.0), history)


def _keep_solutions(primitive: object, *_: object, **__: object) -> bool:
    # In reverse mode recompute everything of a step except the linear solve.
    return getattr(primitive, "name", "") == "custom_linear_solve"


def _effective_matrices(solid: _Solid, scheme: _Scheme) -> Float[Array, "ez er 18 18"]:
    """What multiplies the acceleration at the end of a step."""
    stiffness = (1.0 - scheme.old_stress) * (solid.relaxed_stiffness + solid.branch_stiffness)
    return (1.0 - scheme.old_inertia) * _for_both_components(solid.mass) + scheme.displacement_gain * stiffness


def _for_both_components(mass: Float[Array, "ez er 9 9"]) -> Float[Array, "ez er 18 18"]:
    both = jnp.einsum("zrij,cd->zricjd", mass, jnp.eye(2, dtype=mass.dtype))
    return both.reshape(*mass.shape[:2], 18, 18)


def _predicted(scheme: _Scheme, state: _State) -> Float[Array, "row column 2"]:
    """Displacement at the end of a step, were there no acceleration then."""
    half_square = 0.5 * scheme.time_step**2 - scheme.displacement_gain
    return state.displacement + scheme.time_step * state.velocity + half_square * state.acceleration


def _shape_change(mesh: Mesh, displacement: Float[Array, "row column 2"]) -> Float[Array, "ez er 9 4"]:
    return deviator(strains(mesh, gather(displacement)))


def _old_force(solid: _Solid, scheme: _Scheme, state: _State) -> Float[Array, "row column 2"]:
    """The weighted balance of a step without the acceleration at its end: inertia plus internal force."""
    old, new = scheme.old_stress, 1.0 - scheme.old_stress
    predicted = _predicted(scheme, state)
    remembered = jnp.einsum("bzrg,bzrgc->zrgc", solid.branch_moduli * (new * solid.decay + old), state.memory)
    relaxed = apply_elements(solid.relaxed_stiffness, new * predicted + old * state.displacement)
    gained = new * apply_elements(solid.branch_stiffness, predicted - state.displacement)
    inertia = scheme.old_inertia * apply_elements(solid.mass, state.acceleration)
    return inertia + relaxed + gained + internal_force(solid.mesh, remembered * STRESS_OVER_STRAIN[None, None, None, :])


def _advance(solid: _Solid, scheme: _Scheme, state: _State, acceleration: Float[Array, "row column 2"]) -> _State:
    gain = scheme.velocity_gain
    displacement = _predicted(scheme, state) + scheme.displacement_gain * acceleration
    velocity = state.velocity + (scheme.time_step - gain) * state.acceleration + gain * acceleration
    change = _shape_change(solid.mesh, displacement - state.displacement)
    memory = solid.decay[..., None] * state.memory + solid.gain[..., None] * change[None]
    return _State(displacement, velocity, acceleration, memory)
