r"""What the data determine and what they leave open, from the Fisher information.

The information of the data alone is taken in coordinates in which one unit is a large change: the logarithm of
positive constants, a value over the width of its range, or over the spread of its prior. A direction along which the
standard deviation exceeds one is *free*: the data do not fix it to a factor of e. Where constants take part in a free
direction, products of their powers stay fixed along it, and those are what the data do determine:

    branch_modulus x relaxation_time^0.275 is determined to 0.4 %, branch_modulus and relaxation_time are not.

An exponent that equals another constant of the fit, here and where that constant is changed, is written by its name.
"""

import dataclasses
import itertools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from inverse.inference.curvature import data_curvature, large_changes, root_of_curvature
from inverse.inference.entries import Varying
from inverse.inference.problem import Problem
from inverse.transforms import LogInterval, Positive

FREE = 1.0
"""Standard deviation of a logarithm, or of a fraction of a range, above which a direction counts as free."""

_SQUARED, _EXACT, _OF_DIFFERENCES = 1e-24, 1e-14, 1e-10
"""Share of the largest eigenvalue that rounding leaves of none: of a Jacobian, a Hessian, differences of gradients."""
_TAKES_PART = 0.05
"""Share of a free direction's largest component below which a constant does not take part in it."""
_SAME_EXPONENT = 0.02
_CHANGE = 0.1
"""Fraction by which a constant is changed to see whether an exponent follows it."""
_DETERMINED = 0.3
"""Relative error up to which a combination is called determined."""
_ALONE = 0.98
"""Share of a constant's own axis in the free directions above which it is free by itself."""


@dataclasses.dataclass(frozen=True)
class Combination:
    """A product of powers of constants that the data determine although they leave its constants open.

    Attributes:
        powers: Exponent of each constant by its name.
        text: It, written out.
        relative_error: Standard deviation of its logarithm [1].
    """

    powers: dict[str, float]
    text: str
    relative_error: float


@dataclasses.dataclass(frozen=True)
class Identification:
    """What the data determine.

    Attributes:
        names: Of the values, in their order.
        eigenvalues: Of the Fisher information in the coordinates above, largest first.
        directions: Its eigenvectors, one a row.
        condition_number: Largest over smallest eigenvalue; infinite where the smallest is not above zero.
        rank: Number of directions that are not free.
        combinations: What is determined of the constants of a single free direction.
        sentences: All of it in words.
    """

    names: tuple[str, ...]
    eigenvalues: Float[np.ndarray, " k"]
    directions: Float[np.ndarray, "k n"]
    condition_number: float
    rank: int
    combinations: tuple[Combination, ...]
    sentences: tuple[str, ...]

    @property
    def free(self) -> Float[np.ndarray, "free n"]:
        """Free directions, one a row, in the coordinates above."""
        return self.directions[self.rank :]


def identify(problem: Problem, values: Float[np.ndarray, " m"]) -> Identification:
    """What the data, without the priors, determine near some values.

    Args:
        problem: The data and the parameters.
        values: Of the parameters, such as those of a fit.

    Accuracy: first order in the change of the constants. Expected information for normal noise of given size, the
        curvature of the likelihood elsewhere.
    """
    names = problem.parameters.names
    eigenvalues, directions = _spectrum(problem, values)
    rank = int(np.sum(eigenvalues > FREE**-2))
    smallest = float(eigenvalues[-1])
    condition = float(eigenvalues[0]) / smallest if smallest > 0.0 else math.inf
    combinations = _combinations(problem, values, eigenvalues, directions, rank)
    return Identification(
        names=names,
        eigenvalues=eigenvalues,
        directions=directions,
        condition_number=condition,
        rank=rank,
        combinations=combinations,
        sentences=tuple(_sentences(names, directions[rank:], combinations)),
    )


def _spectrum(
    problem: Problem, values: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k m"]]:
    """Eigenvalues and eigenvectors (rows) of the information, largest first."""
    scale = large_changes(problem, values)
    if problem.is_least_squares:
        jacobian = np.asarray(_data_jacobian(problem, jnp.asarray(values))) * scale[None, :]
    else:
        jacobian = root_of_curvature(data_curvature(problem, values), values) * scale[None, :]
    # Population and spread are told by the groups' values, not by data: they are not asked about.
    asked = np.flatnonzero(~_of_populations(problem))
    _, singular, found = np.linalg.svd(jacobian[:, asked], full_matrices=True)
    eigenvalues, directions = np.zeros(len(asked)), np.zeros((len(asked), len(values)))
    eigenvalues[: len(singular)] = singular[: len(asked)] ** 2
    rounding = _SQUARED if problem.is_least_squares else _OF_DIFFERENCES if problem.is_long else _EXACT
    eigenvalues[eigenvalues < rounding * eigenvalues[0]] = 0.0
    directions[:, asked] = found
    return eigenvalues, directions


def _of_populations(problem: Problem) -> Bool[np.ndarray, " m"]:
    return np.array(
        [
            isinstance(entry, Varying) and name in (f"{entry.name}_population", f"{entry.name}_spread")
            for entry in problem.parameters.entries
            for name, _, _ in entry.columns
        ]
    )


@eqx.filter_jit
def _data_jacobian(problem: Problem, values):
    return jax.jacfwd(problem.data_residuals_of)(values)


def _combinations(
    problem: Problem,
    values: Float[np.ndarray, " m"],
    eigenvalues: Float[np.ndarray, " k"],
    directions: Float[np.ndarray, "k m"],
    rank: int,
) -> tuple[Combination, ...]:
    """Products of powers that a free direction of several constants leaves alone.

    Constants that are free by themselves are set aside first; with several directions left there is no telling which
    products to write.
    """
    _, left = _set_aside(directions[rank:])
    if len(left) != 1:
        return ()
    direction = left[0]
    names, logarithmic = problem.parameters.names, _logarithmic(problem)
    part = [k for k in np.argsort(-np.abs(direction)) if abs(direction[k]) > _TAKES_PART * np.abs(direction).max()]
    part = [int(k) for k in part if logarithmic[k]]
    if len(part) < 2:
        return ()
    anchor, found = part[0], []
    for other in part[1:]:
        powers = np.zeros(len(values))
        # Along the direction the logarithm of the first falls by what the second gains.
        powers[other], powers[anchor] = 1.0, -direction[other] / direction[anchor]
        determined = directions[:rank] @ powers
        error = float(np.sqrt(np.sum(determined**2 / eigenvalues[:rank])))
        exponent = _named_exponent(problem, values, other, anchor, float(powers[anchor]))
        if error > _DETERMINED:
            continue
        text = f"{names[other]} {'×' if powers[anchor] > 0 else '/'} {names[anchor]}^{exponent}"
        found.append(Combination({names[other]: 1.0, names[anchor]: float(powers[anchor])}, text, error))
    return tuple(found)


def _logarithmic(problem: Problem) -> list[bool]:
    return [
        isinstance(entry.parameter.transform, Positive | LogInterval)
        for entry in problem.parameters.entries
        for _ in entry.columns
    ]


def _named_exponent(problem: Problem, values: Float[np.ndarray, " m"], other: int, anchor: int, exponent: float) -> str:
    """The name of the constant that the exponent equals wherever that constant is moved, or the number."""
    units = [unit for _, unit, _ in problem.parameters.columns]
    for place, (unit, value) in enumerate(zip(units, values, strict=True)):
        if unit != "1" or place in (other, anchor) or abs(abs(exponent) - value) > _SAME_EXPONENT * abs(value):
            continue
        moved = values.copy()
        moved[place] *= 1.0 - _CHANGE
        eigenvalues, directions = _spectrum(problem, moved)
        _, left = _set_aside(directions[int(np.sum(eigenvalues > FREE**-2)) :])
        if len(left) != 1:
            continue
        there = abs(left[0][other] / left[0][anchor])
        if abs(there - moved[place]) < _SAME_EXPONENT * abs(moved[place]):
            return problem.parameters.names[place]
    return f"{abs(exponent):.3g}"


def _set_aside(free: Float[np.ndarray, "free n"]) -> tuple[list[int], Float[np.ndarray, "left n"]]:
    """Constants that are free by themselves, and what the free directions hold besides."""
    alone = [int(k) for k in np.flatnonzero(np.linalg.norm(free, axis=0) > _ALONE)]
    rest = free.copy()
    rest[:, alone] = 0.0
    _, singular, directions = np.linalg.svd(rest, full_matrices=False)
    return alone, directions[singular > _ALONE / 2.0]


def _sentences(
    names: tuple[str, ...], free: Float[np.ndarray, "free n"], combinations: tuple[Combination, ...]
) -> list[str]:
    alone, left = _set_aside(free)
    sentences = [
        f"{names[k]} is not determined by these data: it can change by more than a factor of e, or of its whole range."
        for k in alone
    ]
    if combinations:
        told = "; ".join(f"{one.text} is determined to {_percent(one.relative_error)}" for one in combinations)
        members = dict.fromkeys(itertools.chain.from_iterable(one.powers for one in combinations))
        return [
            *sentences,
            f"Only a combination is determined by these data: {told}. {_listed(members)} are not, each by itself.",
        ]
    for direction in left:
        largest = np.abs(direction).max()
        members = [names[k] for k in np.argsort(-np.abs(direction)) if abs(direction[k]) > _TAKES_PART * largest]
        sentences.append(
            f"{_listed(members)} can change together by more than a factor of e: the fit stays all but the same."
        )
    return sentences


def _listed(names) -> str:
    names = list(names)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.2g} %"
