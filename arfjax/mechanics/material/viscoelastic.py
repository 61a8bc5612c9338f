r"""Constitutive law: elastic in volume, relaxing in shape.

$$ \sigma = 2 \int_0^t G(t - s) \, d\,\mathrm{dev}\,\varepsilon(s) + K \, \mathrm{tr}(\varepsilon) I, \qquad
   G(t) = G_0 + \sum_i \Delta G_i \, e^{-t / \tau_i} $$

A sum of exponentials (a Prony series) needs one memory variable a branch, instead of the whole history. The
conventional Zener solid is such a sum with one branch. Fractional solids relax as integrals of exponentials, which a
few branches approximate, and so does a pair of fast branches a viscosity: the march in time knows branches alone.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.mechanics.material.relaxation_spectrum import (
    TimeWindow,
    branches_for,
    dashpot_pair,
    relaxation_spectrum,
    spring_pot_spectrum,
)
from arfjax.media import (
    Elastic,
    FractionalKelvinVoigt,
    FractionalZener,
    KelvinVoigt,
    Prony,
    Scalar,
    Solid,
    Zener,
)

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


class ConstrainedModulus(ModulusReading):
    """M is the constrained modulus K + 4 G / 3, that of a layer between rigid plates.

    G = M (1 - 2 nu) / (2 (1 - nu)), K = M (1 + nu) / (3 (1 - nu)).
    """

    def shear_modulus(self, modulus: FieldOrScalar, poisson_ratio: Scalar) -> FieldOrScalar:
        """Shear modulus [Pa]."""
        return modulus * (1.0 - 2.0 * poisson_ratio) / (2.0 * (1.0 - poisson_ratio))

    def bulk_modulus(self, modulus: FieldOrScalar, poisson_ratio: Scalar) -> FieldOrScalar:
        """Bulk modulus [Pa]."""
        return modulus * (1.0 + poisson_ratio) / (3.0 * (1.0 - poisson_ratio))


class ViscoelasticField(eqx.Module):
    """A viscoelastic solid on the tensor grid of Gauss points of a mesh.

    Attributes:
        density: [kg/m^3].
        bulk_modulus: Of the elastic answer to a change of volume [Pa].
        relaxed_shear_modulus: Shear modulus when all has relaxed [Pa].
        branch_shear_moduli: Shear modulus that each branch adds at first [Pa]; no branch is an elastic solid. One of
            the pair that stands for a viscosity is negative.
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
        fill_branches(_as_array(reading.shear_modulus(_as_array(prony.branch_moduli), poisson_ratio))),
        fill_branches(_as_array(prony.relaxation_times)),
    )


def prony_of_zener(solid: Zener) -> Prony:
    """The conventional Zener solid: one branch, exact. Constants may be numbers or fields of one shape."""
    relaxed, unrelaxed, time = _broadcast(solid.relaxed_modulus, solid.unrelaxed_modulus, solid.relaxation_time)
    return Prony(relaxed, (unrelaxed - relaxed)[None], time[None])


def prony_of_fractional_zener(
    solid: FractionalZener,
    *,
    n_branches: int | None = None,
    tolerance: float = 1e-4,
    time_window: TimeWindow = (1e-2, 1e2),
) -> Prony:
    r"""The fractional Zener solid as a sum of exponentials with positive weights.

    Its relaxing part is the Mittag-Leffler function $E_\beta(-(t/\tau)^\beta)$, an integral of exponentials; see
    `relaxation_spectrum.py` for the rule that sums it. Relaxed and unrelaxed modulus are exact, and order 1 is the
    conventional Zener solid to 1e-8. No fit: smooth in every constant.

    Args:
        solid: Constants, numbers or fields of one shape.
        n_branches: Number of exponentials; as many as `tolerance` takes if not given.
        tolerance: Largest error of the kernel in the window for every order from 0.1 to 1, as a share of the relaxing
            part. Not used with `n_branches`.
        time_window: Shortest and longest time that matters, in units of the relaxation time.

    Raises:
        InputError: if there are fewer than three branches, the window is empty or the tolerance is out of reach.

    Accuracy: `kernel_error` says it for one order. For the worst order, over the four decades of the default:

    | branches | 12 | 16 | 20 | 24 | 32 |
    | --- | --- | --- | --- | --- | --- |
    | error | 1e-3 | 1.2e-4 | 3e-5 | 4e-6 | 2e-6 |

    Source: the spectral density is that of the Mittag-Leffler function (completely monotone for orders up to 1).
    """
    count = branches_for(tolerance, time_window) if n_branches is None else n_branches
    relaxed, unrelaxed, time, order = _broadcast(
        solid.relaxed_modulus, solid.unrelaxed_modulus, solid.relaxation_time, solid.fractional_order
    )
    rates, weights = relaxation_spectrum(order, count, time_window)
    return Prony(relaxed, weights * (unrelaxed - relaxed)[None], time[None] / rates)


def prony_of_kelvin_voigt(solid: KelvinVoigt, *, shortest_time: float) -> Prony:
    r"""The Kelvin-Voigt solid, its viscosity as a pair of fast branches, see `dashpot_pair`.

    Args:
        solid: Constants, numbers or fields of one shape.
        shortest_time: Of the motion [s]: the relaxation time of the faster branch.

    Accuracy: the viscous part of the complex modulus has the relative error $2 (\omega t)^2$ at angular frequencies
        up to a third of 1 / `shortest_time`: 2e-3 at 200 Hz with 25 us. Take time steps no longer than
        `shortest_time`: with shorter branches the march, which takes strain as linear within a step, lags by half a
        step. Instantaneously the solid is stiffer by 1.5 viscosity / `shortest_time`, which an explicit march feels.
    """
    relaxed, viscosity = _broadcast(solid.relaxed_modulus, solid.viscosity)
    moduli, rates = dashpot_pair(viscosity, 0.0, _positive(shortest_time))
    return Prony(relaxed, moduli, 1.0 / rates)


def prony_of_fractional_kelvin_voigt(
    solid: FractionalKelvinVoigt, *, n_branches: int = 16, times: TimeWindow = (1e-5, 0.1)
) -> Prony:
    """The fractional Kelvin-Voigt solid (a spring beside a spring-pot), as a sum of exponentials.

    The spring-pot has an infinite instantaneous modulus; here it ends at the shortest time, and what is faster is a
    viscosity in two branches, the last of them negative. Order 1 is `prony_of_kelvin_voigt`.

    Args:
        solid: Constants, numbers or fields of one shape.
        n_branches: Number of exponentials, at least five.
        times: Shortest and longest time that matters [s].

    Raises:
        InputError: if there are fewer than five branches or the window is empty.

    Accuracy: that of `spring_pot_spectrum`: 1e-4 up to 0.03 / shortest, 2 order (omega shortest)^2 beyond.
    """
    relaxed, viscosity, order = _broadcast(solid.relaxed_modulus, solid.viscosity, solid.fractional_order)
    rates, weights = spring_pot_spectrum(order, n_branches, times)
    return Prony(relaxed, viscosity[None] * weights, 1.0 / rates)


def prony_of(
    solid: Solid,
    *,
    tolerance: float = 3e-5,
    relative_window: TimeWindow = (1e-5, 1.0),
    times: TimeWindow = (1e-5, 0.1),
) -> Prony:
    """Any solid as a sum of exponentials.

    Args:
        solid: Constants, numbers or fields of one shape.
        tolerance: Largest error of the kernel of a fractional Zener solid, as a share of its relaxing part.
        relative_window: Shortest and longest time that matters over the relaxation time of a fractional Zener solid.
            The default is for a push of 0.5 ms in steps of 20 us and relaxation times of 5 ms to 1 s.
        times: Shortest and longest time [s] that matters to a Kelvin-Voigt or fractional Kelvin-Voigt solid.
    """
    match solid:
        case Prony():
            return jax.tree.map(_as_array, solid)
        case Elastic():
            relaxed = _as_array(solid.modulus)
            none = jnp.zeros((0, *relaxed.shape), relaxed.dtype)
            return Prony(relaxed, none, none)
        case Zener():
            return prony_of_zener(solid)
        case FractionalZener():
            return prony_of_fractional_zener(solid, tolerance=tolerance, time_window=relative_window)
        case KelvinVoigt():
            return prony_of_kelvin_voigt(solid, shortest_time=times[0])
        case FractionalKelvinVoigt():
            return prony_of_fractional_kelvin_voigt(solid, times=times)


def _positive(time: float) -> float:
    if not time > 0.0:
        raise InputError(f"`shortest_time` must be positive, got {time} s. Take the time step.")
    return time


def _as_array(value: FieldOrScalar | Float[np.ndarray, "..."]) -> Float[Array, "..."]:
    return jnp.asarray(value, dtype=float)


def _broadcast(*values: FieldOrScalar) -> list[Float[Array, "..."]]:
    return list(jnp.broadcast_arrays(*(_as_array(value) for value in values)))
