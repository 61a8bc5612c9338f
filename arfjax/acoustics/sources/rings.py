r"""The field of a surface cut into rings, on a plane beyond it.

Every point of the surface radiates exp(-i k R) / R (the Rayleigh integral over it, rho c u = source pressure times the
ring's weight). By Weyl's identity a ring at (r', z') has on the plane z the Hankel spectrum J0(kappa r')
exp(-i k_z (z - z')) / k_z. With kappa = k sin(theta) for the propagating part and kappa = k cosh(eta) for the
evanescent one the factor 1 / k_z cancels, and

$$ p(r) = p_0 k_0 k [ \int_0^{\pi/2} \sin\theta J_0(k r \sin\theta) S(\sin\theta) d\theta
   + i \int_0^\infty \cosh\eta J_0(k r \cosh\eta) S(\cosh\eta) d\eta ] $$
$$ S(s) = \int w r' J_0(k r' s) \exp(-i k \sqrt{1 - s^2} (z - z')) dl' $$

k may be complex: both paths then turn with it, which Cauchy's theorem allows. Two Gauss-Legendre quadratures, along the
surface and along the angle, converge to rounding once they resolve the oscillations.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Inexact

from arfjax.acoustics.sources.base import Radii
from arfjax.media import Scalar
from arfjax.numerics.bessel import bessel_j0
from arfjax.numerics.quadrature import gauss_legendre

_EVANESCENT_DECAY = 20.0
"""Where the evanescent integral stops: exp(-20) is 2e-9 of its start."""

_ROWS = 64
"""How many angles of the table are computed at once."""


class Rings(eqx.Module):
    """A surface as quadrature rings about the axis.

    Attributes:
        radius: [m].
        depth: Axial position [m].
        length: Of the surface's profile that each ring stands for [m].
        weight: Velocity over that of the source pressure, amplitude and phase [1].
    """

    radius: Float[Array, " ring"]
    depth: Float[Array, " ring"]
    length: Float[Array, " ring"]
    weight: Inexact[Array, " ring"]

    @property
    def area(self) -> Float[Array, ""]:
        """Area counted by the square of the amplitude [m^2]."""
        return 2.0 * np.pi * jnp.sum(jnp.real(self.weight * jnp.conj(self.weight)) * self.radius * self.length)


def radiated_pressure(
    rings: Rings,
    foremost: Scalar,
    source_pressure: Scalar,
    wavenumber: Complex[Array, ""],
    r: Radii,
    plane: float,
    *,
    n_quadrature: int,
) -> Complex[Array, " r"]:
    """Pressure of the rings [Pa] at radii `r` on a plane beyond the foremost, in a uniform medium.

    Args:
        rings: The surface.
        foremost: Its foremost axial position [m].
        source_pressure: Density times sound speed times normal velocity of a ring of weight 1 [Pa].
        wavenumber: k = omega / c - i alpha [rad/m].
        r: Radii [m].
        plane: Axial position of the plane [m]; at least a wavelength beyond `foremost`.
        n_quadrature: Gauss points in each angle; needed are k (max(r) + max(radius)) / 2 + 30.

    Returns:
        Complex pressure [Pa]; NaN where the plane is not beyond the surface, which a traced one cannot raise.

    Accuracy: 1e-9 of the largest pressure with enough quadrature points.
    Differentiability: in the rings, source pressure and wavenumber.
    """
    distance = plane - rings.depth
    sine, cosine, weight = _angles(wavenumber.real * (plane - foremost), n_quadrature)
    # One table serves both ends: columns for the radii wanted, then for the rings of the surface. It is made in a loop,
    # some rows at a time: otherwise XLA computes it anew, and slowly, within each product that uses it.
    radii = jnp.concatenate([jnp.asarray(r, dtype=float), rings.radius])
    bessel: Array = jax.lax.map(lambda sine: bessel_j0(wavenumber * sine * radii), sine, batch_size=_ROWS)
    at_plane, at_rings = bessel[:, : len(r)], bessel[:, len(r) :]
    advance = jnp.exp(-1j * wavenumber * cosine[:, None] * distance[None, :])
    spectrum = jnp.sum(at_rings * advance * (rings.weight * rings.radius * rings.length)[None, :], axis=1)
    pressure = source_pressure * wavenumber.real * wavenumber * ((weight * spectrum) @ at_plane)
    return jnp.where(plane > foremost, pressure, jnp.nan)


def composite_gauss(
    edges: Float[Array, " edge"], counts: tuple[int, ...]
) -> tuple[Float[Array, " point"], Float[Array, " point"]]:
    """Points and weights of Gauss-Legendre rules between neighbouring edges, `counts` points in each."""
    rules = [gauss_legendre(count) for count in counts]
    nodes, weights = (jnp.asarray(np.concatenate(parts), dtype=float) for parts in zip(*rules, strict=True))
    piece = np.repeat(np.arange(len(counts)), counts)
    half_width = 0.5 * jnp.diff(edges)[piece]
    return edges[piece] + half_width * (nodes + 1.0), half_width * weights


def _angles(decay: Scalar, n: int) -> tuple[Float[Array, " angle"], Complex[Array, " angle"], Complex[Array, " angle"]]:
    """Sine, cosine and weight of the propagating angles, then the evanescent ones (cosine -i sinh, weight i cosh).

    `decay` is how fast the latter die, k times the distance from the surface to the plane.
    """
    nodes, weights = (jnp.asarray(values, dtype=float) for values in gauss_legendre(n))
    theta = 0.25 * np.pi * (nodes + 1.0)
    end = jnp.arcsinh(_EVANESCENT_DECAY / decay)
    eta = 0.5 * end * (nodes + 1.0)
    sine = jnp.concatenate([jnp.sin(theta), jnp.cosh(eta)])
    cosine = jnp.concatenate([jnp.cos(theta) + 0j, -1j * jnp.sinh(eta)])
    weight = jnp.concatenate([0.25 * np.pi * weights + 0j, 0.5j * end * weights])
    return sine, cosine, weight * sine
