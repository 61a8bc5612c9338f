r"""Fractional relaxation as a sum of exponentials: spectral densities on nodes that crowd where the density peaks.

$$ E_\beta(-t^\beta) = \int_{-\infty}^{\infty} h(x) \exp(-e^x t) \, dx, \qquad
   h(x) = \frac{1}{2 \pi} \frac{\sin \beta \pi}{\cosh \beta x + \cos \beta \pi}, $$
$$ \frac{t^{-\beta}}{\Gamma(1 - \beta)} =
   \frac{\sin \beta \pi}{\pi} \int_{-\infty}^{\infty} e^{\beta x} \exp(-e^x t) \, dx $$

The trapezoidal rule in x converges as fast as the nearest singularity lets it. That of the exponential is at the
imaginary distance pi / 2, but h has poles at $\pm i \theta$, $\theta = \pi (1 - \beta) / \beta$, which pinch the real
axis as the order nears 1: the density becomes a Lorentzian, at last a single line. So the nodes are even not in x but
in s,

$$ \sinh x = d \, \sinh s, \qquad d = \sin \min(\theta, \pi / 2), $$

which puts those poles at the distance pi / 2 too, for every order, and leaves x = s where they do not disturb (orders
up to 2 / 3). No fit: weights are positive and smooth in the order.
"""

import bisect
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError

_NARROWEST = 1e-9
"""Smallest d: an order nearer to 1 than a third of it is taken to be a line of this width."""

_HIGHEST_ORDER = 1.0 - _NARROWEST
"""Order that stands for 1: beyond it the kernel would be a line whose width does not follow the order."""

_LOWEST_ORDER = 1e-3
"""Order that stands for lower ones, whose kernel is a half at all times of any window."""

_FAR = 40.0

_BEYOND = 24
"""Nodes of the rule below the window whose mean rate is summed; the weight below them is known in closed form."""

_FAST_MARGINS, _SLOW_MARGINS = (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0), (0.5, 0.3, 0.2, 0.1, 0.05, 0.02, 0.01)
"""Rates of the outermost branches, times the shortest and the longest time: the best pair is found by trying."""

_ORDERS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98, 0.99, 0.999)
"""Orders for which `branches_for` makes sure of its tolerance, and between which its error is smooth."""

_MOST_BRANCHES = 96

TimeWindow = tuple[float, float]
"""Shortest and longest time that matters."""


def relaxation_spectrum(
    order: Float[Array, "*space"], n_branches: int, time_window: TimeWindow
) -> tuple[Float[Array, "branch *space"], Float[Array, "branch *space"]]:
    """Rates and weights whose exponentials sum to the Mittag-Leffler function of an order.

    Weights beyond the window are lumped into the first and the last branch (the slow ones at their mean rate) and all
    sum to 1.

    Args:
        order: Of the derivative, above 0 and up to 1 [1].
        n_branches: Number of exponentials, at least three.
        time_window: Shortest and longest time that matters, in units of the relaxation time.

    Raises:
        InputError: if there are fewer than three branches or the window is empty.

    Accuracy: `kernel_error` says it.
    Differentiability: in the order, up to 1. Within 1e-3 of it the rule's own error, though small, bends with the
        logarithm of the distance: the slope is that of the sum, about twice the kernel's at 1 itself.
    """
    _check(n_branches, time_window)
    order = jnp.maximum(order, _LOWEST_ORDER)
    order = order - jax.lax.stop_gradient(jnp.maximum(order - _HIGHEST_ORDER, 0.0))
    return _mittag_leffler_nodes(order, n_branches, _limits(time_window, _margins(n_branches, time_window)), jnp)


def kernel_error(order: float, n_branches: int, time_window: TimeWindow) -> float:
    """Largest error of the sum of exponentials within the time window, as a share of the relaxing part.

    Against the same integral with eight times as many nodes and far wider, which is exact to 1e-10.
    """
    _check(n_branches, time_window)
    return float(_error((order,), n_branches, time_window, _margins(n_branches, time_window))[0])


@functools.cache
def branches_for(tolerance: float, time_window: TimeWindow) -> int:
    """Number of branches with which `kernel_error` is at most `tolerance` for every order from 0.1 to 1.

    Raises:
        InputError: if the tolerance is out of reach (below 1e-9, or a window of very many decades).
    """
    _check(3, time_window)
    enough = bisect.bisect_left(
        range(3, _MOST_BRANCHES + 1), -tolerance, key=lambda n: -float(np.max(_errors(n, time_window)))
    )
    if enough < _MOST_BRANCHES - 2:
        return enough + 3
    raise InputError(
        f"`tolerance` {tolerance:g} for times {time_window[0]:g} to {time_window[1]:g} takes more than "
        f"{_MOST_BRANCHES} exponentials: ask for less, or for a shorter window."
    )


def spring_pot_spectrum(
    order: Float[Array, "*space"], n_branches: int, time_window: TimeWindow
) -> tuple[Float[Array, "branch *space"], Float[Array, "branch *space"]]:
    r"""Rates [1/s] and weights [1/s^order] whose exponentials sum to $t^{-\beta} / \Gamma(1 - \beta)$ in a window.

    What relaxes faster than the window resolves is a viscosity. A pair of branches carries its first two moments, see
    `dashpot_pair`: the last two, of which the slower has a negative weight.

    Args:
        order: Above 0 and up to 1 [1]; at 1 a dashpot alone.
        n_branches: Number of exponentials, at least five.
        time_window: Shortest and longest time that matters [s].

    Raises:
        InputError: if there are fewer than five branches or the window is empty.

    Accuracy: of the complex modulus, as a share of its magnitude, from angular frequency 1 / longest on: at most
        2 order (omega shortest)^2, plus what the number of branches leaves: 1e-4 with 16 of them over three or four
        decades, 1e-3 with 12.
    Differentiability: in the order.
    """
    if n_branches < 5:
        raise InputError(f"a spring-pot needs `n_branches` of 5 or more, got {n_branches}.")
    _check(n_branches, time_window)
    lowest, highest = np.log(0.03 / time_window[1]), np.log(1.0 / time_window[0])
    spacing = (highest - lowest) / (n_branches - 2)
    log_rate = (lowest + spacing * np.arange(n_branches - 1)).reshape((-1,) + (1,) * order.ndim)
    scale = jnp.sin(jnp.pi * order) / jnp.pi
    weights = spacing * scale[None] * jnp.exp(order[None] * log_rate)
    inner, rates = weights[1:-1], jnp.broadcast_to(jnp.exp(jnp.asarray(log_rate, dtype=order.dtype)), weights.shape)
    slow_weight = weights[0] / -jnp.expm1(-spacing * order)
    slow_rate = rates[0] * (weights[0] / -jnp.expm1(-spacing * (1.0 + order))) / slow_weight
    time = float(np.exp(-highest))
    # The rule's sum from its last node on: a geometric series, whose ratio is 1 at order 1, where scale is 0.
    first = spacing * time ** (1.0 - order) * _sinc_over_geometric(order, spacing)
    second = time * weights[-1] * time / -jnp.expm1(-spacing * (2.0 - order))
    fast_weights, fast_rates = dashpot_pair(first, second, time)
    return (
        jnp.concatenate([slow_rate[None], rates[1:-1], fast_rates]),
        jnp.concatenate([slow_weight[None], inner, fast_weights]),
    )


def dashpot_pair(
    viscosity: Float[Array, "*space"], second_moment: Float[Array, "*space"] | float, time: float
) -> tuple[Float[Array, "2 *space"], Float[Array, "2 *space"]]:
    r"""Moduli and rates of two branches that stand for a viscosity.

    Branches of the relaxation times $\tau$ and $2 \tau$ whose moduli make the sums of $g_i \tau_i$ and $g_i \tau_i^2$
    what is asked for. Without a second moment that is a dashpot, $i \omega \eta$, with the relative error
    $2 (\omega \tau)^2$; one branch alone would have $\omega \tau$. The slower modulus is negative. The loss of the
    pair is positive at every frequency all the same, so that it never makes energy.

    Args:
        viscosity: Sum of moduli times relaxation times [Pa s].
        second_moment: Sum of moduli times squared relaxation times [Pa s^2].
        time: The shorter relaxation time [s].
    """
    slower = 0.5 * (second_moment / time**2 - viscosity / time)
    faster = viscosity / time - 2.0 * slower
    rates = jnp.stack([jnp.full_like(faster, 1.0 / time), jnp.full_like(faster, 0.5 / time)])
    return jnp.stack([faster, slower]), rates


def _sinc_over_geometric(order: Float[Array, "*space"], spacing: float) -> Float[Array, "*space"]:
    # sin(pi order) / pi over 1 - exp(-spacing (1 - order)): near order 1 by series, which keep value and slope there.
    gap = 1.0 - order
    small = gap < 1e-3
    safe = jnp.where(small, 1.0, gap)
    x = spacing * gap
    series = (1.0 + x / 2.0 + x**2 / 12.0) * (1.0 - (jnp.pi * gap) ** 2 / 6.0) / spacing
    return jnp.where(small, series, jnp.sin(jnp.pi * safe) / jnp.pi / -jnp.expm1(-spacing * safe))


def _mittag_leffler_nodes(order, n_branches: int, limits: tuple[float, float], xp):
    # As `relaxation_spectrum` between two logarithms of the rate; in NumPy or in JAX, whichever `xp` is.
    width = xp.sin(xp.clip(np.pi * (1.0 - order) / order, _NARROWEST, 0.5 * np.pi))
    start, stop = (xp.arcsinh(np.sinh(limit) / width) for limit in limits)
    spacing = (stop - start) / (n_branches - 1)
    position = np.arange(-_BEYOND, n_branches).reshape((-1,) + (1,) * np.ndim(order))
    log_rate = _unstretched(start[None] + position * spacing[None], width[None], xp)
    straight = xp.tanh(log_rate) ** 2
    slope = xp.sqrt(straight + width[None] ** 2 * (1.0 - straight))
    weights = spacing[None] * slope * _density(order[None], log_rate, xp)
    rates = xp.exp(log_rate)
    below = _weight_beyond(order, -log_rate[0], spacing, xp) - weights[0]
    slow, fast = weights[: _BEYOND + 1], _weight_beyond(order, log_rate[-1], spacing, xp)
    slow_weight = xp.sum(slow, axis=0) + below
    slow_rate = xp.sum(slow * rates[: _BEYOND + 1], axis=0) / slow_weight
    all_weights = xp.concatenate([slow_weight[None], weights[_BEYOND + 1 : -1], fast[None]])
    return (
        xp.concatenate([slow_rate[None], rates[_BEYOND + 1 :]]),
        all_weights / xp.sum(all_weights, axis=0, keepdims=True),
    )


def _unstretched(stretched, width, xp):
    # x of s. Far out the two differ by a constant; there the hyperbolic sine would overflow.
    near = xp.arcsinh(width * xp.sinh(xp.clip(stretched, -_FAR, _FAR)))
    return xp.where(xp.abs(stretched) < _FAR, near, stretched + xp.sign(stretched) * xp.log(width))


def _density(order, log_rate, xp):
    # h(x) over h(0), without overflow and with its limit at order 1.
    decrement = order * xp.abs(log_rate)
    peak = 4.0 * xp.cos(0.5 * np.pi * order) ** 2 * xp.exp(-decrement)
    return peak / (xp.expm1(-decrement) ** 2 + peak)


def _weight_beyond(order, log_rate, spacing, xp):
    # The rule's sum from a node on (the node included), over h(0): the integral in closed form and two terms of
    # Euler and Maclaurin. So far out nodes are even in x.
    decay = xp.exp(-order * log_rate)
    angle = np.pi * order
    integral = 2.0 / order * xp.arctan2(xp.sin(angle) * decay, 1.0 + xp.cos(angle) * decay)
    density = _density(order, log_rate, xp)
    steepness = order * (1.0 - decay**2) / (1.0 + decay**2 + 2.0 * xp.cos(angle) * decay)
    over_peak = integral / xp.tan(0.5 * angle)
    return over_peak + density * (0.5 * spacing + steepness * spacing**2 / 12.0)


def _limits(time_window: TimeWindow, margins: tuple[float, float]) -> tuple[float, float]:
    return float(np.log(margins[0] / time_window[1])), float(np.log(margins[1] / time_window[0]))


@functools.cache
def _margins(n_branches: int, time_window: TimeWindow) -> tuple[float, float]:
    # Slow and fast margin with the smallest error for the worst order.
    pairs = [(slow, fast) for slow in _SLOW_MARGINS for fast in _FAST_MARGINS]
    return min(pairs, key=lambda margins: np.max(_error(_ORDERS, n_branches, time_window, margins)))


def _errors(n_branches: int, time_window: TimeWindow) -> Float[np.ndarray, " order"]:
    return _error(_ORDERS, n_branches, time_window, _margins(n_branches, time_window))


def _error(
    orders: tuple[float, ...], n_branches: int, time_window: TimeWindow, margins: tuple[float, float]
) -> Float[np.ndarray, " order"]:
    ours = _kernels(orders, n_branches, time_window, margins)
    return np.max(np.abs(ours - _exact(orders, time_window)), axis=0)


def _kernels(
    orders: tuple[float, ...], n_branches: int, time_window: TimeWindow, margins: tuple[float, float]
) -> Float[np.ndarray, "time order"]:
    limits = _limits(time_window, margins)
    rates, weights = _mittag_leffler_nodes(np.asarray(orders), n_branches, limits, np)
    times = np.geomspace(*time_window, 40)
    return np.sum(weights * np.exp(-times[:, None, None] * rates), axis=1)


@functools.cache
def _exact(orders: tuple[float, ...], time_window: TimeWindow) -> Float[np.ndarray, "time order"]:
    return _kernels(orders, 400, time_window, (1e-7, 40.0))


def _check(n_branches: int, time_window: TimeWindow) -> None:
    if n_branches < 3 or not 0.0 < time_window[0] < time_window[1]:
        raise InputError(f"need `n_branches` >= 3 and 0 < shortest < longest, got {n_branches} and {time_window}.")
