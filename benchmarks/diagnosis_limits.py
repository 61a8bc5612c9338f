"""What theory allows: the best that any diagnosis could do on the same designs, linearised about the fit."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.cause import Extension, every_shape
from inverse.diagnosis.dma.problem import DmaProblem
from inverse.diagnosis.examination import LEAST_VISIBILITY
from inverse.diagnosis.noise import Noise, noise_family
from inverse.diagnosis.projection import unit_columns, visibility
from inverse.diagnosis.screening import Alternative, Screen

TRUE_SHAPES = {"frame-resonance": 1.6, "temperature-lag": 0.35, "second-relaxation": 0.55, "poroelastic-drainage": 0.9}
"""What the generator has where a cause has a second parameter."""
_DRAWN, DRAWN_UNKNOWN = 4000, 1000
_LEVEL = 0.05

Limits = dict[str, dict[str, dict[str, Any]]]


@dataclasses.dataclass(frozen=True)
class Design:
    """A measurement about a fit, linearised.

    Attributes:
        fitted: Derivative of the prediction in the fitted constants.
        alternatives: Causes that the data can see, in every shape.
        truths: Effect of d' = 1 of each cause that may be hidden, as the generator has it, by its sign: of those that
            bend, the one of a negative strength is no mirror image. Both signs are where both are hidden and differ.
        family: Noise members, white first.
        free_forms: Corrections of no name; only those who ask what a diagnosis says need them.
        local_forms: Local ones, which are weighed against causes only.
        temperature: Of the readings, if they have one each.
    """

    fitted: Float[np.ndarray, "n p"]
    alternatives: Sequence[Alternative]
    truths: Mapping[str, Mapping[int, Float[np.ndarray, "n 1"]]]
    family: Sequence[Noise]
    free_forms: Sequence[Alternative] = ()
    local_forms: Sequence[Alternative] = ()
    temperature: Float[np.ndarray, " reading"] | None = None


def dma_design(problem: DmaProblem) -> Design:
    """Of one fitted sweep set."""
    fitted = problem.fitted_directions()
    shapes = {cause.name: TRUE_SHAPES.get(cause.name, cause.shapes[0]) for cause in DMA_CAUSES}
    truths = {cause.name: problem.directions([Extension(cause, shapes[cause.name])])[0] for cause in DMA_CAUSES}
    return Design(
        fitted,
        visible(problem.directions(every_shape(DMA_CAUSES)), fitted),
        {name: {1: truth.directions / projected_length(truth.directions, fitted)} for name, truth in truths.items()},
        noise_family(problem.orderings(), problem.frequencies()),
    )


def projected_length(effect: Float[np.ndarray, "n 1"], fitted: Float[np.ndarray, "n p"]) -> float:
    """Of what the fitted constants leave of an effect: its d' in noise of size one."""
    basis = np.linalg.qr(unit_columns(fitted))[0]
    return max(float(np.linalg.norm(effect - basis @ (basis.T @ effect))), 1e-300)


def visible(alternatives: Sequence[Alternative], fitted: Float[np.ndarray, "n p"]) -> list[Alternative]:
    """Those that the fitted constants do not imitate."""
    return [a for a in alternatives if visibility(a.directions, fitted)[0] > LEAST_VISIBILITY]


def limits(designs: Sequence[Design], strengths: Sequence[float]) -> Limits:
    """Detected and ranked first: by the largest projection with the noise known, by likelihood ratio with it unknown.

    Args:
        designs: The limit is the mean over those that can show a cause.
        strengths: d'.

    Returns:
        By d', then by cause.
    """
    of_designs: dict[tuple[str, str, str], list[float]] = {}
    for number, design in enumerate(designs):
        for members, ending, drawn in (
            (design.family[:1], "", _DRAWN),
            (design.family, ", noise unknown", DRAWN_UNKNOWN),
        ):
            for d_prime, name, part in _limits_of(design, strengths, members, drawn, number):
                for key, value in part.items():
                    of_designs.setdefault((f"{d_prime:g}", name, key + ending), []).append(value)
    found: Limits = {}
    for (d_prime, name, key), values in of_designs.items():
        found.setdefault(d_prime, {}).setdefault(name, {})[key] = float(np.mean(values))
    return found


def _limits_of(design: Design, strengths: Sequence[float], family: Sequence[Noise], drawn: int, seed: int):
    rng, fitted = np.random.default_rng(seed), design.fitted
    screen = Screen(fitted, design.alternatives, family)
    owners = np.array([alternative.name for alternative in screen.alternatives])
    noise = rng.standard_normal((fitted.shape[0], drawn))
    evidence = _projections(screen) if len(family) == 1 else lambda data: -screen.statistics(data).log_p
    threshold = np.quantile(evidence(noise).max(axis=0), 1.0 - _LEVEL)
    for name, truths in design.truths.items():
        if name not in owners:  # a diagnosis lists it as one that these data cannot show
            continue
        for d_prime in strengths:
            seen = np.concatenate([evidence(d_prime * truth + noise) for truth in truths.values()], axis=1)
            detected, first = seen.max(axis=0) > threshold, owners[seen.argmax(axis=0)] == name
            yield d_prime, name, {"detected": float(np.mean(detected)), "first": float(np.mean(first))}


def _projections(screen: Screen) -> Callable[[Float[np.ndarray, "n batch"]], Float[np.ndarray, "alternative batch"]]:
    """Projections on all directions, in noise standard deviations; those of the wrong sign count as they are."""
    directions = screen.projected()
    signs = np.array([alternative.sign for alternative in screen.alternatives])[:, None]

    def evidence(data):
        projected = directions.T @ data
        return np.where(signs == 0, np.abs(projected), signs * projected)

    return evidence
