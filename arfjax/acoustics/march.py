r"""The march through one layer: harmonics as Bessel series in r, in symmetric steps along z.

Within a layer the one-way equation is da/dz = -i k_z a + W N(a): diffraction and absorption, diagonal in the series,
and N, what acts at the radial nodes (steepening, constants that vary, the sponge). W = k / k_z, the path per axial
distance, makes N act along each component's own path as it does in Westervelt's equation. A step of length h is

    half a step of the diagonal part:   multiply by exp(-i k_z h / 2)
    the operators at the nodes:         d = T (Phi_h(p) - p) at p = T^-1 (a + s / 2), then a + W d
    half a step of the diagonal part

with T the transform and Phi_h the flow of N. Phi_h does not know that the pressure grows by W d in place of d
along its step; s = (W - 1) d of the step before, carried along, tells it, and keeps the second order. For W = 1 this is
Strang's splitting. The sponge, which may take all of the pressure in one step, is left out of W: d is then split by
nodes, those of the clean field and those of the ring.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Shaped

from arfjax.numerics.hankel import HankelBasis

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
    physical: PhysicalOperator,
    n_clean: int | None = None,
    factors: Complex[Array, "step harmonic node"] | None = None,
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
        physical: Flow of what acts at the nodes, over a step's length [m].
        n_clean: How many nodes from the axis on `path` holds for; None for all.
        factors: What the pressure at the nodes is multiplied with in each half of a step besides.
        observe: Called with the series and the pressure at the nodes in the middle of each step, and its length.
        steps_per_checkpoint: The reverse mode keeps the state at every so many steps and computes the others anew:
            more of them take less memory and, above 1, a third more time.
    """
    from_series, to_series = constant(basis.from_series), constant(basis.to_series)
    n_clean = len(basis.nodes) if n_clean is None else n_clean
    wavenumber, excess = axial_wavenumber.T, None if path is None else path.T - 1.0

    def step(beam: Beam, own: tuple[Array, Array, Array | None]) -> tuple[Beam, tuple[Array, Array]]:
        length, is_wanted, factor = own
        half = jnp.exp(-0.5j * length * wavenumber)
        amplitude = half * beam.amplitude
        guess = amplitude if beam.drift is None else amplitude + 0.5 * length * half * beam.drift
        before = transform(from_series, guess)
        # Half of the factor before and half after: what changes attenuation does not commute with steepening.
        after = physical(before, length) if factor is None else factor.T * physical(factor.T * before, length)
        observed = jax.lax.stop_gradient(observe(guess, before, length))
        if excess is None:
            beam = Beam(half * (amplitude + transform(to_series, after - before)), None)
        else:
            gained = transform(to_series[:, :n_clean], (after - before)[:n_clean])
            drift = excess * gained
            amplitude = amplitude + gained + drift + transform(to_series[:, n_clean:], (after - before)[n_clean:])
            beam = Beam(half * amplitude, half * drift / length)
        return beam, (_read(evaluation, beam.amplitude, is_wanted), observed)

    steps = (constant(np.diff(positions)), jnp.asarray(wanted[1:]), factors)
    end, (pressure, observed) = _scan(jax.checkpoint(step), beam, steps, steps_per_checkpoint)
    first = transform(evaluation, beam.amplitude)[None] if wanted[0] else pressure[:0]
    return Marched(end, jnp.concatenate([first, pressure[np.flatnonzero(wanted[1:])]]), observed)


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


def constant(values: Float[np.ndarray, "..."]) -> Float[Array, "..."]:
    """Static numbers in the precision in force: `dtype=float` is float32 where x64 is off."""
    return jnp.asarray(values, dtype=float)
