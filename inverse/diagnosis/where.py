"""Where the residuals differ from noise: whiteness along every coordinate, and which free form absorbs how much."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from inverse.diagnosis.decision import Evidence
from inverse.diagnosis.dma_problem import DmaProblem
from inverse.diagnosis.free_forms import Place
from inverse.diagnosis.screening import independent


@dataclasses.dataclass(frozen=True)
class Absorbed:
    """One free form.

    Attributes:
        words: Where it acts.
        share: Part of the sum of squared residuals that it takes away.
        p_family: That noise alone gives any alternative as improbable a value.
        correction: What it adds to the prediction, in weighted residuals.
    """

    words: str
    share: float
    p_family: float
    correction: Float[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True)
class Whiteness:
    """Correlation of residuals of neighbours along one coordinate.

    Attributes:
        along: The coordinate.
        correlation: Of neighbours.
        p_value: That white residuals are as correlated, either way.
    """

    along: str
    correlation: float
    p_value: float


def absorbed_by_places(
    tested: Evidence,
    places: Sequence[Place],
    residuals: Float[np.ndarray, " n"],
    fitted: Float[np.ndarray, "n p"],
) -> tuple[Absorbed, ...]:
    """Free forms by how improbable they are, with what each absorbs."""
    words = {place.name: place.words for place in places}
    basis = independent(fitted)
    left = residuals - basis @ (basis.T @ residuals)
    found = []
    for row in np.argsort(tested.log_p):
        alternative = tested.alternatives[row]
        if alternative.name not in words:
            continue
        directions = alternative.directions - basis @ (basis.T @ alternative.directions)
        span = independent(directions)
        correction = span @ (span.T @ left)
        share = float(correction @ correction / (left @ left))
        found.append(Absorbed(words[alternative.name], share, float(tested.p_family[row]), correction))
    return tuple(found)


def describe_correction(problem: DmaProblem, place: Absorbed) -> str:
    """Where the correction is largest, its sign and its size, in words."""
    relative = (place.correction / problem.weights.ravel()).reshape(problem.weights.shape)
    row, coordinate = np.unravel_index(int(np.argmax(np.abs(relative))), relative.shape)
    frequency = float(problem.conditions.angular_frequency[row]) / (2.0 * np.pi)
    sweep = problem.sweeps[int(problem.conditions.sweep[row])]
    value = float(relative[row, coordinate])
    if coordinate == 0:
        size = f"the measured magnitude is {abs(100.0 * value):.2g} % {'above' if value > 0 else 'below'} the model"
    else:
        size = f"the measured phase is {abs(1e3 * value):.2g} mrad {'above' if value > 0 else 'below'} the model"
    onset = _onset(problem, relative[:, coordinate])
    return f"{place.words}: {size} at most, at {frequency:.3g} Hz ({sweep.label}){onset}"


def _onset(problem: DmaProblem, relative: Float[np.ndarray, " row"]) -> str:
    """The lowest temperature at which the correction reaches half its largest size, if that is not the lowest."""
    sizes = [np.max(np.abs(relative[np.asarray(problem.conditions.sweep) == i])) for i in range(len(problem.sweeps))]
    large = [s.temperature_c for s, size in zip(problem.sweeps, sizes, strict=True) if size >= 0.5 * max(sizes)]
    lowest = min(s.temperature_c for s in problem.sweeps)
    above = [s.temperature_c for s in problem.sweeps if s.temperature_c >= min(large)]
    return f", from {min(large):.0f} degC on" if min(large) > lowest and 1 < len(above) == len(large) else ""


def whiteness(
    problem: DmaProblem,
    residuals: Float[np.ndarray, " n"],
    fitted: Float[np.ndarray, "n p"],
    rng: np.random.Generator,
    *,
    replicates: int = 400,
) -> tuple[Whiteness, ...]:
    """Correlation of neighbouring residuals along frequency, temperature and time.

    Fitted residuals are correlated even if the noise is white: the p-values are against white noise, fitted alike.
    """
    basis = independent(fitted)
    noise = rng.standard_normal((len(residuals), replicates))
    batch = np.concatenate([residuals[:, None], noise - basis @ (basis.T @ noise)], axis=1)
    shaped = (batch / np.sqrt(np.mean(batch**2, axis=0))).reshape(*problem.weights.shape, -1)
    frequency = np.asarray(problem.conditions.angular_frequency)
    sweep, time = np.asarray(problem.conditions.sweep), np.asarray(problem.conditions.time)
    samples = [problem.sweeps[index].sample for index in sweep]
    _, rounded = np.unique(np.round(np.log(frequency), 3), return_inverse=True)
    _, sample = np.unique(samples, return_inverse=True)
    rounded = rounded + (1 + rounded.max()) * sample
    found = []
    for along, keys, position in (
        ("frequency", sweep, frequency),
        ("temperature", rounded, np.asarray(problem.conditions.temperature)),
        ("time", sweep, time),
    ):
        products = []
        for key in np.unique(keys):
            rows = np.flatnonzero(keys == key)
            ordered = shaped[rows[np.argsort(position[rows], kind="stable")]]
            products.append((ordered[1:] * ordered[:-1]).reshape(-1, shaped.shape[-1]))
        if not any(len(part) for part in products):
            continue
        correlation = np.mean(np.concatenate(products), axis=0)
        centred = np.abs(correlation - np.mean(correlation[1:]))
        p_value = (1.0 + np.sum(centred[1:] >= centred[0])) / len(centred)
        found.append(Whiteness(along, float(correlation[0]), float(p_value)))
    return tuple(found)
