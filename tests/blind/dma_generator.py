"""Dynamic mechanical analyses with a hidden effect, and a sealed key. Shares no code with the package.

The solid, the effects, their derivatives and the projection are written out here; frequencies, temperatures, times,
constants and noise are drawn for each seed. `write` puts a CSV file that a person might have measured in one
place and what was hidden in another. The strength is set by d': the length of the effect on the data after everything
that a fit of the Zener solid can imitate is taken off, in standard deviations of the noise. The fit is made,
on data without noise: a projection in one linearisation overstates effects of a tenth of the modulus and more (a second
relaxation of 9 by projection leaves 5 after the fit).

The solid is the fractional one, or the conventional one of one relaxation time, measured more closely: little is left
of its loss at both ends of a sweep, and noise should seldom make that negative.

Tests use seeds from `TEST_SEEDS` on; `benchmarks.diagnosis_record` says which ones were used in development, and which
are of rates.
"""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import optimize

from tests.blind.no_such_effect import NoSuchEffect

TEST_SEEDS = 20_000
NOISE, NOISE_OF_CONVENTIONAL = 0.02, 0.003


@dataclasses.dataclass(frozen=True)
class Measurement:
    """What is the same for all rows of one measurement, arrays by sweep and frequency; noise of each part of it."""

    temperature: np.ndarray
    frequency: np.ndarray
    constants: np.ndarray
    clock: np.ndarray
    conventional: bool = False
    parts: tuple[float, float] = (1.0, 1.0)

    @property
    def noise(self) -> float:
        """Standard deviation of the logarithm of the modulus."""
        return noise_size(conventional=self.conventional)

    @property
    def omega(self) -> np.ndarray:
        return 2.0 * np.pi * self.frequency

    @property
    def elapsed(self) -> np.ndarray:
        """Share of each sweep that has passed."""
        begun = self.clock.min(axis=1, keepdims=True)
        return (self.clock - begun) / (self.clock.max(axis=1, keepdims=True) - begun)


def noise_size(*, conventional: bool = False) -> float:
    """Of measurements of either solid."""
    return NOISE_OF_CONVENTIONAL if conventional else NOISE


def draw_measurement(rng: np.random.Generator, *, shuffled: bool = False, conventional: bool = False) -> Measurement:
    """Liver on its way from raw to cooked: five temperatures, fourteen frequencies."""
    temperature = np.array([21.0, 35.0, 50.0, 65.0, 80.0]) + rng.uniform(-1.0, 1.0, 5)
    frequency = np.geomspace(0.1, 200.0, 14) * np.exp(rng.uniform(-0.05, 0.05, 14))
    relaxed = np.array([1.1e3, 1.1e3, 4.5e3, 3.5e4, 6e4]) * np.exp(rng.normal(0.0, 0.15, 5))
    branch = np.array([1.5e3, 1.6e3, 1.8e4, 1.3e5, 1.7e5]) * np.exp(rng.normal(0.0, 0.15, 5))
    time = np.array([0.01, 0.01, 0.005, 0.01, 0.01]) * np.exp(rng.normal(0.0, 0.3, 5))
    order = np.array([0.5, 0.5, 0.45, 0.4, 0.4]) + rng.uniform(-0.05, 0.05, 5)
    if conventional:
        time, order = 3.0 * time, np.ones(5)  # the relaxation in the middle of the sweep, some loss at both of its ends
    constants = np.stack([relaxed, branch, time, order], axis=-1)
    taken = 3.0 + 2.0 / frequency  # seconds to settle, and two cycles
    clock = np.zeros((5, 14))
    now = 0.0
    for sweep in range(5):
        for index in rng.permutation(14) if shuffled else range(14):
            now += taken[index]
            clock[sweep, index] = now
        now += 60.0  # to the next temperature
    return Measurement(temperature, frequency, constants, clock, conventional)


def solid(constants: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Modulus by sweep and frequency."""
    relaxed, branch, time, order = (constants[:, index, None] for index in range(4))
    power = (1j * omega * time) ** order
    return relaxed + branch * power / (1.0 + power)


Effect = Callable[[np.ndarray, Measurement, float], np.ndarray]
_FRICTION = 4.0 / (3.0 * np.pi)


def _place_in_sweep(m: Measurement, place: float) -> float:
    low, high = m.omega.min(), m.omega.max()
    return float(np.exp(-(1.0 - place) * np.log(low) - place * np.log(high)))


def _mean_modulus(modulus: np.ndarray) -> np.ndarray:
    return np.exp(np.mean(np.log(np.abs(modulus)), axis=1, keepdims=True))


def _resonance(g: np.ndarray, m: Measurement, s: float) -> np.ndarray:
    x = m.frequency / (1.6 * m.frequency.max())
    return g + g * s * x**2 / (1.0 - x**2 + 0.1j * x)


def _lag(g: np.ndarray, m: Measurement, s: float) -> np.ndarray:
    earlier = solid(m.constants[[0, 0, 1, 2, 3]], m.omega)
    weight = s * np.exp(-m.elapsed / 0.35)
    return g ** (1.0 - weight) * earlier**weight


def _second(g: np.ndarray, m: Measurement, s: float) -> np.ndarray:
    z = 1j * m.omega * _place_in_sweep(m, 0.55)
    return g + s * _mean_modulus(g) * z / (1.0 + z)


def _drainage(g: np.ndarray, m: Measurement, s: float) -> np.ndarray:
    x = np.sqrt(1j * m.omega * _place_in_sweep(m, 0.9))
    return g + s * _mean_modulus(g) * (1.0 - np.tanh(x) / x)


def _drying(g: np.ndarray, m: Measurement, s: float) -> np.ndarray:
    pressure = 610.94 * np.exp(17.625 * m.temperature / (243.04 + m.temperature))
    order = np.argsort(m.clock.ravel())
    clock, rate = m.clock.ravel()[order], np.repeat(pressure, m.clock.shape[1])[order]
    lost = np.concatenate([[0.0], np.cumsum(np.diff(clock) * 0.5 * (rate[1:] + rate[:-1]))])
    placed = np.empty_like(lost)
    placed[order] = lost / lost[-1]
    return g * (1.0 + s * placed.reshape(g.shape))


def _power_law(g: np.ndarray, m: Measurement, s: float) -> np.ndarray:
    return g * solid(m.constants - [0.0, 0.0, 0.0, s], m.omega) / solid(m.constants, m.omega)


EFFECTS: dict[str, Effect] = {
    "instrument-inertia": lambda g, m, s: g - s * m.omega**2,
    "frame-resonance": _resonance,
    "phase-delay": lambda g, m, s: g * np.exp(1j * m.omega * s),
    "noise-floor": lambda g, m, s: g * np.sqrt(1.0 + s / np.abs(g) ** 2),
    "slip": lambda g, m, s: g * (1.0 - s * np.abs(g) / np.abs(g).max() * (1.0 - 1j * _FRICTION)),
    "sweep-drift": lambda g, m, s: g * (1.0 + s * m.elapsed),
    "drying": _drying,
    "bath-viscosity": lambda g, m, s: g + 1j * s * m.omega,
    "temperature-lag": _lag,
    "second-relaxation": _second,
    "poroelastic-drainage": _drainage,
    "strain-nonlinearity": lambda g, m, s: g * (1.0 - s * np.abs(g).min() / np.abs(g) * (1.0 - 1j * _FRICTION)),
    "clamp-compliance": lambda g, m, s: g / (1.0 + s * g),
    "power-law-relaxation": _power_law,
}
"""Named effects, as a person who knows the physics would write them down."""


def shown(*, conventional: bool = False) -> list[str]:
    """Names of effects that a fit of the solid does not imitate."""
    imitated = {"clamp-compliance"} if conventional else {"clamp-compliance", "power-law-relaxation"}
    return [name for name in EFFECTS if name not in imitated]


BOTH_WAYS = ("phase-delay", "sweep-drift", "frame-resonance", "strain-nonlinearity")
"""Effects of either sign: which one is drawn, unless the strength is given."""

SCALES = {
    "instrument-inertia": 1e-5,
    "phase-delay": 1e-6,
    "noise-floor": 1e3,
    "bath-viscosity": 1e-3,
    "clamp-compliance": 1e-10,
}
"""Small strengths, for derivatives; 1e-4 for the others."""


def _bump(m: Measurement, rng: np.random.Generator) -> np.ndarray:
    centre = rng.uniform(2, 11)
    shape = np.exp(-0.5 * (np.arange(14) - centre) ** 2)
    return np.broadcast_to((shape if rng.uniform() < 0.5 else 1j * shape)[None, :], m.clock.shape)


def _smooth(m: Measurement, rng: np.random.Generator) -> np.ndarray:
    x = np.log(m.frequency / m.frequency.min()) / np.log(m.frequency.max() / m.frequency.min())
    distance = (x[:, None] - x[None, :]) / 0.2
    root = np.linalg.cholesky(np.exp(-0.5 * distance**2) + 1e-9 * np.eye(14))
    return np.broadcast_to(
        (root @ rng.standard_normal(14) + 1j * (root @ rng.standard_normal(14)))[None], m.clock.shape
    )


def _mains(m: Measurement, rng: np.random.Generator) -> np.ndarray:
    line = (np.abs(np.log(m.frequency / 50.0)) == np.abs(np.log(m.frequency / 50.0)).min()).astype(float)
    return np.broadcast_to((line * np.exp(1j * rng.uniform(0, 2 * np.pi)))[None, :], m.clock.shape)


def _one_temperature(m: Measurement, rng: np.random.Generator) -> np.ndarray:
    chosen = (np.arange(5) == rng.integers(5)).astype(float)
    return chosen[:, None] * _smooth(m, rng)


UNDERSTATED = 1.3
UNEQUAL = "unequal"
"""Noise of which magnitude or phase, by chance, has four times that of the other, d' counted in it."""
UNEQUAL_PARTS = (0.5, 2.0)
IN_TIME = "correlated-in-time"
"""Noise of which neighbours are those in time, in sweeps that take frequencies in random order."""

UNKNOWN = {"bump": _bump, "smooth": _smooth, "mains": _mains, "one-temperature": _one_temperature}
"""Changes of the logarithm of the modulus that are in no list."""


def draw_noise(kind: str, m: Measurement, rng: np.random.Generator) -> np.ndarray:
    """Complex noise of the logarithm of the modulus, of the measurement's `parts` (but for `loud`, `none`)."""
    shape = (*m.clock.shape, 2)
    if kind == "none":
        return np.zeros(m.clock.shape, dtype=complex)
    if kind == "tails":
        parts = rng.standard_t(4, shape) / np.sqrt(2.0)
    elif kind.startswith("correlated"):
        rho = float(kind.rpartition("-")[2])
        drawn = rng.standard_normal(shape)
        for index in range(1, shape[1]):
            drawn[:, index] = rho * drawn[:, index - 1] + np.sqrt(1.0 - rho**2) * drawn[:, index]
        parts = drawn.copy()
        if kind.startswith(IN_TIME):
            np.put_along_axis(parts, np.argsort(m.clock, axis=1)[..., None], drawn, axis=1)
    else:
        parts = rng.standard_normal(shape)
    if kind == "loud":
        parts = parts * np.where(m.frequency > 40.0, 3.0, 1.0)[None, :, None]
    parts = parts * m.parts
    return parts[..., 0] + 1j * parts[..., 1]


def real(values: np.ndarray) -> np.ndarray:
    """Real and imaginary parts in one vector."""
    return np.concatenate([values.real.ravel(), values.imag.ravel()])


def length_after_fit(m: Measurement, logarithm: np.ndarray) -> float:
    """Of the difference between a logarithm of the modulus and the closest Zener solid of each sweep."""
    found = [_closest(m, logarithm, m.constants * factors) for factors in _STARTS]
    return float(np.sqrt(np.sum(np.min(found, axis=0))))


def _closest(m: Measurement, logarithm: np.ndarray, constants: np.ndarray) -> np.ndarray:
    """Least sum of squares of each sweep, by Levenberg's and Marquardt's method from given constants."""
    free = 3 if m.conventional else 4
    constants = np.minimum(constants, [np.inf, np.inf, np.inf, 0.95])
    constants[:, free:] = 1.0
    damping, steps = np.full(5, 1e-3), 1e-5 * np.eye(4)[:free]
    squares, left = _distance(m, logarithm, constants)
    for _ in range(_ITERATIONS):
        slopes = []
        for step in steps:
            up, down = (_distance(m, logarithm, constants * (1.0 + sign * step))[1] for sign in (1.0, -1.0))
            slopes.append((down - up) / 2e-5)
        jacobian = np.stack(slopes, axis=-1)
        normal = np.einsum("sni,snj->sij", jacobian, jacobian)
        gradient = np.einsum("sni,sn->si", jacobian, left)
        scale = damping[:, None] * np.diagonal(normal, axis1=1, axis2=2) + 1e-14
        step = np.linalg.solve(normal + scale[:, :, None] * np.eye(free), gradient[..., None])[..., 0]
        tried = constants.copy()
        tried[:, :free] *= np.exp(np.clip(step, -1.0, 1.0))
        tried[:, 3] = np.minimum(tried[:, 3], 1.0)
        new_squares, new_left = _distance(m, logarithm, tried)
        better = new_squares < squares
        still = (better & (squares - new_squares > 1e-7 * m.noise**2)) | (~better & (damping < 1e4))
        constants = np.where(better[:, None], tried, constants)
        left = np.where(better[:, None], new_left, left)
        squares = np.where(better, new_squares, squares)
        damping = np.where(better, 0.2 * damping, 5.0 * damping)
        if not np.any(still):
            break
    return squares


_STARTS = ((1.0, 1.0, 1.0, 1.0), (0.6, 1.5, 0.1, 0.7), (1.2, 0.8, 1.5, 1.4))
_ITERATIONS = 200


def _distance(m: Measurement, logarithm: np.ndarray, constants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squares of each sweep, and the differences."""
    difference = logarithm - np.log(solid(constants, m.omega))
    parts = np.concatenate([difference.real / m.parts[0], difference.imag / m.parts[1]], axis=1)
    return np.sum(parts**2, axis=1), parts


def sign_of(name: str, seed: int) -> float:
    """Which way an effect goes that may go either way; drawn beside everything else."""
    return float(np.random.default_rng([seed, 20161231, 1]).choice((-1.0, 1.0))) if name in BOTH_WAYS else 1.0


def parts_of(noise: str, seed: int) -> tuple[float, float]:
    """Noise of magnitude and phase over that of both; which is larger is drawn beside everything else."""
    if noise != UNEQUAL:
        return 1.0, 1.0
    turned = np.random.default_rng([seed, 20161231, 2]).uniform() < 0.5
    return UNEQUAL_PARTS[::-1] if turned else UNEQUAL_PARTS


def hidden(
    m: Measurement, name: str, d_prime: float, rng: np.random.Generator, sign: float = 1.0
) -> tuple[np.ndarray, float]:
    """Logarithm of the modulus with the effect in it, and the strength; of `one+other` both, and that of the first.

    Each of two has the strength that it needs by itself, and is positive.
    """
    plain = solid(m.constants, m.omega)
    if "+" in name:
        first, second = name.split("+")
        strengths = [hidden(m, one, d_prime, rng)[1] for one in (first, second)]
        return np.log(EFFECTS[second](EFFECTS[first](plain, m, strengths[0]), m, strengths[1])), strengths[0]
    if name == "none":
        return np.log(plain), 0.0
    if name in UNKNOWN:
        direction = UNKNOWN[name](m, rng)

        def changed(strength: float) -> np.ndarray:
            return np.log(plain) + strength * direction

    else:

        def changed(strength: float) -> np.ndarray:
            return np.log(EFFECTS[name](plain, m, sign * strength))

    def excess(logarithm_of_strength: float) -> float:
        return np.log(length_after_fit(m, changed(np.exp(logarithm_of_strength))) / (d_prime * m.noise))

    # Strong effects bend, so that the strength is solved for, from what a weak one would have to be scaled to.
    weak = np.log(SCALES.get(name, 1e-4))
    high = low = weak - excess(weak)
    while excess(high) < 0.0:
        low, high = high, high + 0.3
        if high > weak + 25.0:
            raise NoSuchEffect(f"no strength of {name} leaves d' = {d_prime:g}")
    while excess(low) > 0.0:
        low -= 0.3
    strength = float(np.exp(optimize.brentq(excess, low, high, xtol=1e-3)))
    return changed(strength), sign * strength


def write(
    data: Path,
    key: Path,
    *,
    seed: int,
    name: str = "none",
    d_prime: float = 4.5,
    noise: str = "white",
    shuffled: bool = False,
    strength: float | None = None,
    conventional: bool = False,
) -> None:
    """Simulate one measurement; the file in `data` says nothing of what is in `key`.

    A named effect has the given strength instead of `d_prime`, for those that no strength shows. In noise that is
    `understated` the file gives standard deviations, which are `UNDERSTATED` times too small. Frequencies come in
    random order where that is asked for, and in noise `IN_TIME`.
    """
    rng = np.random.default_rng([seed, 20161231])
    m = draw_measurement(rng, shuffled=shuffled or noise.startswith(IN_TIME), conventional=conventional)
    m = dataclasses.replace(m, parts=parts_of(noise, seed))
    asked = d_prime if strength is None else None
    if strength is None:
        logarithm, strength = hidden(m, name, d_prime, rng, sign_of(name, seed))
    else:
        logarithm = np.log(EFFECTS[name](solid(m.constants, m.omega), m, strength))
    modulus = np.exp(logarithm + m.noise * draw_noise(noise, m, rng))
    order = np.argsort(m.clock.ravel())
    columns = (
        np.tile(m.frequency, 5),
        np.repeat(m.temperature, 14),
        modulus.real.ravel(),
        modulus.imag.ravel(),
        m.clock.ravel(),
    )
    header = "frequency_hz,temperature_c,storage_modulus_pa,loss_modulus_pa,time_s"
    if noise == "understated":
        deviation = m.noise / UNDERSTATED * np.abs(modulus.ravel())
        columns = (*columns, deviation, deviation)
        header += ",storage_modulus_sd_pa,loss_modulus_sd_pa"
    rows = np.stack(columns, axis=-1)[order]
    left_out = int(np.sum(rows[:, 3] <= 0.0))
    rows = rows[rows[:, 3] > 0.0]  # a person leaves out a loss modulus that noise made negative
    np.savetxt(data, rows, delimiter=",", header=header, comments="", fmt="%.10g")
    hides = {"seed": seed, "hidden": name, "strength": strength, "d_prime": asked, "noise": noise}
    hides |= {"rows_left_out": left_out, "noise_of_parts": m.parts}
    key.write_text(json.dumps(hides | {"strength_of_readings": strength * _readings(name, m, modulus)}))


def _readings(name: str, m: Measurement, modulus: np.ndarray) -> float:
    """Strength for a reader, who knows no modulus of the solid alone in which it is counted here, over the one here."""
    alone, read = np.abs(solid(m.constants, m.omega)), np.abs(modulus)
    if name == "slip":
        return float(read.max() / alone.max())
    if name == "strain-nonlinearity":
        return float(alone.min() / read.min())
    if name in ("second-relaxation", "poroelastic-drainage"):
        return float(np.exp(np.mean(np.log(alone / read))))
    return 1.0
