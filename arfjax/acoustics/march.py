r"""The march through one layer: harmonics as Bessel series in r, in symmetric steps along z.

Within a layer the one-way equation is da/dz = -i k_z a + W N(a): diffraction and absorption, diagonal in the series,
and N, what acts at the radial nodes (steepening, constants that vary). W = k / k_z, the path per axial distance, makes
N act along each component's own path as it does in Westervelt's equation. A step of length h is

    half a step of the diagonal part:   multiply by exp(-i k_z h / 2)
    the operators at the nodes:         d = T (Phi_h(p) - p) at p = T^-1 (a + s / 2), then a + W d
    half a step of the diagonal part

with T the transform and Phi_h the flow of N. Phi_h does not know that the pressure grows by W d in place of d
along its step; s = (W - 1) d of the step before, carried along, tells it, and keeps the second order. For W = 1 this is
Strang's splitting. Steepening acts inside the sponge's ring alone, so that T has only the columns of those nodes where
constants do not vary; every so many steps the ring itself acts on the others.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Shaped

from arfjax.acoustics.sponge import Sponge
from arfjax.numerics.hankel import HankelBasis
from arfjax.numerics.precision import constant

Series = Complex[Array, "mode harmonic"]
AtNodes = Complex[Array, "node harmonic"]
PhysicalOperator = Callable[[AtNodes, Float[Array, ""]], AtNodes]
Observation = Callable[[Series, AtNodes, Float[Array, ""]], Shaped[Array, "..."]]


class Beam(NamedTuple):
    """State of a march.

    Attributes:
        amplitude: Coefficients of the series [Pa].
        drift: (W - 1) d of the step before, per length [Pa/m]; None where W is 1.
    """

    amplitude: Series
    drift: Series | None


class Marched(NamedTuple):
    """What a march leaves.

    Attributes:
        end: At the last position.
        pressure: At the wanted positions and radii [Pa].
        observed: What `observe` said of each step.
    """

    end: Beam
    pressure: Complex[Array, "position r harmonic"]
    observed: Shaped[Array, "step ..."]


def march(
    beam: Beam,
    positions: Float[np.ndarray, " position"],
    wanted: np.ndarray,
    *,
    axial_wavenumber: Complex[Array, "harmonic mode"],
    path: Float[Array, "harmonic mode"] | None,
    basis: HankelBasis,
    evaluation: Float[Array, "r mode"],
    physical: PhysicalOperator | None = None,
    factors: Complex[Array, "step harmonic node"] | None = None,
    sponge: Sponge | None = None,
    observe: Observation = lambda amplitude, pressure, length: jnp.zeros(()),
    steps_per_checkpoint: int = 1,
) -> Marched:
    """March from the first of the positions [m], where `beam` is, to the last.

    Args:
        beam: Where the march starts.
        positions: Concrete, ascending [m].
        wanted: At which of them the pressure is to be kept.
        axial_wavenumber: Of each component [rad/m].
        path: W, path per axial distance [1]; None for 1.
        basis: The Bessel series.
        evaluation: Matrix from the series to the radii at which the pressure is kept.
        physical: Flow of what acts at the nodes inside the sponge's ring, over a step's length [m]; None for nothing.
        factors: What the pressure at all nodes is multiplied with in each half of a step besides.
        sponge: The absorbing ring; without one all nodes count as inside.
        observe: Called with the series and the pressure inside the ring in the middle of each step, and its length.
        steps_per_checkpoint: The reverse mode keeps the state at every so many steps and computes the others anew:
            more of them take less memory and, above 1, a third more time.
    """
    n_clean = len(basis.nodes) if sponge is None else sponge.n_clean
    n_acting = n_clean if factors is None else len(basis.nodes)
    from_series, to_series = constant(basis.from_series[:n_acting]), constant(basis.to_series[:, :n_acting])
    wavenumber, excess = axial_wavenumber.T, None if path is None else path.T - 1.0
    acts = physical is not None or factors is not None
    absorb = None if sponge is None else _absorber(sponge, basis)

    def step(beam: Beam, own: tuple[Array, Array, Array | None, Array]) -> tuple[Beam, tuple[Array, Array]]:
        length, is_wanted, factor, ring_length = own
        half = jnp.exp(-0.5j * length * wavenumber)
        amplitude = half * beam.amplitude
        guess = amplitude if beam.drift is None else amplitude + 0.5 * length * half * beam.drift
        drift = None if beam.drift is None else jnp.zeros_like(beam.drift)
        before = transform(from_series, guess)
        observed = jax.lax.stop_gradient(observe(guess, before[:n_clean], length))
        if acts:
            gained = transform(to_series, _after(before, length, physical, factor, n_clean) - before)
            amplitude = amplitude + gained
            if excess is not None:
                drift = excess * gained
                amplitude, drift = amplitude + drift, half * drift / length
        amplitude = half * amplitude
        if absorb is not None:
            amplitude = jax.lax.cond(ring_length > 0.0, absorb, lambda series, _: series, amplitude, ring_length)
        return Beam(amplitude, drift), (_read(evaluation, amplitude, is_wanted), observed)

    lengths = np.diff(positions)
    ring_lengths = np.zeros_like(lengths) if sponge is None else sponge.pass_lengths(lengths)
    steps = (constant(lengths), jnp.asarray(wanted[1:]), factors, constant(ring_lengths))
    end, (pressure, observed) = _scan(jax.checkpoint(step), beam, steps, steps_per_checkpoint)
    first = transform(evaluation, beam.amplitude)[None] if wanted[0] else pressure[:0]
    return Marched(end, jnp.concatenate([first, pressure[np.flatnonzero(wanted[1:])]]), observed)


def _after(
    before: AtNodes, length: Array, physical: PhysicalOperator | None, factor: Array | None, n_clean: int
) -> AtNodes:
    """The pressure at the nodes after what acts there: half of the factor first and half last.

    What changes attenuation does not commute with steepening.
    """
    after = before if factor is None else factor.T * before
    if physical is not None:
        after = jnp.concatenate([physical(after[:n_clean], length), after[n_clean:]])
    return after if factor is None else factor.T * after


def _absorber(sponge: Sponge, basis: HankelBasis) -> Callable[[Series, Array], Series]:
    """What the ring makes of a series over a length [m]."""
    n, loss = sponge.n_clean, constant(sponge.loss)
    from_series, to_series = constant(basis.from_series[n:]), constant(basis.to_series[:, n:])

    def absorb(series: Series, length: Array) -> Series:
        return series + transform(to_series, jnp.expm1(-length * loss)[:, None] * transform(from_series, series))

    return absorb


def _read(evaluation: Array, amplitude: Series, is_wanted: Array) -> Complex[Array, "r harmonic"]:
    shape = (evaluation.shape[0], amplitude.shape[1])
    return jax.lax.cond(
        is_wanted, lambda series: transform(evaluation, series), lambda _: jnp.zeros(shape, amplitude.dtype), amplitude
    )


def _scan(step: Callable, beam: Beam, steps: tuple, every: int) -> tuple[Beam, tuple[Array, Array]]:
    """`jax.lax.scan`, of which the reverse mode keeps only every so many states."""
    n = steps[0].shape[0]
    whole = n // every
    if every == 1 or whole < 2:
        return jax.lax.scan(step, beam, steps)
    head = jax.tree.map(lambda each: each[: whole * every].reshape(whole, every, *each.shape[1:]), steps)
    beam, first = jax.lax.scan(jax.checkpoint(lambda carry, some: jax.lax.scan(step, carry, some)), beam, head)
    first = jax.tree.map(lambda each: each.reshape(whole * every, *each.shape[2:]), first)
    beam, rest = jax.lax.scan(step, beam, jax.tree.map(lambda each: each[whole * every :], steps))
    return beam, jax.tree.map(lambda *parts: jnp.concatenate(parts), first, rest)


def transform(matrix: Float[Array, "out in"], values: Complex[Array, "in harmonic"]) -> Complex[Array, "out harmonic"]:
    """A real matrix times complex columns, as one product of real ones: half the work of a complex matrix."""
    n = values.shape[1]
    both = matrix @ jnp.concatenate([values.real, values.imag], axis=1)
    return jax.lax.complex(both[:, :n], both[:, n:])
