"""A thermocouple in heated tissue: where it really is, how large, how slow, and what the sound does to it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.errors import InputError, as_known, lies_within
from arfjax.grid import AxisymmetricGrid
from arfjax.instruments.sampling import mean_over, point_weights, require, require_field, require_inside
from arfjax.media import Scalar, Values
from arfjax.numerics.decay import mean_decay
from arfjax.numerics.quadrature import gauss_legendre
from arfjax.thermal.bioheat import TemperatureHistory

N_POINTS = 4
"""Points of the junction's quadrature along its radius, polar angle and half its azimuth."""

_NEGLIGIBLE = 80.0
"""Intervals in time constants after which nothing is left of a deviation (1e-35): kept clear of underflow."""

Heat = Float[Array, "r z"] | Float[np.ndarray, "r z"] | Float[Array, "interval r z"] | Float[np.ndarray, "interval r z"]


class Thermocouple(eqx.Module):
    r"""A bead that averages, lags, and is heated by the sound on its own.

    Call it with a history of temperature: `Thermocouple(time_constant=0.2)(history, grid, z=focus)`. The bead's
    temperature $\theta$ follows the mean of the tissue over the bead with $d\theta/dt = (\bar T - \theta) / \tau$.
    Viscous motion between bead and tissue adds an artefact $A$ of its own, which the bead's lag does not delay:

    $$ \frac{dA}{dt} = f \frac{Q}{\rho c} - \frac{A}{\tau_v} $$

    with the heat deposition $Q$ averaged over the bead. Under steady sound $A$ saturates at $f Q \tau_v / (\rho c)$.
    All zero, the default, is a perfect point.

    Attributes:
        radial_offset: Distance of the bead from the axis, its position error across the beam [m].
        axial_offset: Distance of the bead beyond its stated z, its position error along the beam [m].
        junction_diameter: Of the bead, a ball [m].
        time_constant: Of its lag, tau [s].
        viscous_fraction: Share of the local absorbed power that heats the bead besides, f [1]; above 1 for a wire.
        viscous_time_constant: With which that artefact drains into the tissue, tau_v [s].

    Source: that the artefact is large and has its own time: Kamimura et al., PMC6944748 (2020), abstract: up to
    81 +- 5 percent of a wire thermocouple's reading in canine liver and mouse brain; readings free of it from 0 to
    3.3 +- 1.0 s on in liver. It states neither constant, so none is assumed here.
    """

    radial_offset: Scalar = 0.0
    axial_offset: Scalar = 0.0
    junction_diameter: Scalar = 0.0
    time_constant: Scalar = 0.0
    viscous_fraction: Scalar = 0.0
    viscous_time_constant: Scalar = 0.0

    def __check_init__(self) -> None:
        """Refuse offsets that are not finite, and sizes, times and shares that are negative."""
        for name in ("radial_offset", "axial_offset"):
            require(name, getattr(self, name), "m")
        for name, unit in (("junction_diameter", "m"), ("time_constant", "s"), ("viscous_time_constant", "s")):
            require(name, getattr(self, name), unit, least=0.0)
        require("viscous_fraction", self.viscous_fraction, "1", least=0.0)

    def __call__(
        self,
        history: TemperatureHistory,
        grid: AxisymmetricGrid,
        *,
        z: Scalar,
        heat: Heat | None = None,
        power: Scalar | Float[Array, " interval"] | Float[np.ndarray, " interval"] = 1.0,
        heat_capacity: Values | Float[np.ndarray, "..."] | None = None,
    ) -> Float[Array, " time"]:
        """Temperature that it shows at the times of `history` [degC].

        Args:
            history: Temperature of the tissue; the bead starts in equilibrium with its first entry.
            grid: Where the cells of `history` lie.
            z: Stated axial position of the bead, on the axis [m].
            heat: Heat deposition of the sound [W/m^3], for each interval between two times, or one for all.
            power: Factor on `heat`, for each interval or one for all, as `Phase.power`.
            heat_capacity: Density times specific heat of the tissue [J/(m^3 K)], there or at the cells of `grid`.

        Raises:
            InputError: if shapes disagree, the bead reaches out of the grid (where its place is not traced), or
                there is a viscous artefact but `heat` or `heat_capacity` is missing.

        Accuracy: exact in time for temperatures that are linear and heat that is constant between two times. In space
        fourth order in the cell size, and exact for polynomials of fifth degree over the bead.
        Differentiability: in every attribute, also at zero, in `z`, the history with its times, the heat and the
        heat capacity.
        """
        require_field("history.temperature", history.temperature.shape, grid)
        weights = self._weights(grid, z)
        intervals = jnp.diff(history.time)
        tissue = mean_over(weights, history.temperature)
        decay, mean = relaxation(intervals, self.time_constant)
        shown = tissue - _accumulate(decay, mean * jnp.diff(tissue))
        if self._is_free_of_artefact() and (heat is None or heat_capacity is None):
            return shown
        if heat is None or heat_capacity is None:
            raise InputError(
                "a thermocouple with a `viscous_fraction` needs `heat` [W/m^3] and `heat_capacity` [J/(m^3 K)] of the "
                "tissue; pass both, or set `viscous_fraction` to 0."
            )
        _require_power(power, len(intervals))
        rate = self.viscous_fraction * _heating_rate(weights, heat, heat_capacity, grid, len(intervals)) * power
        decay, mean = relaxation(intervals, self.viscous_time_constant)
        return shown + _accumulate(decay, intervals * mean * rate)

    def _weights(self, grid: AxisymmetricGrid, z: Scalar) -> Float[Array, "r z"]:
        radius, middle = 0.5 * as_known(self.junction_diameter), as_known(z) + as_known(self.axial_offset)
        reach = abs(as_known(self.radial_offset)) + radius
        require_inside("thermocouple", grid, radius=reach, near=middle - radius, far=middle + radius)
        across, up, along, shares = _ball()
        squared_radius = (self.radial_offset + radius * across) ** 2 + (radius * up) ** 2
        return point_weights(jnp.asarray(squared_radius), jnp.asarray(middle + radius * along), shares, grid)

    def _is_free_of_artefact(self) -> bool:
        fraction = self.viscous_fraction
        return not isinstance(fraction, Tracer) and bool(fraction == 0.0)


@jax.jit
def relaxation(
    intervals: Float[Array, " interval"], time_constant: Scalar
) -> tuple[Float[Array, " interval"], Float[Array, " interval"]]:
    """What is left of a deviation after each interval, and its mean over the interval.

    These are exp(-x) and (1 - exp(-x)) / x of x = interval / time constant, and their limits where one of the two is
    zero, with their derivatives. Where both are, nothing is lost but a jump is followed at once.
    """
    time_constant = jnp.broadcast_to(jnp.asarray(time_constant, dtype=float), intervals.shape)
    lasting = _NEGLIGIBLE * time_constant > intervals
    x = jnp.where(lasting, intervals, 1.0) / jnp.where(lasting, time_constant, 1.0)
    decay = jnp.where(lasting, jnp.exp(-x), jnp.where(intervals > 0.0, 0.0, 1.0))
    gone = time_constant / jnp.where(intervals > 0.0, intervals, 1.0)
    return decay, jnp.where(lasting, mean_decay(x), gone)


@jax.jit
def _accumulate(decay: Float[Array, " interval"], gain: Float[Array, " interval"]) -> Float[Array, " time"]:
    """State after each interval that starts at zero, decays and gains; zero first."""

    def step(state: Array, both: tuple[Array, Array]) -> tuple[Array, Array]:
        state = state * both[0] + both[1]
        return state, state

    start = jnp.zeros((), dtype=jnp.result_type(gain, decay))
    _, states = jax.lax.scan(step, start, (decay, gain))
    return jnp.concatenate([start[None], states])


def _require_power(power: Scalar | np.ndarray | Array, n_intervals: int) -> None:
    if not lies_within(power, 0.0, np.finfo(float).max):
        raise InputError("`power` must be a finite number not below 0 [1], at every interval; correct it.")
    if np.ndim(power) > 0 and np.shape(power) != (n_intervals,):
        raise InputError(
            f"`power` has shape {np.shape(power)} for {n_intervals} intervals between times; pass one for each, or one."
        )


def _heating_rate(
    weights: Array, heat: Heat, heat_capacity: Values | np.ndarray, grid: AxisymmetricGrid, n_intervals: int
) -> Array:
    """Absorbed power over heat capacity, averaged over the bead [K/s]; one, or one for each interval."""
    require_field("heat", heat.shape, grid)
    if heat.ndim == 3 and heat.shape[0] != n_intervals:
        raise InputError(
            f"`heat` has {heat.shape[0]} entries for {n_intervals} intervals between times; pass one for each, or one."
        )
    capacity = jnp.asarray(heat_capacity, dtype=float)
    if capacity.ndim > 0:
        require_field("heat_capacity", capacity.shape, grid)
        capacity = mean_over(weights, capacity)
    return mean_over(weights, jnp.asarray(heat)) / capacity


def _ball() -> tuple[Float[np.ndarray, " point"], ...]:
    """Points in the half y >= 0 of the unit ball (x, y, z) and their shares; the other half is its mirror image."""
    nodes, weights = gauss_legendre(N_POINTS)
    radius, radial_share = 0.5 * (1.0 + nodes), 0.5 * weights * 3.0 * (0.5 * (1.0 + nodes)) ** 2
    azimuth = (np.arange(N_POINTS) + 0.5) * np.pi / N_POINTS
    radius, cosine, azimuth = np.meshgrid(radius, nodes, azimuth, indexing="ij")
    across = radius * np.sqrt(1.0 - cosine**2)
    shares = radial_share[:, None, None] * (0.5 * weights)[None, :, None] * np.full(N_POINTS, 1.0 / N_POINTS)
    places = (across * np.cos(azimuth), across * np.sin(azimuth), radius * cosine, shares)
    return tuple(values.ravel() for values in places)
