r"""A push with the motion restricted to a few shapes, and the inclusion known at a few points.

With displacement $u = \sum_i q_i \phi_i$ the march of `arfjax.mechanics.transient` becomes one for the amplitudes q.
The surroundings are uniform, so that their stiffness is a number times a matrix that is known beforehand. What an
inclusion adds to it is summed over selected points with weights,

$$ \phi_i^T K \phi_j = 2 G D_{ij} + K E_{ij}
   + \sum_p w_p \left[ 2 (G_p - G) \, d_i \cdot d_j + (K_p - K) \, \theta_i \theta_j \right]_p , $$

with the change of shape d and the dilatation $\theta$ (its linear part in each element, as the condensed pressure) of
the shapes. The memory of the inclusion's branches is kept at the points, so that any solid may be there.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.mechanics.transient.march import Scheme
from arfjax.mechanics.transient.push import PushSettings
from arfjax.numerics.decay import mean_decay


class ReducedSolid(eqx.Module):
    """Shapes of motion, and the points at which an inclusion is looked at.

    Attributes:
        mass: Of a unit density [m^3].
        deviatoric: Stiffness over twice the shear modulus of a uniform solid [m].
        beside_points: What of the deviatoric stiffness the points do not have [m].
        volumetric: Stiffness over the bulk modulus of a uniform solid [m].
        shape: Change of shape of each unit of amplitude at the points, each component times the square root of its part
            in the energy and of the point's weight [m^(1/2)].
        shape_pairs: Sum over components of the products of the shapes' changes of shape, pair by pair (i <= j) [m].
        dilatation_pairs: Products of their dilatations likewise [m].
        at_focus: Axial displacement at the focus of each unit of amplitude [1].
        r: Radii of the points [m].
        z: Axial positions of the points [m].
    """

    mass: Float[Array, "mode mode"]
    deviatoric: Float[Array, "mode mode"]
    beside_points: Float[Array, "mode mode"]
    volumetric: Float[Array, "mode mode"]
    shape: Float[Array, "3 point mode"]
    shape_pairs: Float[Array, "point pair"]
    dilatation_pairs: Float[Array, "point pair"]
    at_focus: Float[Array, " mode"]
    r: Float[Array, " point"]
    z: Float[Array, " point"]

    @property
    def n_modes(self) -> int:
        """Number of shapes."""
        return self.mass.shape[0]

    def leading(self, n_modes: int) -> "ReducedSolid":
        """The first shapes alone."""
        n, (first, second) = n_modes, np.triu_indices(self.n_modes)
        chosen = np.flatnonzero((first < n) & (second < n))
        return ReducedSolid(
            self.mass[:n, :n],
            self.deviatoric[:n, :n],
            self.beside_points[:n, :n],
            self.volumetric[:n, :n],
            self.shape[..., :n],
            self.shape_pairs[:, chosen],
            self.dilatation_pairs[:, chosen],
            self.at_focus[:n],
            self.r,
            self.z,
        )


class _Moduli(eqx.Module):
    """Twice the shear moduli and the bulk modulus; a branch's stress is kept to `decay` and grows by `gain`."""

    relaxed: Array
    gain: Array
    decay: Array
    bulk: Array

    @classmethod
    def of(cls, field: ViscoelasticField, time_step: float) -> "_Moduli":
        """Those of a field of one axial position, the axis of that position left out."""
        decrement = time_step / field.relaxation_times[..., 0]
        gain = 2.0 * mean_decay(decrement) * field.branch_shear_moduli[..., 0]
        return cls(2.0 * field.relaxed_shear_modulus[:, 0], gain, jnp.exp(-decrement), field.bulk_modulus[:, 0])

    @property
    def within_a_step(self) -> Array:
        """Twice the shear modulus that a change of shape in a step meets."""
        return self.relaxed + jnp.sum(self.gain, axis=0)


class _State(eqx.Module):
    """Amplitudes, their rates, change of shape at points, and what branches hold: outside and at points."""

    amplitude: Float[Array, " mode"]
    rates: Float[Array, "2 mode"]
    shape: Float[Array, "3 point"]
    outside: Float[Array, "branch mode"]
    inside: Float[Array, "branch 3 point"]


def reduced_push(
    solid: ReducedSolid,
    outside: ViscoelasticField,
    inside: ViscoelasticField,
    force: Float[Array, " mode"],
    settings: PushSettings,
) -> Float[Array, ""]:
    """Axial displacement at the focus [m] at the end of the run.

    Args:
        solid: Shapes and points.
        outside: The uniform solid, on a grid of one point.
        inside: What is at the points, on a grid (point, 1); of the density of the outside.
        force: Work of the force on a unit of each amplitude [N], where the force is strongest.
        settings: Steps in time, and the force's course over them.

    Accuracy: that of `solve_push` with as many steps, beside what the shapes and the points leave out, which
        `arfjax.mechanics.reduced.basis` makes small.
    Differentiability: in all arrays, forward and reverse. The result is one number, so that derivatives in however many
        directions come from one gradient, for three times what the push takes.
    """
    return _pushed((solid, outside, inside, force), settings)


_Pushed = tuple[ReducedSolid, ViscoelasticField, ViscoelasticField, Float[Array, " mode"]]


@eqx.filter_custom_jvp
def _pushed(given: _Pushed, settings: PushSettings) -> Float[Array, ""]:
    solid, outside, inside, force = given
    return _march(solid, outside, inside, force, settings)


@_pushed.def_jvp
def _pushed_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    (given, settings), (directions, _) = primals, tangents
    moved, fixed = eqx.partition(given, jax.tree.map(lambda each: each is not None, directions, is_leaf=_is_none))

    def displacement(moved: _Pushed) -> Float[Array, ""]:
        solid, outside, inside, force = eqx.combine(moved, fixed)
        return _march(solid, outside, inside, force, settings)

    value, gradient = jax.value_and_grad(displacement)(moved)
    along = jax.tree.map(lambda slope, direction: jnp.sum(slope * direction), gradient, directions)
    return value, sum(jax.tree.leaves(along), jnp.zeros_like(value))


def _is_none(each: Any) -> bool:
    return each is None


def _march(
    solid: ReducedSolid,
    outside: ViscoelasticField,
    inside: ViscoelasticField,
    force: Float[Array, " mode"],
    settings: PushSettings,
) -> Float[Array, ""]:
    scheme = Scheme(settings.time_step, settings.spectral_radius)
    around, within = (_Moduli.of(field, settings.time_step) for field in (outside, inside))
    around = jax.tree.map(lambda each: each[..., 0], around)
    mass = outside.density[0, 0] * solid.mass
    extra = within.relaxed - around.relaxed
    stiff = around.bulk * solid.volumetric + _summed(solid.dilatation_pairs, within.bulk - around.bulk, solid.n_modes)
    elastic = stiff + around.relaxed * solid.deviatoric
    # What a change of shape in a step meets, branches included.
    in_step = stiff + around.within_a_step * solid.deviatoric
    in_step = in_step + _summed(solid.shape_pairs, within.within_a_step - around.within_a_step, solid.n_modes)
    inertia = (1.0 - scheme.old_inertia) / scheme.displacement_gain
    matrix = inertia * mass + (1.0 - scheme.old_stress) * in_step
    factor = jax.scipy.linalg.cho_factor(matrix)
    keeps, gains = (jnp.asarray(each) for each in scheme.update())
    inverse = jax.scipy.linalg.cho_solve(factor, jnp.eye(solid.n_modes))

    def step(state: _State, now: tuple[Array, Array]) -> tuple[_State, None]:
        share, jump = now
        before = state.rates.at[1].add(jump * struck)
        rates = keeps @ before
        left_outside, left_inside = around.decay[:, None] * state.outside, within.decay[:, None, :] * state.inside
        acceleration = _mix(before[1], rates[1], scheme.old_inertia)
        stress_outside = jnp.sum(_mix(state.outside, left_outside, scheme.old_stress), axis=0)
        stress_inside = extra[None] * state.shape + jnp.sum(_mix(state.inside, left_inside, scheme.old_stress), axis=0)
        missing = share * force - mass @ acceleration - elastic @ state.amplitude
        # What the surroundings' branches hold, but for the points, where the inclusion's do.
        missing = missing - solid.beside_points @ stress_outside
        change = inverse @ (missing - jnp.einsum("cpm,cp->m", solid.shape, stress_inside))
        moved = jnp.einsum("cpm,m->cp", solid.shape, change)
        return _State(
            state.amplitude + change,
            rates + gains[:, None] * change[None, :],
            state.shape + moved,
            left_outside + around.gain[:, None] * change[None, :],
            left_inside + within.gain[:, None, :] * moved[None],
        ), None

    nothing = jnp.zeros_like(force)
    struck = jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(solid.mass), force) / outside.density[0, 0]
    start = _State(
        nothing,
        jnp.stack([nothing, nothing]),
        jnp.zeros((3, len(solid.r)), force.dtype),
        jnp.zeros((around.gain.shape[0], len(force)), force.dtype),
        jnp.zeros((within.gain.shape[0], 3, len(solid.r)), force.dtype),
    )
    final, _ = jax.lax.scan(step, start, (settings.course.astype(force.dtype), settings.jumps.astype(force.dtype)))
    return jnp.dot(solid.at_focus, final.amplitude)


def _mix(start: Array, end: Array, share_of_start: float) -> Array:
    """What a step's balance takes of a quantity."""
    return share_of_start * start + (1.0 - share_of_start) * end


def pairs(rows: Float[np.ndarray, "component point mode"]) -> Float[np.ndarray, "point pair"]:
    """Products of every shape with itself and those after it, summed over components."""
    first, second = np.triu_indices(rows.shape[-1])
    return sum((each[:, first] * each[:, second] for each in rows), np.zeros((rows.shape[1], len(first))))


def _summed(
    pairs: Float[Array, "point pair"], weights: Float[Array, " point"], n_modes: int
) -> Float[Array, "mode mode"]:
    """The symmetric matrix of products summed over the points."""
    place = np.zeros((n_modes, n_modes), int)
    place[np.triu_indices(n_modes)] = np.arange(pairs.shape[1])
    return (weights @ pairs)[np.maximum(place, place.T)]
