r"""Constitutive law: elastic in volume, relaxing in shape.

$$ \sigma = 2 \int_0^t G(t - s) \, d\,\mathrm{dev}\,\varepsilon(s) + K \, \mathrm{tr}(\varepsilon) I, \qquad
   G(t) = G_0 + \sum_i \Delta G_i \, e^{-t / \tau_i} $$

A sum of exponentials (a Prony series) needs one memory variable a branch, instead of the whole history. The
conventional Zener solid is such a sum with one branch. The fractional Zener solid relaxes as a Mittag-Leffler function,
an integral of exponentials with positive weights, which a few branches approximate.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.media import FractionalZener, Scalar, Zener

FieldOrScalar = Scalar | Float[Array, "..."]


class ModulusReading(eqx.Module):
    """What a measured "modulus" M is taken to be; Poisson's ratio converts it."""

    @abc.abstractmethod
    def shear_modulus(self, modulus: FieldOrScalar, poisson_ratio: Scalar) -> FieldOrScalar:
        """Shear modulus [Pa]."""

    @abc.abstractmethod
    def bulk_modulus(self, modulus: FieldOrScalar, poisson_ratio: Scalar) -> FieldOrScalar:
        """Bulk modulus [Pa]."""


class YoungModulus(ModulusReading):
    """M is Young's modulus: G = M / (2 (1 + nu)), K = M / (3 (1 - 2 nu))."""

    def shear_modulus(self, modulus: FieldOrScalar, poisson_ratio: Scalar) -> FieldOrScalar:
        """Shear modulus [Pa]."""
        return modulus / (2.0 * (1.0 + poisson_ratio))

    def bulk_modulus(self, modulus: FieldOrScalar, poisson_ratio: Scalar) -> FieldOrScalar:
        """Bulk modulus [Pa]."""
        return modulus / (3.0 * (1.0 - 2.0 * poisson_ratio))


class ShearModulus(ModulusReading):
    """M is the shear modulus: G = M, K = 2 M (1 + nu) / (3 (1 - 2 nu))."""

    def shear_modulus(self, modulus: FieldOrScalar, poisson_ratio: Scalar) -> FieldOrScalar:
        """Shear modulus [Pa]."""
        return modulus

    def bulk_modulus(self, modulus: FieldOrScalar, poisson_ratio: Scalar) -> FieldOrScalar:
        """Bulk modulus [Pa]."""
        return 2.0 * modulus * (1.0 + poisson_ratio) / (3.0 * (1.0 - 2.0 * poisson_ratio))


class Prony(eqx.Module):
    """A relaxation modulus as a sum of exponentials, of a point or of a field.

    Attributes:
        relaxed_modulus: Modulus after all has relaxed [Pa].
        branch_moduli: Modulus that each branch adds at first [Pa].
        relaxation_times: Of each branch [s].
    """

    relaxed_modulus: Float[Array, "*space"]
    branch_moduli: Float[Array, "branch *space"]
    relaxation_times: Float[Array, "branch *space"]

    def relaxation_modulus(self, time: Scalar) -> Float[Array, "*space"]:
        """Modulus [Pa] a time [s] after a step of strain."""
        return self.relaxed_modulus + jnp.sum(self.branch_moduli * jnp.exp(-time / self.relaxation_times), axis=0)


class ViscoelasticField(eqx.Module):
    """A viscoelastic solid on the tensor grid of Gauss points of a mesh.

    Attributes:
        density: [kg/m^3].
        bulk_modulus: Of the elastic answer to a change of volume [Pa].
        relaxed_shear_modulus: Shear modulus when all has relaxed [Pa].
        branch_shear_moduli: Shear modulus that each branch adds at first [Pa]; no branch is an elastic solid.
        relaxation_times: Of each branch [s].
    """

    density: Float[Array, "rq zq"]
    bulk_modulus: Float[Array, "rq zq"]
    relaxed_shear_modulus: Float[Array, "rq zq"]
    branch_shear_moduli: Float[Array, "branch rq zq"]
    relaxation_times: Float[Array, "branch rq zq"]


def viscoelastic_field(
    prony: Prony,
    shape: tuple[int, int],
    *,
    density: FieldOrScalar,
    bulk_modulus: FieldOrScalar,
    reading: ModulusReading,
    poisson_ratio: Scalar,
) -> ViscoelasticField:
    """A solid at the Gauss points from its relaxation modulus, of one point or already a field.

    Args:
        prony: Relaxation modulus, as measured.
        shape: Number of Gauss points, radial and axial.
        density: [kg/m^3], a number or a field.
        bulk_modulus: [Pa], a number or a field; `reading.bulk_modulus` gives it from a modulus.
        reading: Which modulus was measured.
        poisson_ratio: Of the reading [1]; the same at all times.
    """

    def fill(value: FieldOrScalar) -> Float[Array, "rq zq"]:
        return jnp.broadcast_to(_as_array(value), shape)

    def fill_branches(values: Float[Array, "branch *space"]) -> Float[Array, "branch rq zq"]:
        if values.ndim == 1:
            values = values[:, None, None]
        return jnp.broadcast_to(values, values.shape[:1] + shape)

    return ViscoelasticField(
        fill(density),
        fill(bulk_modulus),
        fill(reading.shear_modulus(prony.relaxed_modulus, poisson_ratio)),
        fill_branches(jnp.asarray(reading.shear_modulus(prony.branch_moduli, poisson_ratio))),
        fill_branches(prony.relaxation_times),
    )


def prony_of_zener(solid: Zener) -> Prony:
    """The conventional Zener solid: one branch, exact. Constants may be numbers or fields of one shape."""
    relaxed, unrelaxed, time = _broadcast(solid.relaxed_modulus, solid.unrelaxed_modulus, solid.relaxation_time)
    return Prony(relaxed, (unrelaxed - relaxed)[None], time[None])


def prony_of_fractional_zener(
    solid: FractionalZener, *, n_branches: int = 16, time_window: tuple[float, float] = (1e-2, 1e2)
) -> Prony:
    r"""The fractional Zener solid as a sum of exponentials with positive weights.

    $$ E_\beta(-(t/\tau)^\beta) = \int_{-\infty}^{\infty} h(x) \exp(-e^x t / \tau) \, dx, \qquad
       h(x) = \frac{1}{2 \pi} \frac{\sin \beta \pi}{\cosh \beta x + \cos \beta \pi} $$

    by the trapezoidal rule in x, which converges geometrically. Weights beyond the window are lumped into its first and
    last branch (the slow ones at their mean rate) and all are normalised to 1, so that relaxed and unrelaxed modulus
    are exact. One node is at x = 0, so that order 1 gives the conventional Zener solid exactly. No fit: smooth in every
    constant.

    Args:
        solid: Constants, numbers or fields of one shape.
        n_branches: Number of exponentials.
        time_window: Shortest and longest time that matters, in units of the relaxation time.

    Raises:
        ValueError: if there are fewer than three branches or the window is empty.

    Accuracy: largest error of the kernel over the default four decades, as a share of the relaxing part:

    | order | 0.2 | 0.3 | 0.5 | 0.6 | 0.7 | 0.8 | 0.9 | 0.95 | 1 |
    | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
    | 12 branches | 2e-3 | 9e-4 | 2e-4 | 5e-4 | 2e-3 | 1e-2 | 2e-2 | 2e-2 | 0 |
    | 16 branches | 7e-4 | 4e-4 | 8e-5 | 3e-5 | 2e-4 | 3e-3 | 1.3e-2 | 1.5e-2 | 0 |
    | 24 branches | 3e-4 | 2e-4 | 3e-5 | 2e-5 | 5e-6 | 2e-4 | 4e-3 | 1e-2 | 0 |

    Source: the spectral density is that of the Mittag-Leffler function (completely monotone for orders up to 1).
    """
    if n_branches < 3 or not 0.0 < time_window[0] < time_window[1]:
        raise ValueError(f"need `n_branches` >= 3 and 0 < shortest < longest, got {n_branches} and {time_window}.")
    relaxed, unrelaxed, time, order = _broadcast(
        solid.relaxed_modulus, solid.unrelaxed_modulus, solid.relaxation_time, solid.fractional_order
    )
    rates, weights = _relaxation_spectrum(order, n_branches, time_window)
    return Prony(relaxed, weights * (unrelaxed - relaxed)[None], time[None] / rates)


_FASTEST_RATE, _SLOWEST_RATE = 8.0, 0.1
"""Outermost branches: their rates times the shortest and longest time of the window (chosen by measured error)."""

_N_LUMPED = 100
"""Nodes of the rule on each side beyond the window, whose weights are lumped."""


def _relaxation_spectrum(
    order: Float[Array, "*space"], n_branches: int, time_window: tuple[float, float]
) -> tuple[Float[Array, "branch *space"], Float[Array, "branch *space"]]:
    # Rates in units of 1 / relaxation time, and weights that sum to one.
    lowest, highest = np.log(_SLOWEST_RATE / time_window[1]), np.log(_FASTEST_RATE / time_window[0])
    spacing = (highest - lowest) / (n_branches - 1)
    first = round(lowest / spacing) - _N_LUMPED
    log_rate = spacing * (first + np.arange(n_branches + 2 * _N_LUMPED)).reshape((-1,) + (1,) * order.ndim)
    decay = jnp.exp(-order[None] * np.abs(log_rate))
    peak = 4.0 * jnp.cos(0.5 * jnp.pi * order[None]) ** 2 * decay
    weights = peak / ((1.0 - decay) ** 2 + peak)  # h(x) over h(0), without overflow and with its limit at order 1
    weights = weights / jnp.sum(weights, axis=0, keepdims=True)
    rate = jnp.broadcast_to(jnp.exp(jnp.asarray(log_rate, dtype=order.dtype)), weights.shape)
    slow, fast = _N_LUMPED + 1, _N_LUMPED + n_branches - 1
    slow_weight = jnp.sum(weights[:slow], axis=0, keepdims=True)
    slow_rate = jnp.sum((weights * rate)[:slow], axis=0, keepdims=True) / slow_weight
    fast_weight = jnp.sum(weights[fast:], axis=0, keepdims=True)
    return (
        jnp.concatenate([slow_rate, rate[slow : fast + 1]]),
        jnp.concatenate([slow_weight, weights[slow:fast], fast_weight]),
    )


def _as_array(value: FieldOrScalar) -> Float[Array, "..."]:
    return jnp.asarray(value, dtype=float)


def _broadcast(*values: FieldOrScalar) -> list[Float[Array, "..."]]:
    return list(jnp.broadcast_arrays(*(_as_array(value) for value in values)))
