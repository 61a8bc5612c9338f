"""Element matrices as products with constant tables: one matrix product for all elements together.

On a grid of rectangles the slopes of the functions of the nodes are those of the reference square over lengths of the
element. So the entries of its matrix are sums, over the Gauss points, of numbers of the element times products of
reference functions, and the latter are the same for all elements. Lengths may be complex (absorbing layers).
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Inexact

from arfjax.mechanics.elements.mesh import N_GAUSS, Mesh
from arfjax.numerics.elements import linear_pressure, product, quadratic, quadratic_slope
from arfjax.numerics.quadrature import gauss_legendre
from arfjax.numerics.small_matrices import inverse_of_symmetric

_POINTS, _ = gauss_legendre(N_GAUSS)

PerElement = Inexact[Array, "ez er 9"]


class Metric(eqx.Module):
    """What slopes on the reference square, and values, are multiplied by to give strains [1/m].

    Attributes:
        over_r: Two over the radial size of the elements.
        over_z: Two over their axial size.
        over_radius: One over the radius of their Gauss points.
    """

    over_r: Inexact[Array, " er"]
    over_z: Inexact[Array, " ez"]
    over_radius: Inexact[Array, "er 9"]

    @property
    def all(self) -> tuple[Inexact[Array, "1 er 1"], Inexact[Array, "ez 1 1"], Inexact[Array, "1 er 9"]]:
        """The three, to be multiplied with fields at the Gauss points."""
        return self.over_r[None, :, None], self.over_z[:, None, None], self.over_radius[None]


def metric_of(mesh: Mesh) -> Metric:
    """The lengths of the elements of a mesh."""
    radii = np.tile(mesh.gauss_r.reshape(-1, N_GAUSS), (1, N_GAUSS))
    return Metric(*(jnp.asarray(1.0 / n) for n in (0.5 * np.diff(mesh.r_edges), 0.5 * np.diff(mesh.z_edges), radii)))


def mass_of(masses: PerElement) -> Inexact[Array, "ez er 9 9"]:
    """Consistent mass of each element from the mass [kg] of each Gauss point."""
    _, _, value = _functions()
    return _summed([masses], [_pairs(value, value)])


def deviatoric_stiffness_of(metric: Metric, stiffness: PerElement) -> Inexact[Array, "ez er 18 18"]:
    """Element stiffness [N/m] against change of shape, symmetric also where lengths are complex.

    Twice the energy is G (4/3 (rr^2 + zz^2 + tt^2 - rr zz - zz tt - tt rr) + gamma^2).

    Args:
        metric: Lengths of the elements.
        stiffness: Shear modulus times volume [N m] of each Gauss point.
    """
    along_r, along_z, value = _functions()
    over_r, over_z, over_radius = metric.all
    normal, mixed = 4.0 / 3.0 * stiffness, -2.0 / 3.0 * stiffness
    radial = _summed(
        [normal * over_r**2, normal * over_radius**2, mixed * over_r * over_radius, stiffness * over_z**2],
        [
            _pairs(along_r, along_r),
            _pairs(value, value),
            _pairs(along_r, value) + _pairs(value, along_r),
            _pairs(along_z, along_z),
        ],
    )
    both = _summed(
        [mixed * over_r * over_z, mixed * over_radius * over_z, stiffness * over_z * over_r],
        [_pairs(along_r, along_z), _pairs(value, along_z), _pairs(along_z, along_r)],
    )
    axial = _summed([normal * over_z**2, stiffness * over_r**2], [_pairs(along_z, along_z), _pairs(along_r, along_r)])
    rows = jnp.stack([jnp.stack([radial, both], -1), jnp.stack([jnp.swapaxes(both, 2, 3), axial], -1)], axis=3)
    return rows.reshape(*stiffness.shape[:2], 18, 18)


def volumetric_stiffness_of(
    metric: Metric, weights: PerElement, bulk_modulus: PerElement
) -> Inexact[Array, "ez er 18 18"]:
    """Element stiffness [N/m] against change of volume, the linear pressure condensed.

    Args:
        metric: Lengths of the elements.
        weights: Volume [m^3] of each Gauss point.
        bulk_modulus: [Pa].
    """
    along_r, along_z, value = _functions()
    over_r, over_z, over_radius = metric.all
    pressure = linear_pressure(_POINTS, _POINTS)
    radial = _summed([weights * over_r, weights * over_radius], [_pairs(pressure, along_r), _pairs(pressure, value)])
    axial = _summed([weights * over_z], [_pairs(pressure, along_z)])
    coupling = jnp.stack([radial, axial], axis=-1).reshape(*weights.shape[:2], 3, 18)
    compliance = _summed([weights / bulk_modulus], [_pairs(pressure, pressure)])
    stiffness = jnp.moveaxis(inverse_of_symmetric(jnp.moveaxis(compliance, (2, 3), (0, 1))), (0, 1), (2, 3))
    answer = jnp.sum(stiffness[..., None] * coupling[:, :, None], axis=3)
    return jnp.sum(coupling[..., :, None] * answer[..., None, :], axis=2)


def _functions() -> tuple[Float[Array, "9 9"], Float[Array, "9 9"], Float[Array, "9 9"]]:
    # Slopes along r and along z, and values, of the functions of the nodes at the Gauss points.
    value, slope = quadratic(_POINTS), quadratic_slope(_POINTS)
    return product(slope, value), product(value, slope), product(value, value)


def _pairs(first: Float[Array, "9 n"], second: Float[Array, "9 m"]) -> Float[Array, "9 n m"]:
    return first[:, :, None] * second[:, None, :]


def _summed(numbers: list[PerElement], tables: list[Float[Array, "9 n m"]]) -> Inexact[Array, "ez er n m"]:
    _, n, m = tables[0].shape
    joined, table = jnp.concatenate(numbers, axis=-1), jnp.concatenate(tables).reshape(-1, n * m)
    n_z, n_r, _ = joined.shape
    return jnp.dot(joined.reshape(n_z * n_r, -1), table).reshape(n_z, n_r, n, m)
