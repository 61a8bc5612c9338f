"""A data set examined: which causes it can see, and what the tests of all of them say."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from arfjax import InputError
from inverse.diagnosis.cause import Cause, Extension
from inverse.diagnosis.decision import Decision
from inverse.diagnosis.free_forms import Place
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.projection import independent, project_out, visibility
from inverse.diagnosis.screening import Alternative

DETECTABLE = 4.5
"""d' at which an effect counts as detectable: found in 96 of 100 data sets if noise and model were known."""
LEAST_VISIBILITY = 0.02
"""Part of a cause's effect that the fitted constants must leave, or the data cannot see it."""
MOST_IMPLAUSIBLE = 10.0
"""Detectable strength over the plausible one above which the data cannot see the cause either."""
NEGLIGIBLE = 1e-3
"""Length of an effect, in standard deviations of the noise, below which it is rounding: of a cause whose effect is a
factor that is fitted as well, 1e-16 of it remains."""


@dataclasses.dataclass(frozen=True)
class NotTestable:
    """A cause that these data cannot see.

    Attributes:
        name: Which.
        why: In words.
        what_would_help: The measurement that would show it.
    """

    name: str
    why: str
    what_would_help: str


@runtime_checkable
class FullFit(Protocol):
    """The model with extensions in it, fitted in full; see `ExtendedFit` and `HmiFit`."""

    @property
    def extensions(self) -> tuple[Extension, ...]:
        """What was added, in the shapes that fit best."""
        ...

    @property
    def strengths(self) -> Float[np.ndarray, " extension"]:
        """Of the extensions."""
        ...

    @property
    def intervals(self) -> Float[np.ndarray, "extension 2"]:
        """Of the strengths at 95 %."""
        ...

    @property
    def residuals(self) -> Float[np.ndarray, " n"]:
        """Measured less predicted, weighted."""
        ...

    @property
    def directions(self) -> Float[np.ndarray, "n p"]:
        """Derivative of the weighted prediction in everything that was fitted."""
        ...

    @property
    def converged(self) -> bool:
        """Whether it did."""
        ...


FitFull = Callable[[Sequence[Extension], Noise, Float[np.ndarray, " extension"], bool], FullFit]
"""Fits extensions in noise of a kind, from first guesses of their strengths; last, whether intervals are profiled."""


@dataclasses.dataclass(frozen=True)
class Examined:
    """A data set examined: what it can see, and what follows.

    Attributes:
        causes: The library.
        residuals: Measured less predicted, weighted.
        fitted: Derivatives in the fitted constants.
        seen: Effects of causes, about the fit, that the data can see.
        not_testable: Causes that they cannot see.
        places: Where the free forms act.
        family: Noise members.
        decision: What follows.
        fit: Puts extensions into the model and fits it in full.
        remarks: What is to be said of the fit.
    """

    causes: tuple[Cause, ...]
    residuals: Float[np.ndarray, " n"]
    fitted: Float[np.ndarray, "n p"]
    seen: tuple[Alternative, ...]
    not_testable: tuple[NotTestable, ...]
    places: tuple[Place, ...]
    family: tuple[Noise, ...]
    decision: Decision
    fit: FitFull
    remarks: tuple[str, ...]

    def extension(self, name: str) -> Extension:
        """The cause of this name in its most probable shape."""
        return extension_of(self.causes, self.alternative(name))

    def alternative(self, name: str) -> Alternative:
        """The most probable shape of the cause of this name."""
        return self.decision.omnibus.alternatives[self.row(name)]

    def row(self, name: str) -> int:
        """Where the test of everything has the most probable shape of the cause of this name.

        Raises:
            KeyError: if these data cannot see it.
        """
        row = self.decision.omnibus.best(name)
        if row is None:
            raise KeyError(f"these data cannot see {name}")
        return row

    def effect(self, name: str) -> Alternative:
        """What the cause of this name does about the fit, in its most probable shape."""
        best = self.alternative(name)
        return next(one for one in self.seen if (one.name, one.shape, one.sign) == (name, best.shape, best.sign))

    def linear_strengths(self, extensions: Sequence[Extension]) -> Float[np.ndarray, " extension"]:
        """Strengths of the extensions together in the linearised model: where a refit starts."""
        added = [self.alternative(extension.cause.name) for extension in extensions]
        return linear_strengths(added, self.residuals, self.fitted)


def in_white_noise(status: str) -> str:
    """That a fit failed in the likeliest kind of noise, and how."""
    return f"In the likeliest kind of noise the fit without causes failed ({status}): the one in white noise stands."


def extension_of(causes: Sequence[Cause], alternative: Alternative) -> Extension:
    """The cause that an alternative stands for, in its shape."""
    cause = next(cause for cause in causes if cause.name == alternative.name)
    return Extension(cause, 0.0 if alternative.shape is None else alternative.shape)


def visible_alternatives(
    alternatives: Sequence[Alternative],
    residuals: Float[np.ndarray, " n"],
    fitted: Float[np.ndarray, "n p"],
    size: float,
    causes: Sequence[Cause],
) -> tuple[list[Alternative], tuple[NotTestable, ...]]:
    """Alternatives that the data can see, and why the others cannot be seen.

    Each in the noise that it would leave: by residuals as they are, a large effect would hide behind itself.

    Args:
        alternatives: Of every cause, in every shape.
        residuals: Of the fit.
        fitted: Derivatives in everything that was fitted.
        size: Of the residuals, in units of the weights.
        causes: That the alternatives are of.
    """
    seen, hidden = [], []
    basis = independent(fitted)
    for cause in causes:
        shapes = [a for a in alternatives if a.name == cause.name]
        visible = [float(visibility(a.directions, fitted)[0]) for a in shapes]
        sizes = [size * _part_left(a, residuals, basis) for a in shapes]
        detectable = [detectable_strength(a, v, left) for a, v, left in zip(shapes, visible, sizes, strict=True)]
        most = [min(MOST_IMPLAUSIBLE * cause.plausible, cause.farthest(a.sign)) for a in shapes]
        usable = [
            a for a, v, d, m in zip(shapes, visible, detectable, most, strict=True) if v >= LEAST_VISIBILITY and d <= m
        ]
        seen += usable
        if usable:
            continue
        best = int(np.argmax(visible))
        if float(np.linalg.norm(shapes[best].directions)) * most[best] < NEGLIGIBLE * size:
            why = "it has no effect on these data"
        elif visible[best] < LEAST_VISIBILITY:
            why = f"the fitted constants imitate all but {100.0 * visible[best]:.2g} % of its effect"
        else:
            missed = np.array(detectable) / np.array(most)
            nearest = int(np.argmin(np.where(np.array(visible) < LEAST_VISIBILITY, np.inf, missed)))
            why = _too_weak(cause, shapes[nearest].sign, detectable[nearest])
        hidden.append(NotTestable(cause.name, why, cause.helps))
    return seen, tuple(hidden)


def _part_left(alternative: Alternative, residuals: Float[np.ndarray, " n"], basis: Float[np.ndarray, "n p"]) -> float:
    """Standard deviation of residuals with an effect in the model over that without it: 1 for one of the other sign."""
    left, direction = project_out(np.column_stack([residuals, alternative.directions]), basis).T
    along = float(left @ direction)
    if alternative.sign * along < 0.0:
        return 1.0
    cosine = along / max(float(np.linalg.norm(left) * np.linalg.norm(direction)), 1e-300)
    freedom = len(residuals) - basis.shape[1]
    return min(math.sqrt(max(1.0 - cosine**2, 0.0) * freedom / max(freedom - 1, 1)), 1.0)


def require_seen(asked: Sequence[str], seen: Sequence[str], not_testable: Sequence[NotTestable]) -> None:
    """Refuse causes that the data cannot see, and say why they cannot.

    Args:
        asked: Names of causes.
        seen: Names of those that the data can see.
        not_testable: The others of the library.

    Raises:
        InputError: for the first that they cannot.
    """
    reasons = {one.name: f": {one.why}" for one in not_testable}
    for name in asked:
        if name not in seen:
            can = ", ".join(dict.fromkeys(seen)) or "none"
            raise InputError(f"causes: these data cannot see '{name}'{reasons.get(name, '')}; they see {can}.")


def _too_weak(cause: Cause, sign: int, detectable: float) -> str:
    """That the strength which would be seen is none that there can be, or that one believes."""
    unit, below = "" if cause.unit == "1" else f" {cause.unit}", sign < 0
    end, plausible = cause.farthest(sign), cause.plausible
    if MOST_IMPLAUSIBLE * plausible < end:
        limit = f"{plausible:.2g}{unit} is plausible"
    else:
        limit = f"there is none {'below -' if below else 'above '}{end:.2g}{unit}"
    return f"it would have to be {'-' if below else ''}{detectable:.2g}{unit} to be seen, where {limit}"


def detectable_strength(alternative: Alternative, visible: float, size: float) -> float:
    """Strength at which an effect is `DETECTABLE`."""
    length = float(np.linalg.norm(alternative.directions)) * visible
    return DETECTABLE * size / max(length, 1e-300)


def linear_strengths(
    alternatives: Sequence[Alternative], residuals: Float[np.ndarray, " n"], fitted: Float[np.ndarray, "n p"]
) -> Float[np.ndarray, " alternative"]:
    """Strengths of alternatives of one direction each in the linearised model, all residuals weighing the same.

    Args:
        alternatives: That are put into the model together.
        residuals: Without them.
        fitted: Derivatives in everything that was fitted.
    """
    columns = np.concatenate([*(alternative.directions for alternative in alternatives), fitted], axis=1)
    lengths = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return (np.linalg.lstsq(columns / lengths, residuals, rcond=1e-10)[0] / lengths)[: len(alternatives)]
