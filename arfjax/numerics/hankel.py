"""A quasi-discrete Hankel basis: Bessel series on a disc, and the nodes on which they are sampled.

A function that vanishes at the radius R of the disc is the series f(r) = sum_m a_m J0(kappa_m r) with
kappa_m = j_m / R and j_m the zeros of J0. With N terms it is sampled at r_i = j_i R / j_(N+1), the nodes at which
the discrete transform is orthogonal to within about 1e-8; the inverse used here is exact to rounding, so that
hundreds of transforms back and forth lose nothing.
"""

import dataclasses
import functools

import numpy as np
from jaxtyping import Float
from scipy import special


@dataclasses.dataclass(frozen=True, eq=False)
class HankelBasis:
    """The Bessel series with a given number of terms on a disc, as plain numpy arrays.

    Attributes:
        radius: Radius of the disc, where every function of the basis is zero [m].
        nodes: Where functions are sampled [m]; the axis is not among them.
        wavenumbers: Radial wavenumbers kappa_m [rad/m].
        from_series: Matrix from coefficients to values at the nodes.
        to_series: Matrix from values at the nodes to coefficients, the inverse of `from_series`.
        weights: Quadrature of the integral of f(r) r dr over the disc from values at the nodes [m^2].
        norms: Integral of J0(kappa_m r)^2 r dr over the disc [m^2].
    """

    radius: float
    nodes: Float[np.ndarray, " node"]
    wavenumbers: Float[np.ndarray, " mode"]
    from_series: Float[np.ndarray, "node mode"]
    to_series: Float[np.ndarray, "mode node"]
    weights: Float[np.ndarray, " node"]
    norms: Float[np.ndarray, " mode"]

    def evaluation_matrix(self, r: Float[np.ndarray, " r"]) -> Float[np.ndarray, "r mode"]:
        """Matrix from coefficients to values at any radii [m], the axis included: no interpolation."""
        return special.j0(r[:, None] * self.wavenumbers[None, :])


@functools.lru_cache(maxsize=16)
def hankel_basis(n_modes: int, radius: float) -> HankelBasis:
    """The basis of `n_modes` terms on a disc of `radius` [m].

    Accuracy: a function that is smooth and zero near the rim is represented to rounding once its bandwidth is below
    the last wavenumber, about pi n_modes / radius.
    """
    zeros = special.jn_zeros(0, n_modes + 1)
    roots, limit = zeros[:-1], zeros[-1]
    j1_squared = special.j1(roots) ** 2
    from_series = special.j0(roots[:, None] * roots[None, :] / limit)
    return HankelBasis(
        radius=radius,
        nodes=roots * radius / limit,
        wavenumbers=roots / radius,
        from_series=from_series,
        to_series=np.linalg.inv(from_series),
        weights=2.0 * radius**2 / (limit**2 * j1_squared),
        norms=0.5 * radius**2 * j1_squared,
    )
