"""Curves of displacement with a hidden effect, and a sealed key. Shares no code with `inverse`.

Sonications are simulated reading by reading with the full solid on a mesh and time steps of its own
(`hmi_simulator`); the diagnosis uses a fast simulation that learnt from another mesh. Effects (`hmi_effects`) are
written out as a person who knows the physics would: a thermocouple's lag is its differential equation, not an
expansion. Each seed has one of `TISSUES` sets of constants (what they can imitate takes a minute to find), and noise of
its own. Constants are normal with 0.6 of the standard deviation that is believed, none beyond 0.9 of it: farther out
some tissues cannot be, such as one that softens as it coagulates.

The strength is set by d': the length of the effect on the logarithm of displacement, at that strength and on the mesh
of the data, after projecting out the constants and a factor of each sonication, in standard deviations of the noise.
(A small effect on a coarser mesh, scaled up, was two to four times too long for effects on heat and thermometer.)

Tests use seeds from `TEST_SEEDS` on; `benchmarks.diagnosis_record` says which ones were used in development, and which
are of rates.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.blind.hmi_effects import BOTH_WAYS, EFFECTS, UNKNOWN, UNSEEN
from tests.blind.hmi_simulator import FINAL, Simulator, groups, readings
from tests.blind.no_such_effect import NoSuchEffect

TEST_SEEDS = 20_000
NOISE = 0.01
TISSUES = 6
"""Sets of constants among the development seeds, and as many others among the test seeds."""


def _projected(columns: np.ndarray, direction: np.ndarray) -> float:
    basis, singular, _ = np.linalg.svd(
        columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), full_matrices=False
    )
    basis = basis[:, singular > 1e-9 * singular[0]]
    return float(np.linalg.norm(direction - basis @ (basis.T @ direction)))


FIRST_STRENGTH = {
    "thermocouple-lag": 0.1, "thermocouple-position": 0.02, "thermocouple-viscous-heating": 0.5, "perfusion": 0.2,
    "conductivity-change": 0.2, "damage-law": 0.25, "output-drift": 0.033, "cavitation": 0.04,
    "lesion-stiffness-law": 0.2, "pre-ablation-softening": 0.11, "attenuation-kinetics": 0.2,
    "thermal-decorrelation": 0.015, "echo-strain": 0.025, "normalisation-temperature": 0.5, "thermal-lens": 0.05,
    "exponent-change": 0.05, "sound-speed-change": 5.0, "lesion-rim": 0.2, "fractional-tissue": 0.1,
    "acoustic-saturation": 0.1, "near-boundary": 0.02, "tracking-compression": 0.1, "tracking-jitter": 0.1,
}  # fmt: skip
"""For each d' and percent of noise, where the search for a strength starts."""
ITERATIONS, CLOSE = 20, 0.03
"""How many strengths are tried, and how close d' has to be."""


def sign_of(name: str, seed: int) -> float:
    """Which way an effect goes that may go either way; drawn beside everything else."""
    return float(np.random.default_rng([seed, 20161231, 1]).choice((-1.0, 1.0))) if name in BOTH_WAYS else 1.0


def strength_of(
    ruler: Simulator,
    z: np.ndarray,
    change: Callable[[np.ndarray, float], np.ndarray],
    d_prime: float,
    name: str,
    first: float = 0.1,
) -> float:
    """Strength at which an effect has a projected length; measured at that strength, because effects bend.

    Args:
        ruler: Measures what the constants can imitate, and the effect.
        z: Constants.
        change: Of the logarithms without the effect, at a strength, over the size of the noise.
        d_prime: The length.
        name: Of the effect, for messages.
        first: Strength to start from.

    Raises:
        NoSuchEffect: if no strength has it.
    """
    plain, imitated = ruler.curves(z)[0], ruler.imitated(z)
    strength, length = first, np.nan
    short: tuple[float, float] | None = None
    long: tuple[float, float] | None = None
    for _ in range(ITERATIONS):
        length = _projected(imitated, change(plain, strength))
        if abs(length / d_prime - 1.0) < CLOSE:
            return strength
        known = bool(np.isfinite(length)) and length > 0.0
        if known and length < d_prime:
            short = (strength, length)
        elif known:
            long = (strength, length)
        if short and long:
            # What constants imitate to first order grows with the square at least: by its logarithm, within bounds.
            share = np.log(d_prime / short[1]) / np.log(long[1] / short[1])
            strength = float(short[0] * (long[0] / short[0]) ** np.clip(share, 0.1, 0.9))
        else:
            # Without a length there is no such tissue, or no effect.
            strength *= float(np.clip(d_prime / length, 0.2, 5.0)) if known else 0.5
    raise NoSuchEffect(f"no strength of {name} found with d' = {d_prime:g}: the last, {strength:g}, has {length:g}.")


def draw_noise(kind: str, temperature: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Noise of the logarithm of displacement, of standard deviation 1 (but for `loud`)."""
    group = groups()
    if kind == "tails":
        return rng.standard_t(4, len(group)) / np.sqrt(2.0)
    drawn = rng.standard_normal(len(group))
    if kind.startswith("correlated"):
        rho = float(kind.removeprefix("correlated-"))
        for i in range(1, len(group)):
            if group[i] == group[i - 1]:
                drawn[i] = rho * drawn[i - 1] + np.sqrt(1.0 - rho**2) * drawn[i]
    return drawn * np.where(temperature > 60.0, 3.0, 1.0) if kind == "loud" else drawn


def write(
    data: Path,
    key: Path,
    *,
    fine: Simulator,
    ruler: Simulator,
    seed: int,
    name: str = "none",
    d_prime: float = 4.5,
    noise: str = "white",
    size: float = NOISE,
    strength: float | None = None,
) -> None:
    """Simulate one measurement; the file in `data` says nothing of what is in `key`.

    Args:
        data: File of the measurement.
        key: File of what is hidden in it.
        fine: Simulates the measurement.
        ruler: Measures the strength; uniformly warm, because one by points takes minutes.
        seed: Of constants and noise.
        name: Of the effect.
        d_prime: Its strength.
        noise: Kind of noise.
        size: Its relative standard deviation.
        strength: Of the effect, instead of what `d_prime` asks for.
    """
    rng = np.random.default_rng([seed, 20161231])
    tissue = np.random.default_rng([int(rng.integers(TISSUES)), seed >= TEST_SEEDS, 20161231])
    z = np.clip(tissue.standard_normal(9), -1.5, 1.5) * 0.6
    shown = np.concatenate([readings(final) for final in FINAL])
    added, asked = np.zeros(len(shown)), d_prime if strength is None else None
    if name == "none":
        strength = 0.0
    elif name in UNKNOWN:
        direction = UNKNOWN[name](shown, rng)
        if strength is None:
            strength = strength_of(ruler, z, lambda _, s: s * direction / size, d_prime, name)
        added = strength * direction
    elif strength is None:
        first, sign = FIRST_STRENGTH[name] * d_prime * size / NOISE, sign_of(name, seed)
        strength = sign * strength_of(
            ruler, z, lambda plain, s: (ruler.curves(z, name, sign * s)[0] - plain) / size, d_prime, name, first
        )
    logarithm, time = fine.curves(z, name if name in (*EFFECTS, *UNSEEN) else "none", strength)
    read = np.exp(logarithm + added + size * draw_noise(noise, shown, rng))
    first = np.concatenate([[True], np.diff(groups()) > 0])
    percent = 100.0 * read / read[first][groups()]
    labels = np.array([f"{1 + g}" for g in groups()])
    lines = [f"{a},{t:.6g},{s:.6g},{p:.10g}" for a, t, s, p in zip(labels, time, shown, percent, strict=True)]
    data.write_text("\n".join(["sonication,time_s,temperature_c,displacement_percent", *lines]) + "\n")
    key.write_text(
        json.dumps({"seed": seed, "hidden": name, "strength": strength, "d_prime": asked, "noise": noise, "size": size})
    )
