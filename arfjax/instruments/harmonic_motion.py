"""Harmonic motion imaging: peak-to-peak of the tracked motion, from pulses or from the motion itself."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, PRNGKeyArray

from arfjax.errors import InputError
from arfjax.instruments.sampling import require
from arfjax.instruments.speckle_tracking import Positions, SpeckleTracker
from arfjax.media import Scalar
from arfjax.numerics.harmonics import peak_to_peak, sum_of_harmonics

Course = Float[Array, "*batch pulse"] | Float[np.ndarray, "*batch pulse"]


class Swing(eqx.Module):
    """How peak-to-peak is found from the displacements that the pulses of a period give."""

    @abc.abstractmethod
    def __call__(self, course: Course) -> Float[Array, "*batch"]:
        """Peak-to-peak [m] of each period, whose pulses lie along the last axis, evenly spaced."""

    @abc.abstractmethod
    def noise_factor(self, n_pulses: int) -> float:
        """Standard deviation of that over the one of a pulse's displacement, where noise is small."""


class SampledExtremes(Swing):
    """Largest less smallest displacement among the pulses: what harmonic motion imaging reports.

    Accuracy: pulses miss the extremes. Of a sine and an even number n of pulses a period, pi d / n off its crest in
        phase with -1 <= d <= 1, it finds the share cos(pi d / n), at least cos(pi / n): at 20 pulses at most 1.2 %
        is lost, over all phases 0.41 % on average. What is lost does not change with temperature if the phase does
        not. Noise that is not small against the steps between pulses makes it larger, since it picks extremes.
    Differentiability: in the two pulses that are extreme; none where two are equally so.
    """

    def __call__(self, course: Course) -> Float[Array, "*batch"]:
        """Largest less smallest displacement [m]."""
        return jnp.max(jnp.asarray(course), axis=-1) - jnp.min(jnp.asarray(course), axis=-1)

    def noise_factor(self, n_pulses: int) -> float:
        """Two pulses, each with noise of its own: the square root of 2."""
        return float(np.sqrt(2.0))


class FittedHarmonics(Swing):
    """Peak-to-peak of the harmonics that fit a period's displacements best (least squares), with any mean.

    Attributes:
        n_harmonics: How many, fewer than half the pulses.

    Accuracy: exact for motion of so many harmonics, whatever the phase of the pulses.
    Differentiability: everywhere but where nothing moves, and where extremes are equally high.
    """

    n_harmonics: int = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        """Refuse to fit nothing."""
        if self.n_harmonics < 1:
            raise InputError(f"`n_harmonics` must be at least 1, got {self.n_harmonics}.")

    def __call__(self, course: Course) -> Float[Array, "*batch"]:
        """Peak-to-peak [m] of the best harmonics."""
        return peak_to_peak(fitted_amplitudes(course, n_harmonics=self.n_harmonics))

    def noise_factor(self, n_pulses: int) -> float:
        """From the amplitudes' errors; of a swing whose highest and lowest point are half a period apart."""
        return float(np.sqrt(8.0 * ((self.n_harmonics + 1) // 2) / n_pulses))


class HarmonicMotionImager(eqx.Module):
    """A speckle tracker that follows periodic motion with so many pulses a period and reports peak-to-peak.

    Call it with maps of amplitudes: `imager(amplitudes, r, nodes, z=focus)`. As it stands it reports the peak-to-peak
    of the motion of a point.

    Attributes:
        tracker: The imaging beam and the noise of one displacement.
        pulses_per_period: Pulse repetition frequency over that of the motion: 20 for 1 kHz and 50 Hz. None for motion
            followed without gaps.
        first_pulse: Phase of the first pulse in a period [rad], after the middle of the strongest force.
        swing: How peak-to-peak is found from the pulses.
        n_averaged: Periods over which readings are averaged: 25 in the paper.
    """

    tracker: SpeckleTracker = SpeckleTracker()
    pulses_per_period: int | None = eqx.field(static=True, default=None)
    first_pulse: Scalar = 0.0
    swing: Swing = SampledExtremes()
    n_averaged: int = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        """Refuse too few pulses or periods."""
        require("first_pulse", self.first_pulse, "rad")
        if self.pulses_per_period is not None and self.pulses_per_period < 2:
            raise InputError(
                f"`pulses_per_period` must be at least 2, got {self.pulses_per_period}; raise the pulse repetition "
                "frequency."
            )
        if self.n_averaged < 1:
            raise InputError(f"`n_averaged` must be at least 1 period, got {self.n_averaged}.")

    @property
    def noise_sd(self) -> Scalar:
        """Standard deviation of a reading [m], where noise is small and every pulse has its own; see `Swing`."""
        if self.pulses_per_period is None:
            return 0.0
        factor = self.swing.noise_factor(self.pulses_per_period) / np.sqrt(self.n_averaged)
        return factor * self.tracker.jitter_sd

    def __call__(
        self,
        amplitudes: Complex[Array, "*step harmonic r z"] | Complex[np.ndarray, "*step harmonic r z"],
        r: Positions,
        nodes: Positions,
        *,
        z: Scalar,
        key: PRNGKeyArray | None = None,
    ) -> Float[Array, "*step"]:
        """Peak-to-peak displacement that it reports [m].

        Args:
            amplitudes: Of the axial displacement's harmonics, from the first on, with exp(+i n omega t) [m].
            r: Radii of the maps, as for `SpeckleTracker`.
            nodes: Their axial positions, as for `SpeckleTracker`.
            z: Stated middle of the window [m].
            key: Of the noise of every pulse of every period; none when None.

        Raises:
            InputError: as `SpeckleTracker`, or if there is a key but there are no pulses.

        Accuracy: that of the tracker and of `swing`. Every pulse's noise is taken to be its own. Where all
            are correlated with one echo they share that echo's part, which peak-to-peak does not see: the noise is
            then less than this.
        Differentiability: that of the tracker and of `swing`.
        """
        tracked = self.tracker(amplitudes, r, nodes, z=z)
        if self.pulses_per_period is None:
            if key is not None:
                raise InputError(
                    "noise comes with pulses: give `pulses_per_period` (20 for 1 kHz and 50 Hz) or no `key`."
                )
            return peak_to_peak(jnp.moveaxis(tracked, -1, 0))
        course = sampled_motion(tracked, n_pulses=self.pulses_per_period, first_pulse=self.first_pulse)
        if key is None:
            return self.swing(course)
        shape = (*course.shape[:-1], self.n_averaged, self.pulses_per_period)
        noise = self.tracker.jitter_sd * jax.random.normal(key, shape, course.dtype)
        return jnp.mean(self.swing(course[..., None, :] + noise), axis=-1)


def sampled_motion(
    amplitudes: Complex[Array, "*batch harmonic"], *, n_pulses: int, first_pulse: Scalar = 0.0
) -> Float[Array, "*batch pulse"]:
    """Displacement [m] at pulses that divide one period evenly, the first at a phase [rad]."""
    phases = first_pulse + 2.0 * jnp.pi * jnp.arange(n_pulses) / n_pulses
    single = amplitudes.reshape(-1, amplitudes.shape[-1])
    return jax.vmap(lambda each: sum_of_harmonics(each, phases))(single).reshape(*amplitudes.shape[:-1], n_pulses)


def fitted_amplitudes(course: Course, *, n_harmonics: int = 1) -> Complex[Array, "harmonic *batch"]:
    """Amplitudes that fit displacements at pulses which divide one period evenly best; phases are from the first pulse.

    Args:
        course: Displacement at the pulses of one period, along the last axis.
        n_harmonics: How many, from the first on.

    Raises:
        InputError: if so many cannot be told apart.

    Accuracy: exact, since the harmonics are orthogonal on such pulses; higher ones of the motion are folded in.
    """
    n_pulses = course.shape[-1]
    if 2 * n_harmonics >= n_pulses:
        raise InputError(
            f"{n_pulses} pulses a period tell {(n_pulses - 1) // 2} harmonics apart, not {n_harmonics}; fit fewer, or "
            "raise the pulse repetition frequency."
        )
    turns = np.outer(np.arange(1, n_harmonics + 1), np.arange(n_pulses)) / n_pulses
    return jnp.einsum("hp,...p->h...", 2.0 / n_pulses * np.exp(-2j * np.pi * turns), jnp.asarray(course))
