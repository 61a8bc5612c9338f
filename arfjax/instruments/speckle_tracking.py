r"""Speckle tracking with one pulse-echo beam: what displacement it finds where that differs from place to place.

Cross-correlation of two windows of echo finds one shift for all scatterers that they hold, each with the power with
which it echoes: to first order in the shifts, the mean of the displacement along the beam, weighted by the squared
pulse-echo response. Where the tissue that moves is narrower than the imaging beam, scatterers that stand still are in
the mean, and the displacement is underestimated. That follows here from the map of displacement and the beam.

Source: of the mean and its weight: McAleavey, Nightingale & Trahey, IEEE Trans. UFFC 50 (2003) 631, on tracking
under radiation force.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Inexact, PRNGKeyArray

from arfjax.errors import InputError, as_known
from arfjax.instruments.delay_estimation import DelayEstimation
from arfjax.instruments.sampling import require, require_within
from arfjax.media import Scalar
from arfjax.numerics.interpolation import interpolation_weights
from arfjax.numerics.quadrature import gauss_legendre

REACH = 6.0
"""Standard deviations of beam and pulse beyond which they count for nothing: 1.5e-8 of a beam, 2e-9 of a pulse."""

N_RADIAL, N_AZIMUTH, N_AXIAL = 24, 16, 24
"""Points over the beam's radius and half its azimuth, and over window and pulse."""

_LARGEST = 1.0
"""[m]; no tissue is larger, but millimetres given by their number are."""

Positions = Float[Array, "_"] | Float[np.ndarray, "_"]
Displacement = Inexact[Array, "*batch r z"] | Inexact[np.ndarray, "*batch r z"]


class SpeckleTracker(eqx.Module):
    """A beam along z, parallel to the axis of the force, and the window over which echoes are correlated.

    Call it with a map of axial displacement: `tracker(displacement, r, nodes, z=focus)`. As it stands it is a perfect
    point on the axis. `single_element_tracker` gives the widths of a focused disc.

    Attributes:
        lateral_width: Standard deviation of the squared pulse-echo response across the beam, a Gaussian [m].
        pulse_length: Its standard deviation along the beam, in depth, a Gaussian [m].
        window_length: Depth over which echoes are correlated, all alike [m].
        radial_offset: Of the imaging beam from the axis [m].
        axial_offset: Of the middle of the window beyond its stated z [m].
        gain: Factor on what is tracked [1]; 0.9 where the algorithm, the filter or a miscalibrated speed of sound
            takes another tenth, beyond what the beam's width does.
        delays: How noisy the estimates are; not at all when None.
    """

    lateral_width: Scalar = 0.0
    pulse_length: Scalar = 0.0
    window_length: Scalar = 0.0
    radial_offset: Scalar = 0.0
    axial_offset: Scalar = 0.0
    gain: Scalar = 1.0
    delays: DelayEstimation | None = None

    def __check_init__(self) -> None:
        """Refuse widths that are negative, offsets and gain that are not finite, and millimetres."""
        for name in ("lateral_width", "pulse_length", "window_length"):
            require(name, getattr(self, name), "m", least=0.0)
            _require_metres(name, getattr(self, name))
        for name in ("radial_offset", "axial_offset"):
            require(name, getattr(self, name), "m")
        require("gain", self.gain, "1")

    @property
    def jitter_sd(self) -> Scalar:
        """Standard deviation of one tracked displacement [m]."""
        return 0.0 if self.delays is None else self.delays.displacement_sd

    def __call__(
        self, displacement: Displacement, r: Positions, nodes: Positions, *, z: Scalar, key: PRNGKeyArray | None = None
    ) -> Inexact[Array, "*batch"]:
        """Displacement that it finds [m].

        Args:
            displacement: Along the beam [m], at one or at many times, or amplitudes of its harmonics (complex).
            r: Radii of the map [m], ascending, such as the nodes of a mesh; uneven as they like.
            nodes: Axial positions of the map [m], ascending.
            z: Stated middle of the window [m].
            key: Of the noise, drawn anew for every entry; none when None, and none for complex amplitudes.

        Raises:
            InputError: if shapes disagree, positions do not ascend, or beam and window reach out of the map (where
                these are not traced).

        Accuracy: fourth order in the spacing of a smooth map, and exact for displacement that is uniform. On a map
            that is fine enough, 2e-8 for displacement as narrow as a third of `lateral_width` (Gaussians' standard
            deviations), 6e-7 for displacement as short as `pulse_length` in windows up to ten times as long (in one
            of fifty times 2e-3). Left out: where displacement differs by a good part of a wavelength within window
            and beam, correlation is lost, and with it the mean.
        Differentiability: in the map, `z` and every attribute, at zero too (but see `DelayEstimation`).
        """
        _require_map(displacement, r, nodes)
        radial, axial = self.weights(r, nodes, z=z)
        tracked = self.gain * jnp.einsum("...rz,r,z->...", jnp.asarray(displacement), radial, axial)
        if key is None:
            return tracked
        if jnp.iscomplexobj(tracked):
            raise InputError("amplitudes of harmonics have no noise of their own; sample the motion, or pass no `key`.")
        return tracked + self.jitter_sd * jax.random.normal(key, tracked.shape, tracked.dtype)

    def weights(self, r: Positions, nodes: Positions, *, z: Scalar) -> tuple[Float[Array, " r"], Float[Array, " z"]]:
        """Weights of radii and axial positions, whose products are those of the points of a map; each sums to 1."""
        window, pulse, width = map(as_known, (self.window_length, self.pulse_length, self.lateral_width))
        middle, half = as_known(z) + as_known(self.axial_offset), 0.5 * window + REACH * pulse
        known_r, known_z = as_known(r), as_known(nodes)
        require_within(
            "tracking beam",
            "map of displacement",
            (known_z[0], known_z[-1]),
            known_r[-1],
            radius=abs(as_known(self.radial_offset)) + REACH * width,
            near=middle - half,
            far=middle + half,
        )
        squared_radius, shares = _beam_points(self.lateral_width, self.radial_offset)
        places, parts = _window_points(self.window_length, self.pulse_length)
        # In r^2 a smooth field has no kink at the axis.
        return shares @ interpolation_weights(squared_radius, jnp.asarray(r) ** 2), parts @ interpolation_weights(
            middle + places, nodes
        )


def single_element_tracker(
    *,
    aperture_diameter: Scalar,
    depth: Scalar,
    lowest_frequency: Scalar,
    highest_frequency: Scalar,
    window_length: Scalar,
    sound_speed: Scalar = 1540.0,
    noise_to_signal: Scalar = 0.0,
    correlation: Scalar = 1.0,
    radial_offset: Scalar = 0.0,
    axial_offset: Scalar = 0.0,
    gain: Scalar = 1.0,
) -> SpeckleTracker:
    r"""A tracker whose beam is that of a disc focused at the depth of the window.

    With $v = \pi D x / (\lambda z)$ a disc's pressure is $2 J_1(v) / v$, once on the way there and once back. Squared
    that is the Gaussian $\exp(-v^2 / 2)$ of the same curvature, 1.5 % wider where it is half: its standard deviation
    is $\lambda z / (\pi D)$, at the middle of the band. Along the beam the envelope of a flat band of width $W$ is
    $\mathrm{sinc}(W t)$; the Gaussian is as wide where its square is half.

    Args:
        aperture_diameter: D [m]. An unfocused disc is as wide as itself in its near field, up to D^2 / (4 lambda).
        depth: From the disc to the window, z [m].
        lowest_frequency: Of the band of the echoes, as filtered [Hz].
        highest_frequency: Of that band [Hz].
        window_length: Depth over which echoes are correlated [m].
        sound_speed: [m/s].
        noise_to_signal: Of the echoes, see `DelayEstimation`.
        correlation: Of successive echoes, see `DelayEstimation`.
        radial_offset: Of the beam, see `SpeckleTracker` [m].
        axial_offset: Of the window, see `SpeckleTracker` [m].
        gain: See `SpeckleTracker` [1].

    Raises:
        InputError: if a size or a frequency cannot be.
    """
    for name, value in (("aperture_diameter", aperture_diameter), ("depth", depth), ("window_length", window_length)):
        require(name, value, "m", least=0.0, above=True)
        _require_metres(name, value)
    require("lowest_frequency", lowest_frequency, "Hz", least=0.0, above=True)
    bandwidth, middle = highest_frequency - lowest_frequency, 0.5 * (lowest_frequency + highest_frequency)
    require("highest_frequency` less `lowest_frequency", bandwidth, "Hz", least=0.0, above=True)
    delays = DelayEstimation(
        centre_frequency=middle,
        fractional_bandwidth=bandwidth / middle,
        window_duration=2.0 * window_length / sound_speed,
        noise_to_signal=noise_to_signal,
        correlation=correlation,
        sound_speed=sound_speed,
    )
    return SpeckleTracker(
        lateral_width=sound_speed * depth / (np.pi * middle * aperture_diameter),
        pulse_length=_SINC_WIDTH * sound_speed / bandwidth,
        window_length=window_length,
        radial_offset=radial_offset,
        axial_offset=axial_offset,
        gain=gain,
        delays=delays,
    )


_SINC_WIDTH = 0.5 * 0.442946 / np.sqrt(2.0 * np.log(2.0))
"""Standard deviation in depth over c / W: sinc(x)^2 is half at x = 0.442946, a Gaussian at sqrt(2 ln 2) of its own."""


def _beam_points(width: Scalar, offset: Scalar) -> tuple[Float[Array, " point"], Float[np.ndarray, " point"]]:
    """Squared distances from the axis of points over the beam, and their shares."""
    nodes, weights = gauss_legendre(N_RADIAL)
    distance = 0.5 * REACH * (1.0 + nodes)
    ring = weights * distance * np.exp(-0.5 * distance**2)
    azimuth = (np.arange(N_AZIMUTH) + 0.5) * np.pi / N_AZIMUTH
    shares = np.broadcast_to((ring / np.sum(ring))[:, None] / N_AZIMUTH, (N_RADIAL, N_AZIMUTH))
    across, up = distance[:, None] * np.cos(azimuth), distance[:, None] * np.sin(azimuth)
    return ((offset + width * jnp.asarray(across)) ** 2 + (width * jnp.asarray(up)) ** 2).ravel(), shares.ravel()


def _window_points(length: Scalar, pulse: Scalar) -> tuple[Float[Array, " point"], Float[np.ndarray, " point"]]:
    """Distances from the middle of a window, blurred by the pulse, and their shares."""
    nodes, weights = gauss_legendre(N_AXIAL)
    normal = weights * np.exp(-0.5 * (REACH * nodes) ** 2)
    shares = (0.5 * weights)[:, None] * (normal / np.sum(normal))[None, :]
    nodes = jnp.asarray(nodes)
    return (0.5 * length * nodes[:, None] + REACH * pulse * nodes[None, :]).ravel(), shares.ravel()


def _require_metres(name: str, value: Scalar) -> None:
    if not isinstance(value, Tracer) and np.any(np.asarray(value) > _LARGEST):
        raise InputError(f"`{name}` is {value:g} m. Millimetres? Pass metres.")


def _require_map(displacement: Displacement, r: Positions, nodes: Positions) -> None:
    if displacement.shape[-2:] != (len(r), len(nodes)):
        raise InputError(
            f"`displacement` has shape {displacement.shape} for {len(r)} radii and {len(nodes)} axial positions; its "
            "last two axes are r and z."
        )
    r, nodes = as_known(r), as_known(nodes)
    for name, positions in (("r", r), ("nodes", nodes)):
        if not isinstance(positions, Tracer) and not (np.all(np.diff(positions) > 0.0) and np.isfinite(positions[-1])):
            raise InputError(f"`{name}` must ascend and be finite [m]; sort the map's axis.")
    if not isinstance(r, Tracer) and r[0] < 0.0:
        raise InputError(f"`r` must not be negative, got {r[0]:g} m; pass the half of the map from the axis on.")
