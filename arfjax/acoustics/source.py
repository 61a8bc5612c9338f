r"""The field of the true bowl on the plane from which the march starts.

Every point of the bowl radiates exp(-i k R) / R (the Rayleigh integral over the bowl, rho c u = source pressure). By
Weyl's identity a ring of the bowl at (r', z') has on the plane z the Hankel spectrum J0(kappa r') exp(-i k_z (z - z'))
/ k_z. With kappa = k sin(theta) for the propagating part and kappa = k cosh(eta) for the evanescent one the factor
1 / k_z cancels, and

$$ p(r) = p_0 k_0 k [ \int_0^{\pi/2} \sin\theta J_0(k r \sin\theta) S(\sin\theta) d\theta
   + i \int_0^\infty \cosh\eta J_0(k r \cosh\eta) S(\cosh\eta) d\eta ] $$
$$ S(s) = \int r' J_0(k r' s) \exp(-i k \sqrt{1 - s^2} (z - z')) dl' $$

k may be complex: both paths then turn with it, which Cauchy's theorem allows. Two Gauss-Legendre quadratures, along the
bowl's arc and along the angle, converge to rounding once they resolve the oscillations.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from arfjax.media import Scalar
from arfjax.numerics.bessel import bessel_j0
from arfjax.transducer import FocusedBowl

_EVANESCENT_DECAY = 20.0
"""Where the evanescent integral stops: exp(-20) is 2e-9 of its start."""


def bowl_pressure(
    bowl: FocusedBowl,
    source_pressure: Scalar,
    wavenumber: Complex[Array, ""],
    r: Float[np.ndarray, " r"] | Float[Array, " r"],
    plane: float,
    *,
    n_quadrature: int = 320,
) -> Complex[Array, " r"]:
    """Pressure of the bowl [Pa] at radii `r` on a plane beyond its rim, in a uniform medium.

    Args:
        bowl: The transducer.
        source_pressure: Density times sound speed times normal velocity of the surface [Pa].
        wavenumber: k = omega / c - i alpha [rad/m].
        r: Radii [m].
        plane: Axial position of the plane [m]; at least a wavelength beyond the rim.
        n_quadrature: Gauss points in each integral; needed are k (max(r) + aperture_radius) / 2 + 30.

    Returns:
        Complex pressure [Pa]; NaN where the plane is not beyond the rim, which a traced bowl cannot raise.

    Accuracy: 1e-9 of the largest pressure with enough quadrature points.
    Differentiability: in the bowl's dimensions, source pressure and wavenumber.
    """
    ring_radius, ring_depth, ring_length = _rings(bowl, n_quadrature // 2)
    distance = plane - ring_depth
    sine, cosine, weight = _angles(wavenumber.real * (plane - bowl.rim_depth), n_quadrature)
    # One table serves both ends: columns for the radii wanted, then for the rings of the bowl. Without
    # the barrier XLA computes it anew for each use.
    radii = jnp.concatenate([jnp.asarray(r, dtype=float), ring_radius])
    bessel: Array = jax.lax.optimization_barrier(bessel_j0(wavenumber * sine[:, None] * radii[None, :]))
    at_plane, at_rings = bessel[:, : len(r)], bessel[:, len(r) :]
    advance = jnp.exp(-1j * wavenumber * cosine[:, None] * distance[None, :])
    spectrum = (at_rings * advance) @ (ring_radius * ring_length).astype(bessel.dtype)
    pressure = source_pressure * wavenumber.real * wavenumber * ((weight * spectrum) @ at_plane)
    return jnp.where(plane > bowl.rim_depth, pressure, jnp.nan)


def _rings(bowl: FocusedBowl, n: int) -> tuple[Float[Array, " ring"], Float[Array, " ring"], Float[Array, " ring"]]:
    """Radius, depth and arc length [m] of the rings that the bowl is cut into."""
    nodes, weights = (jnp.asarray(values, dtype=float) for values in np.polynomial.legendre.leggauss(n))
    start, stop = (jnp.arcsin(radius / bowl.focal_length) for radius in (bowl.hole_radius, bowl.aperture_radius))
    half_width = 0.5 * (stop - start)
    angle = start + half_width * (nodes + 1.0)
    depth = bowl.focal_length * (1.0 - jnp.cos(angle))
    return bowl.focal_length * jnp.sin(angle), depth, bowl.focal_length * half_width * weights


def _angles(decay: Scalar, n: int) -> tuple[Float[Array, " angle"], Complex[Array, " angle"], Complex[Array, " angle"]]:
    """Sine, cosine and weight of the propagating angles, then the evanescent ones (cosine -i sinh, weight i cosh).

    `decay` is how fast the latter die, k times the distance from rim to plane.
    """
    nodes, weights = (jnp.asarray(values, dtype=float) for values in np.polynomial.legendre.leggauss(n))
    theta = 0.25 * np.pi * (nodes + 1.0)
    end = jnp.arcsinh(_EVANESCENT_DECAY / decay)
    eta = 0.5 * end * (nodes + 1.0)
    sine = jnp.concatenate([jnp.sin(theta), jnp.cosh(eta)])
    cosine = jnp.concatenate([jnp.cos(theta) + 0j, -1j * jnp.sinh(eta)])
    weight = jnp.concatenate([0.25 * np.pi * weights + 0j, 0.5j * end * weights])
    return sine, cosine, weight * sine
