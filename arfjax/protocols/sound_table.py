r"""Heat and force of a sound field as smooth functions of two constants of the liver, computed once.

Where transducer, drive and path stay as they are, the field in the liver depends on the liver's attenuation and sound
speed alone. Heat deposition and the force on each shape of motion are expanded in Chebyshev polynomials of the
logarithm of the one and of the other.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.acoustics.field import HarmonicField
from arfjax.acoustics.intensity import heat_deposition
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.media import Scalar
from arfjax.model import Model
from arfjax.protocols.discretisation import Discretisation, layers_at
from arfjax.protocols.heated_tissue import force_on


class Interval(eqx.Module):
    """Where a number may lie, and how many polynomials follow it there: one if it does not vary.

    Attributes:
        middle: Of the interval.
        half: Half its width.
        n_terms: Number of polynomials.
    """

    middle: float = eqx.field(static=True)
    half: float = eqx.field(static=True)
    n_terms: int = eqx.field(static=True)

    @classmethod
    def around(cls, values: Float[np.ndarray, "*any"], n_terms: int) -> "Interval":
        """The interval of values, a twentieth wider; of one term where they are the same to 1e-9."""
        low, high = float(np.min(values)), float(np.max(values))
        middle, half = 0.5 * (low + high), 0.55 * (high - low)
        varies = half > 1e-9 * max(abs(middle), 1.0)
        return cls(middle, half if varies else 1e-9 * max(abs(middle), 1.0), n_terms if varies else 1)

    @property
    def nodes(self) -> Float[np.ndarray, " node"]:
        """Chebyshev's nodes."""
        angles = (np.arange(self.n_terms) + 0.5) * np.pi / self.n_terms
        return self.middle + self.half * np.cos(angles)

    def place(self, value: Scalar) -> Array:
        """-1 and 1 at the ends."""
        return (jnp.asarray(value) - self.middle) / self.half

    def terms(self, value: Scalar) -> Float[Array, " term"]:
        """The polynomials at a value."""
        x, terms = self.place(value), [jnp.ones(())]
        for k in range(1, self.n_terms):
            terms.append(x if k == 1 else 2.0 * x * terms[-1] - terms[-2])
        return jnp.stack(terms)

    def coefficients(self, at_nodes: Float[np.ndarray, "node *rest"]) -> Float[np.ndarray, "term *rest"]:
        """Of the polynomial through values at the nodes, along the first axis."""
        matrix = np.polynomial.chebyshev.chebvander((self.nodes - self.middle) / self.half, self.n_terms - 1)
        return np.tensordot(np.linalg.inv(matrix), at_nodes, axes=1)


class SoundTable(eqx.Module):
    """Heat and reduced force for every attenuation and sound speed of the liver in a range.

    Attributes:
        log_attenuation: Range of the logarithm of attenuation at 1 MHz [Np/m].
        sound_speed: Range [m/s].
        heat: Coefficients of the heat deposition in the cells of a heat grid [W/m^3].
        force: Coefficients of the work of the force on each shape of motion [N].
    """

    log_attenuation: Interval
    sound_speed: Interval
    heat: Float[Array, "attenuation speed r z"]
    force: Float[Array, "attenuation speed mode"]

    def heat_at(self, model: Model, temperature: Scalar) -> Float[Array, "r z"]:
        """Heat deposition with the liver at `temperature` [degC], for the power of the model that the table is of."""
        return jnp.einsum("ac,acrz->rz", self._terms(model, temperature), self.heat)

    def force_at(self, model: Model, temperature: Scalar) -> Float[Array, " mode"]:
        """Reduced force with the liver at `temperature` [degC], for the power of the model that the table is of."""
        return jnp.einsum("ac,acm->m", self._terms(model, temperature), self.force)

    def _terms(self, model: Model, temperature: Scalar) -> Float[Array, "attenuation speed"]:
        attenuation, speed = liver_constants(model, temperature)
        return jnp.outer(self.log_attenuation.terms(attenuation), self.sound_speed.terms(speed))


def liver_constants(model: Model, temperature: Scalar) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Logarithm of attenuation at 1 MHz [Np/m] and sound speed [m/s]; the former NaN where it is not positive."""
    medium = model.liver.acoustic(temperature)
    attenuation = jnp.asarray(medium.attenuation, dtype=float)
    positive = attenuation > 0.0
    logarithm = jnp.where(positive, jnp.log(jnp.where(positive, attenuation, 1.0)), jnp.nan)
    return logarithm, jnp.asarray(medium.sound_speed, dtype=float)


class FieldTable(eqx.Module):
    """Heat and force density at the nodes of both ranges.

    Attributes:
        heat: In the cells of the heat grid [W/m^3].
        force: At the Gauss points of the mesh [N/m^3].
    """

    heat: Float[np.ndarray, "attenuation speed r z"]
    force: Float[np.ndarray, "attenuation speed rq zq"]


def tabulate_fields(
    model: Model,
    log_attenuation: Interval,
    sound_speed: Interval,
    *,
    path_temperature: float,
    heat_settings: Discretisation,
    mesh: Mesh,
) -> FieldTable:
    """The sound fields of a model at all nodes, as `heat_settings` says; force at the Gauss points of `mesh`."""
    grid = heat_settings.heat_grid
    nodes = np.stack(np.meshgrid(log_attenuation.nodes, sound_speed.nodes, indexing="ij"), axis=-1)
    layers = layers_at(model, path_temperature, path_temperature)

    def fields(node: Float[Array, " 2"]) -> tuple[Array, Array]:
        medium = dataclasses.replace(layers[-1].medium, attenuation=jnp.exp(node[0]), sound_speed=node[1])
        all_layers = [*layers[:-1], dataclasses.replace(layers[-1], medium=medium)]

        def field(r: Float[np.ndarray, " r"], z: Float[np.ndarray, " z"]) -> HarmonicField:
            return heat_settings.sound_field(model, all_layers, r=r, z=z)

        return heat_deposition(field(grid.r, grid.z)), force_on(mesh, heat_settings, field)

    heat, force = jax.jit(jax.vmap(fields))(jnp.asarray(nodes.reshape(-1, 2)))
    shape = nodes.shape[:2]
    return FieldTable(*(np.asarray(each).reshape(*shape, *each.shape[1:]) for each in (heat, force)))


def expanded(
    values: Float[np.ndarray, "attenuation speed *rest"], log_attenuation: Interval, sound_speed: Interval
) -> Float[Array, "attenuation speed *rest"]:
    """Coefficients of the polynomials through values at the nodes."""
    along_first = log_attenuation.coefficients(values)
    return jnp.asarray(np.swapaxes(sound_speed.coefficients(np.swapaxes(along_first, 0, 1)), 0, 1))
