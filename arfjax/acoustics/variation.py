r"""Media whose attenuation and sound speed vary within a layer, as heating changes them.

Where the constants depart from the layer's the wavenumber departs by dk(r, z), which acts in physical space: in each
step of the march every harmonic is multiplied at the radial nodes by

$$ \exp(-i\, dk(r)\, dz), \qquad dk = k(c + dc, \alpha + d\alpha) - k(c, \alpha) $$

with the power law and the dispersion of `complex_wavenumber`, dc and the change of alpha being means over the step:
the split operator of Thomson and Chapman, second order in the step. Refraction is in it, reflection by the variation is
not. What the factor changes acts along each component's path (`march`): to first order in dk the exact operator couples
the modes m and n by 2 k dk_mn / (k_zm + k_zn), this one by k dk_mn / k_zm, which is the same but for changes of
direction. Along the axis 1 - cos(theta) of the change would be missing: 9 percent at the focus of a bowl as deep as its
aperture.
Source: Thomson & Chapman, J. Acoust. Soc. Am. 74 (1983) 1848.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Complex, Float

from arfjax.acoustics.absorption import attenuation, complex_wavenumber
from arfjax.errors import InputError
from arfjax.media import AcousticMedium, Scalar

_ROUNDING = 1e-9
"""How far below zero [Np/m] rounding may take the attenuation of a lossless medium."""

Bounds = tuple[float, float]
"""Front and back of a layer [m]."""


class MediumVariation(eqx.Module):
    """By how much constants depart from their layer's, at the centres of a grid's cells; nothing outside it.

    Between centres it is linear, inside the first radius a parabola about the axis. Along the axis a layer takes its
    values only from the cells whose centre lies in it, the outermost held up to its interfaces; a layer that holds no
    centre does not vary. The grid ends half a spacing beyond its outermost centres, with a jump unless the variation
    is zero there, as about a heated region it should be.

    Attributes:
        r: Concrete radii of the centres, ascending [m].
        z: Concrete positions of the centres, ascending [m from the bowl's apex].
        attenuation: Added to the layer's coefficient at 1 MHz [Np/m].
        sound_speed: Added to the layer's [m/s].

    Raises:
        InputError: if positions are not ascending, or values do not fit them or are not finite (as far as concrete).
    """

    r: Float[np.ndarray, " n_r"]
    z: Float[np.ndarray, " n_z"]
    attenuation: Float[Array, "_ _"] | Float[np.ndarray, "_ _"]
    sound_speed: Float[Array, "_ _"] | Float[np.ndarray, "_ _"]

    def __check_init__(self) -> None:
        """Refuse positions and values that cannot be meant."""
        for name, positions in (("r", self.r), ("z", self.z)):
            if len(positions) < 2 or not np.all(np.diff(positions) > 0.0) or not 0.0 <= positions[0] < np.inf:
                raise InputError(
                    f"`{name}` of a variation must hold two or more ascending positions [m] from 0 on, got {positions}."
                )
        for name, values in (("attenuation", self.attenuation), ("sound_speed", self.sound_speed)):
            if values.shape != (len(self.r), len(self.z)):
                raise InputError(
                    f"`{name}` of a variation has shape {values.shape}, its positions (r, z) ask for "
                    f"{(len(self.r), len(self.z))}."
                )
            if not isinstance(values, Tracer) and not np.all(np.isfinite(values)):
                raise InputError(f"`{name}` of a variation holds values that are not finite.")

    def at(
        self, layer: Bounds, r: Float[np.ndarray, " r"], z: Float[np.ndarray, " z"]
    ) -> tuple[Float[Array, "r z"], Float[Array, "r z"]] | None:
        """Changes of attenuation and sound speed at radii and positions [m] in a layer.

        None where the layer holds no centre.

        Accuracy: second order in the spacing.
        """
        mine, (start, stop) = self._cells(layer), _ends(self.z)
        axial = _linear(self.z[mine], z) * ((start <= z) & (z <= stop))[:, None]
        return self._sampled(r, axial, mine)

    def mean_between(
        self, layer: Bounds, r: Float[np.ndarray, " r"], positions: Float[np.ndarray, " position"]
    ) -> tuple[Float[Array, "r step"], Float[Array, "r step"]] | None:
        """Mean changes from each of the positions [m] in a layer to the next one; None where it holds no centre."""
        mine, inside = self._cells(layer), np.clip(positions, *_ends(self.z))
        # The trapezoidal rule is exact between kinks, so that no step can miss a peak or the grid's end.
        kinks = np.union1d(inside, self.z[mine])
        values = _linear(self.z[mine], kinks)
        pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(kinks)[:, None]
        integral = np.concatenate([0.0 * values[:1], np.cumsum(pieces, axis=0)])[np.searchsorted(kinks, inside)]
        return self._sampled(r, np.diff(integral, axis=0) / np.diff(positions)[:, None], mine)

    def check(self, media: list[AcousticMedium], interfaces: Float[np.ndarray, " n"]) -> None:
        """Refuse what makes no sense in these layers, as far as values are concrete.

        Raises:
            InputError: if positions are traced, the grid lies outside the layers, or a layer's constants get negative.
        """
        if isinstance(self.r, Tracer) or isinstance(self.z, Tracer):
            raise InputError("`r` and `z` of a variation must be concrete: make it inside `jit`, `vmap` or `grad`.")
        if self.z[0] >= interfaces[-1]:
            raise InputError(
                f"the variation starts at {self.z[0]} m, where the layers have ended (at {interfaces[-1]} m). "
                "Millimetres? Pass metres from the bowl's apex."
            )
        for medium, front, back in zip(media, interfaces[:-1], interfaces[1:], strict=True):
            mine = self._cells((front, back))
            if mine.size > 0 and (
                _lowest(medium.sound_speed, self.sound_speed, mine) <= 0.0
                or _lowest(medium.attenuation, self.attenuation, mine) < -_ROUNDING
            ):
                raise InputError(
                    f"the variation takes attenuation or sound speed below zero in the layer from {front} to {back} m. "
                    "It is added to the layer's constants."
                )

    def _cells(self, layer: Bounds) -> np.ndarray:
        """Which positions along the axis lie in a layer."""
        return np.flatnonzero((self.z >= layer[0]) & (self.z < layer[1]))

    def _sampled(
        self, r: Float[np.ndarray, " r"], axial: Float[np.ndarray, "out cell"], mine: np.ndarray
    ) -> tuple[Float[Array, "r out"], Float[Array, "r out"]] | None:
        if mine.size == 0:
            return None
        weights = _linear(self.r, r)
        near = r < self.r[0]
        # A smooth function is even in r: a + b r^2 through the first two centres, without a kink on the axis.
        weights[near, 1] = (r[near] ** 2 - self.r[0] ** 2) / (self.r[1] ** 2 - self.r[0] ** 2)
        weights[near, 0] = 1.0 - weights[near, 1]
        weights[r > _ends(self.r)[1]] = 0.0
        across, along = jnp.asarray(weights, dtype=float), jnp.asarray(axial.T, dtype=float)
        attenuation, speed = (jnp.asarray(each, dtype=float)[:, mine] for each in (self.attenuation, self.sound_speed))
        return across @ attenuation @ along, across @ speed @ along


def wavenumber_change(
    medium: AcousticMedium,
    attenuation_change: Float[Array, "r z"],
    speed_change: Float[Array, "r z"],
    frequency: Float[Array, " harmonic"],
) -> Complex[Array, "harmonic r z"]:
    """By how much the complex wavenumber departs from the medium's [rad/m] at each frequency [Hz]."""

    def local(more_attenuation: Scalar, more_speed: Scalar) -> Array:
        attenuation, speed = medium.attenuation + more_attenuation, medium.sound_speed + more_speed
        return complex_wavenumber(dataclasses.replace(medium, attenuation=attenuation, sound_speed=speed), frequency)

    everywhere = jax.vmap(jax.vmap(local, out_axes=1), out_axes=1)(attenuation_change, speed_change)
    return everywhere - complex_wavenumber(medium, frequency)[:, None, None]


def step_factors(
    variation: MediumVariation | None,
    medium: AcousticMedium,
    layer: Bounds,
    frequency: Float[Array, " harmonic"],
    nodes: Float[np.ndarray, " node"],
    positions: Float[np.ndarray, " position"],
) -> Complex[Array, "step harmonic node"] | None:
    """What the variation multiplies the pressure at the nodes [m] with in half of each step between positions [m].

    None where the layer does not vary.
    """
    changes = None if variation is None else variation.mean_between(layer, nodes, positions)
    if changes is None:
        return None
    lengths = 0.5 * jnp.asarray(np.diff(positions), dtype=float)
    return jnp.moveaxis(jnp.exp(-1j * wavenumber_change(medium, *changes, frequency) * lengths[None, None, :]), 2, 0)


def local_constants(
    variation: MediumVariation | None,
    medium: AcousticMedium,
    layer: Bounds,
    frequency: Float[Array, " harmonic"],
    r: Float[np.ndarray, " r"],
    z: Float[np.ndarray, " z"],
) -> tuple[Float[Array, "r z"], Float[Array, "harmonic r z"]]:
    """Sound speed [m/s] and attenuation of each harmonic [Np/m] at radii and positions [m] of a layer."""
    speed = jnp.full((len(r), len(z)), jnp.asarray(medium.sound_speed, dtype=float))
    lost = jnp.broadcast_to(attenuation(medium, frequency)[:, None, None], (len(frequency), *speed.shape))
    changes = None if variation is None else variation.at(layer, r, z)
    if changes is None:
        return speed, lost
    more_attenuation, more_speed = changes
    unit = attenuation(dataclasses.replace(medium, attenuation=1.0), frequency)
    return speed + more_speed, lost + unit[:, None, None] * more_attenuation[None]


def _linear(centres: Float[np.ndarray, " n"], positions: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m n"]:
    """Matrix of linear interpolation from centres to positions, the outermost values held."""
    columns = [np.interp(positions, centres, column) for column in np.eye(len(centres))]
    return np.stack(columns, axis=1) if columns else np.zeros((len(positions), 0))


def _ends(centres: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Where a grid ends: half a spacing beyond its outermost centres."""
    return float(1.5 * centres[0] - 0.5 * centres[1]), float(1.5 * centres[-1] - 0.5 * centres[-2])


def _lowest(constant: Scalar, change: Array | np.ndarray, cells: np.ndarray) -> float:
    """Lowest value of a layer's constant, NaN (which passes every comparison) where it is traced."""
    if isinstance(constant, Tracer) or isinstance(change, Tracer):
        return np.nan
    return float(constant + np.min(np.asarray(change)[:, cells]))
