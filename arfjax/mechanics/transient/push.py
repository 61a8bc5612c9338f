r"""Transient response of a viscoelastic solid to a radiation force that is switched on and off, or shaped in time.

Generalised-alpha time integration of

$$ M \ddot u + \int B^T \sigma \, dV = A(t) f , $$

with the memory of each branch advanced by the exact exponential for a strain that is linear within a step. The
effective matrix is the same in every step: it is factorised once, for the motion and for its derivatives. Second order
in the time step, also across the jumps of the force, where the acceleration jumps by $M^{-1} f$.
"""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from arfjax.errors import InputError
from arfjax.mechanics.elements.axisymmetric import load
from arfjax.mechanics.elements.mesh import Mesh, interpolation_weights
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.mechanics.modulation import Modulation
from arfjax.mechanics.transient.march import Loads, Scheme, acceleration, factor_of_a_step, march, prepare
from arfjax.media import Scalar

_NO_POINTS = np.zeros((0, 2))

Amplitude = (
    Float[Array, " time"]
    | Float[np.ndarray, " time"]
    | Float[Array, "step 2"]
    | Float[np.ndarray, "step 2"]
    | Callable[[Float[Array, " time"]], Float[Array, " time"]]
)


class PushSettings(eqx.Module):
    """Steps in time.

    Attributes:
        time_step: [s].
        n_steps: Number of steps; the run ends at `n_steps * time_step`.
        push_duration: The force is on from 0 to here [s]: a whole number of steps, or at least the whole run (as if not
            given).
        modulation: Course of the force over the push, one period of it that begins where the force is weakest; constant
            if not given. Each step has the mean of its time. Its numbers are floats.
        spectral_radius: Of the amplification at high frequencies, from 0 (strongest numerical damping) to 1 (none:
            energy is conserved).
        backend: Of the sparse solves, see `factorise`.
    """

    time_step: float = eqx.field(static=True)
    n_steps: int = eqx.field(static=True)
    push_duration: float = eqx.field(static=True, default=math.inf)
    modulation: Modulation | None = eqx.field(static=True, default=None, kw_only=True)
    spectral_radius: float = eqx.field(static=True, default=0.8)
    backend: str = eqx.field(static=True, default="superlu")

    def __check_init__(self) -> None:
        """Refuse steps that are not positive and a push that ends between two steps."""
        if not (0.0 < self.time_step < math.inf and self.n_steps >= 1 and self.push_duration > 0.0):
            raise InputError(
                "`time_step`, `n_steps` and `push_duration` must be positive, and the first finite, got "
                f"{self.time_step} s, {self.n_steps}, {self.push_duration} s."
            )
        if not 0.0 <= self.spectral_radius <= 1.0:
            raise InputError(f"`spectral_radius` must lie in 0 to 1, got {self.spectral_radius}.")
        if self.modulation is not None and self.n_steps < self.push_duration / self.time_step - 0.5 < math.inf:
            raise InputError(
                f"a modulated push of {self.push_duration} s takes more than {self.n_steps} steps of "
                f"{self.time_step} s: let the run last to its end."
            )
        steps = min(self.push_duration / self.time_step, 1.0 * self.n_steps)
        if steps < self.n_steps and abs(steps - round(steps)) > 1e-6 * steps:
            raise InputError(
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
        return round(min(self.push_duration / self.time_step, self.n_steps))

    @property
    def course(self) -> Float[Array, " step"]:
        """Share of the force's largest that each step has."""
        n_on = self.push_steps
        if self.modulation is None:
            return jnp.asarray(np.arange(self.n_steps) < n_on, dtype=float)
        impulse = self.modulation.impulse(np.linspace(-np.pi, np.pi, n_on + 1))
        return jnp.pad(jnp.diff(impulse) * n_on / (2.0 * np.pi), (0, self.n_steps - n_on))

    @property
    def jumps(self) -> Float[Array, " step"]:
        """By how much that share grows at the start of each step."""
        return jnp.diff(self.course, prepend=0.0)


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
        """Axial displacement [m] on the axis at `z` [m], interpolated quadratically; NaN outside the mesh."""
        weights = interpolation_weights(self.z_edges, jnp.asarray(z, dtype=float)[None])[0]
        return self.axial_displacement_on_axis @ weights


def solve_push(
    mesh: Mesh,
    material: ViscoelasticField,
    axial_force: Float[Array, "rq zq"] | Float[np.ndarray, "rq zq"],
    *,
    settings: PushSettings,
    radial_force: Float[Array, "rq zq"] | Float[np.ndarray, "rq zq"] | None = None,
    amplitude: Amplitude | None = None,
    points: Float[np.ndarray, "point 2"] = _NO_POINTS,
) -> PushResult:
    """Displacement of a solid, at rest at first, that a force pushes.

    Args:
        mesh: Elements and walls; close over it under `jit`.
        material: The solid at the Gauss points `mesh.gauss_r`, `mesh.gauss_z`.
        axial_force: Force density along z at the Gauss points [N/m^3].
        settings: Time step, number of steps, duration of the push, numerical damping.
        radial_force: Force density along r at the Gauss points [N/m^3]; none if not given.
        amplitude: What the force is multiplied by [1]: a function of the times `settings.times`, or its values at these
            times (linear in between), or its values at the start and at the end of each step (then it may jump between
            steps). If not given it is the course of `settings` to its `push_duration` and 0 afterwards.
        points: Positions r, z [m] off the axis at which to give the whole history.

    Raises:
        InputError: if a field does not have the shape of the grid of Gauss points or `amplitude` not that of the times,
            or a point lies outside the mesh.

    Accuracy: second order in the time step, third in the element size (displacement). NaN if the solid is not stable
        (a bulk modulus, relaxation time or density that is not positive, a negative shear modulus, branches that
        together make energy).
    Differentiability: in the material, the force and the amplitude, forward and reverse. A gradient takes one march
        backward in time with the factors of the march forward. Memory in reverse mode: five numbers for each node
        displacement and step, and the state at the Gauss points about 2 sqrt(steps) times.
    Source: Chung & Hulbert, J. Appl. Mech. 60 (1993) 371 (generalised-alpha); Taylor, Pister & Goudreau, Int. J. Numer.
        Meth. Engng 2 (1970) 45 (recursion for the memory variables).
    """
    mesh.require_inside(points)
    radial = jnp.zeros_like(axial_force) if radial_force is None else radial_force
    force = jnp.asarray(mesh.free, dtype=float) * load(
        mesh, mesh.element_values(axial_force), mesh.element_values(radial)
    )
    force = _nan_unless_stable(material) * force.transpose(2, 0, 1)
    scheme = Scheme(settings.time_step, settings.spectral_radius)
    solid = prepare(mesh, material, settings.time_step)
    ends = _ends_of_steps(amplitude, settings)
    in_balance = scheme.old_stress * ends[:, 0] + (1.0 - scheme.old_stress) * ends[:, 1]
    jumps = ends[:, 0] - jnp.concatenate([jnp.zeros_like(ends[:1, 1]), ends[:-1, 1]])
    loads = Loads(in_balance[:, None, None, None] * force[None], jumps, acceleration(mesh, solid, force))
    factor = factor_of_a_step(mesh, scheme, material, backend=settings.backend)
    changes = march(mesh, scheme, solid, factor, loads)
    return _result(mesh, settings, changes, _final_velocity(scheme, loads, changes), points)


def _nan_unless_stable(material: ViscoelasticField) -> Float[Array, ""]:
    solid = jax.lax.stop_gradient(material)
    stable = [jnp.all(field > 0.0) for field in (solid.density, solid.bulk_modulus, solid.relaxation_times)]
    stable.append(jnp.all(solid.relaxed_shear_modulus >= 0.0))
    stable.append(_never_makes_energy(solid.branch_shear_moduli, solid.relaxation_times))
    return jnp.where(jnp.all(jnp.stack(stable)), 1.0, jnp.nan)


def _never_makes_energy(moduli: Float[Array, "branch rq zq"], times: Float[Array, "branch rq zq"]) -> Bool[Array, ""]:
    """Whether the loss modulus is nowhere negative at any branch's relaxation frequency, nor far below or above all.

    A branch alone may be negative: one of the pair that stands for a viscosity is.
    """

    def lossy(time: Float[Array, "rq zq"]) -> Bool[Array, ""]:
        turn = times / time[None]
        return jnp.all(jnp.sum(moduli * turn / (1.0 + turn**2), axis=0) >= 0.0)

    at_the_ends = [jnp.all(jnp.sum(each, axis=0) >= 0.0) for each in (moduli * times, moduli / times)]
    return jnp.all(jax.lax.map(lossy, times)) & at_the_ends[0] & at_the_ends[1]


def _ends_of_steps(amplitude: Amplitude | None, settings: PushSettings) -> Float[Array, "step 2"]:
    """Amplitude at the start and at the end of each step."""
    n_steps = settings.n_steps
    if amplitude is not None and settings.modulation is not None:
        raise InputError("the force has a course by `amplitude` and another by `settings.modulation`: give one.")
    if amplitude is None:
        return jnp.stack([settings.course, settings.course], axis=1)
    values = amplitude(jnp.asarray(settings.times, dtype=float)) if callable(amplitude) else jnp.asarray(amplitude)
    if values.shape == (n_steps + 1,):
        return jnp.stack([values[:-1], values[1:]], axis=1)
    if values.shape == (n_steps, 2):
        return values
    raise InputError(
        f"`amplitude` must have one value at each of the {n_steps + 1} times of `settings.times`, or two for each of "
        f"the {n_steps} steps, got shape {values.shape}."
    )


def _final_velocity(
    scheme: Scheme, loads: Loads, changes: Float[Array, "step 2 row column"]
) -> Float[Array, "2 row column"]:
    # The velocity is a sum over the changes of displacement, and over the jumps, with weights that are known.
    matrix, gain = scheme.update()
    of_changes, of_jumps, later = [], [], np.array([1.0, 0.0])
    for _ in range(len(changes)):
        of_changes.append(later @ gain)
        later = later @ matrix
        of_jumps.append(later[1])
    weights = jnp.asarray(np.array(of_changes[::-1]), changes.dtype)
    struck = jnp.dot(jnp.asarray(np.array(of_jumps[::-1]), changes.dtype), loads.jumps)
    return jnp.tensordot(weights, changes, axes=1) + struck * loads.jump


def _result(
    mesh: Mesh,
    settings: PushSettings,
    changes: Float[Array, "step 2 row column"],
    velocity: Float[Array, "2 row column"],
    points: Float[np.ndarray, "point 2"],
) -> PushResult:
    weights_r = interpolation_weights(mesh.r_edges, points[:, 0])
    weights_z = interpolation_weights(mesh.z_edges, points[:, 1])
    at_points = jnp.einsum("pz,pr,tczr->tpc", weights_z, weights_r, changes)
    return PushResult(
        time=jnp.asarray(settings.times, dtype=float),
        z=jnp.asarray(mesh.node_z, dtype=float),
        axial_displacement_on_axis=_from_rest(changes[:, 1, :, 0]),
        displacement_at_points=_from_rest(at_points),
        displacement=jnp.sum(changes, axis=0).transpose(2, 1, 0),
        velocity=velocity.transpose(2, 1, 0),
        z_edges=jnp.asarray(mesh.z_edges, dtype=float),
    )


def _from_rest(changes: Float[Array, "step *rest"]) -> Float[Array, "time *rest"]:
    return jnp.concatenate([jnp.zeros_like(changes[:1]), jnp.cumsum(changes, axis=0)])
