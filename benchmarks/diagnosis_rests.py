"""What the best stand-in among the causes leaves of an effect without a name, and who could see that."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import stats

from benchmarks.diagnosis_limits import DRAWN_UNKNOWN, Design, Limits
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.cause import Extension, every_shape
from inverse.diagnosis.dma.extended_fit import fit_extended
from inverse.diagnosis.dma.problem import DmaProblem
from inverse.diagnosis.examination import LEAST_VISIBILITY
from inverse.diagnosis.noise import Noise, noise_family
from inverse.diagnosis.projection import unit_columns, visibility
from inverse.diagnosis.rule import UNEXPLAINED_LEVEL
from inverse.diagnosis.screening import Alternative, Screen
from tests.blind.no_such_effect import NoSuchEffect

Effects = Mapping[str, Iterable[Float[np.ndarray, " n"]]]


def removed_limits(
    quiet: Callable[[str, float], tuple[DmaProblem, float]], names: Sequence[str], strengths: Sequence[float]
) -> Limits:
    """What the best stand-in leaves of a cause that is not in the library, and who could see that.

    Args:
        quiet: Data with a hidden effect of a d' without noise, fitted; and the size that the noise would have.
        names: Causes to take out.
        strengths: d'.

    Returns:
        By d', then by cause: the stand-in, the d' that it leaves, and the power of the best test of that one direction,
        at the level of `unexplained`, with the noise known and unknown. Where no strength of a cause has that d', why.
    """
    found: Limits = {}
    for d_prime in strengths:
        for name in names:
            try:
                problem, size = quiet(name, d_prime)
            except NoSuchEffect as impossible:
                found.setdefault(f"{d_prime:g}", {})[name] = {"why": str(impossible)}
                continue
            refit = min(_stand_ins(problem, name), key=lambda one: one.misfit)
            left = refit.residuals / size
            length = float(np.linalg.norm(left))
            found.setdefault(f"{d_prime:g}", {})[name] = {
                "stand-in": refit.extensions[0].cause.name,
                "left": length,
                "noise known": _power_of_known(length, UNEXPLAINED_LEVEL),
                "noise unknown": _power(refit.directions, _family(problem), left, UNEXPLAINED_LEVEL),
            }
    return found


def _stand_ins(problem: DmaProblem, name: str):
    """All other causes, refitted in full: far from the fit another one is nearest than about it."""
    fitted, residuals = problem.fitted_directions(), problem.residuals()
    basis = np.linalg.qr(unit_columns(fitted))[0]
    extensions = every_shape(cause for cause in DMA_CAUSES if cause.name != name)
    nearest: dict[str, tuple[float, float, Extension]] = {}
    for extension, alternative in zip(extensions, problem.directions(extensions), strict=True):
        if visibility(alternative.directions, fitted)[0] <= LEAST_VISIBILITY:
            continue
        direction = (alternative.directions - basis @ (basis.T @ alternative.directions))[:, 0]
        strength = float(direction @ residuals / (direction @ direction))
        strength = max(strength, 0.0) if alternative.sign > 0 else strength
        taken = abs(strength) * float(np.linalg.norm(direction))
        if taken >= nearest.get(alternative.name, (0.0,))[0]:
            nearest[alternative.name] = taken, strength, extension
    white = _family(problem)[0]
    for _, strength, extension in nearest.values():
        yield fit_extended(problem, [extension], white, np.array([strength]), library=DMA_CAUSES, profile=False)


def _family(problem: DmaProblem) -> Sequence[Noise]:
    return noise_family(problem.orderings(), problem.frequencies())


def linear_rests(
    designs: Sequence[Design], effects: Sequence[Effects], strengths: Sequence[float], *, level: float
) -> Limits:
    """The same on linear data, of several effects of a name and about several fits: means over all of them.

    Args:
        designs: Linearised fits.
        effects: For each of these effects of d' = 1 by name; a cause of that name is none that may stand in.
        strengths: d'.
        level: p-value below which what is left is conspicuous.

    Returns:
        As `removed_limits` does, with the stand-in that is the best most often.
    """
    found: Limits = {}
    for d_prime in strengths:
        rests: dict[str, list[dict[str, Any]]] = {}
        for design, of_design in zip(designs, effects, strict=True):
            for name, several in of_design.items():
                rests.setdefault(name, []).extend(_rest(design, d_prime * one, name, level) for one in several)
        found[f"{d_prime:g}"] = {name: _mean(part) for name, part in rests.items()}
    return found


def _rest(design: Design, effect: Float[np.ndarray, " n"], name: str, level: float) -> dict[str, Any]:
    basis = np.linalg.qr(unit_columns(design.fitted))[0]
    whole = effect - basis @ (basis.T @ effect)
    left, stand_in, directions = whole, "none", design.fitted
    for one in design.alternatives:
        if one.name == name:
            continue
        along = (one.directions - basis @ (basis.T @ one.directions))[:, 0]
        strength = float(along @ whole / (along @ along))
        strength = one.sign * max(one.sign * strength, 0.0) if one.sign else strength
        after = whole - strength * along
        if np.linalg.norm(after) < np.linalg.norm(left):
            left, stand_in = after, one.name
            directions = np.column_stack([design.fitted, one.directions])
    length = float(np.linalg.norm(left))
    return {
        "stand-in": stand_in,
        "left": length,
        "noise known": _power_of_known(length, level),
        "noise unknown": _power(directions, design.family, left, level),
    }


def _mean(rests: Sequence[dict[str, Any]]) -> dict[str, Any]:
    often = Counter(one["stand-in"] for one in rests).most_common(1)[0][0]
    return {"stand-in": often} | {
        key: float(np.mean([one[key] for one in rests])) for key in ("left", "noise known", "noise unknown")
    }


def _power_of_known(length: float, level: float) -> float:
    """Of the test that knows the direction of what is left, and the noise."""
    return float(stats.norm.cdf(length - stats.norm.isf(level)))


def _power(
    directions: Float[np.ndarray, "n p"], family: Sequence[Noise], left: Float[np.ndarray, " n"], level: float
) -> float:
    """Of the test that knows the direction of what is left, and not the noise."""
    screen = Screen(directions, [Alternative("left", left[:, None], 1)], family)
    if not screen.alternatives:
        return level
    noise = np.random.default_rng(0).standard_normal((len(left), DRAWN_UNKNOWN))
    threshold = np.quantile(screen.statistics(noise).log_p[0], level)
    return float(np.mean(screen.statistics(left[:, None] + noise).log_p[0] <= threshold))
