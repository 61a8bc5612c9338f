r"""Audit of a fit: is it a minimum, the lowest one, away from bounds, and do the data determine its constants?

It comes before anything is concluded from a fit. Nothing in it knows what is fitted. The one finding that needs an
explanation is the *vanishing score*. Where a constant enters the data through its square, the derivative of every
datum with respect to it is zero at zero: the fit cannot tell it from zero to first order, its standard error means
nothing there, and an optimiser that comes near stays. The magnitude of a conventional Zener solid's modulus depends
so on the relaxed modulus: of the ten fits of Suomi et al. 2016 seven sit at 8 Pa. The test compares the effect of a
constant on the data near its lower bound, after that of all others is projected out, with its effect at the size of
the measured values.
"""

import dataclasses
import enum

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from inverse.inference.fit import Fit
from inverse.inference.identifiability import Identification, identify
from inverse.transforms import Positive

_VANISHED = 1e-3
"""Ratio of the projected effects near zero and at full size below which the score vanishes."""
_SMALL = 1e-6
"""Fraction of the usual size at which a constant is taken to be near zero."""
_NEAR_ZERO = 0.2
"""Fraction of its usual size below which a vanishing score concerns an estimate."""
_FEW = 0.5
"""Share of the starts of which at least so many must have reached the minimum."""


class Kind(enum.StrEnum):
    """What an audit looks at."""

    CONVERGENCE = "convergence"
    STARTS = "starts"
    BOUND = "bound"
    VANISHING_SCORE = "vanishing-score"
    INFORMATION = "information"


@dataclasses.dataclass(frozen=True)
class Finding:
    """Something that a reader of the fit must know.

    Attributes:
        kind: What it is about.
        parameters: Names of the values that it concerns.
        sentence: It, in words.
    """

    kind: Kind
    parameters: tuple[str, ...]
    sentence: str


@dataclasses.dataclass(frozen=True)
class Audit:
    """Outcome of an audit.

    Attributes:
        findings: What was found; none of a sound fit.
        identification: What the data determine.
        n_starts: How many starts there were.
        n_agreeing: How many of them reached the minimum.
    """

    findings: tuple[Finding, ...]
    identification: Identification
    n_starts: int
    n_agreeing: int

    @property
    def is_sound(self) -> bool:
        """Whether nothing was found."""
        return not self.findings

    @property
    def is_minimum(self) -> bool:
        """Whether the values are at least those of a minimum that several starts found."""
        return not any(finding.kind in (Kind.CONVERGENCE, Kind.STARTS) for finding in self.findings)

    def of(self, kind: Kind) -> tuple[Finding, ...]:
        """Findings of one kind."""
        return tuple(finding for finding in self.findings if finding.kind is kind)


def audit(fit: Fit, *, may_have_more_starts: bool = True) -> Audit:
    """Look at a fit before anything is concluded from it.

    Args:
        fit: From `fit` or `judge`.
        may_have_more_starts: Whether the reader can ask for more than it had, which is advised where few agree.
    """
    identification = identify(fit.problem, fit.values)
    findings = [*_convergence(fit), *_starts(fit, may_have_more_starts), *_bounds(fit), *_vanishing(fit)]
    findings += _information(identification)
    return Audit(tuple(findings), identification, len(fit.starts.costs), fit.starts.n_agreeing)


def _convergence(fit: Fit) -> list[Finding]:
    if fit.converged:
        return []
    if fit.judged:
        return [Finding(Kind.CONVERGENCE, (), "These values are no minimum: the cost falls when they are moved.")]
    return [Finding(Kind.CONVERGENCE, (), f"The fit did not converge: {fit.status}.")]


def _starts(fit: Fit, may_have_more: bool) -> list[Finding]:
    count, agreeing = len(fit.starts.costs), fit.starts.n_agreeing
    if fit.judged:
        return []
    if count == 1:
        return [Finding(Kind.STARTS, (), "The fit has a single start: nothing says that there is no lower minimum.")]
    if agreeing >= _FEW * count:
        return []
    return [
        Finding(
            Kind.STARTS,
            (),
            f"Only {agreeing} of {count} starts reached this minimum, so that there may be a lower one: "
            f"{'allow more starts' if may_have_more else 'try another seed'}.",
        )
    ]


def _bounds(fit: Fit) -> list[Finding]:
    entries = fit.problem.parameters.entries
    positive = [isinstance(entry.parameter.transform, Positive) for entry in entries for _ in entry.columns]
    return [
        Finding(Kind.BOUND, (name,), f"{name} lies at {_end(end, above_zero)}: a bound, not an estimate.")
        for (name, _, _), end, above_zero in zip(fit.columns, fit.ends, positive, strict=True)
        if end is not None
    ]


def _end(end: str, above_zero: bool) -> str:
    """An end of a range in words; that of constants above zero has no lower end but zero."""
    if above_zero and end == "lower":
        return "zero, with which the data are compatible"
    return f"the {end} end of its range"


def _vanishing(fit: Fit) -> list[Finding]:
    """Positive constants near zero whose projected effect on the data is none at zero."""
    findings = []
    place = 0
    for entry in fit.problem.parameters.entries:
        transform, name = entry.parameter.transform, entry.columns[0][0]
        is_noise = entry.parameter.place.startswith("noise.")
        if isinstance(transform, Positive) and len(entry.columns) == 1 and not is_noise:
            usual = float(transform.scale)
            if fit.values[place] < _NEAR_ZERO * usual:
                ratio = _effect(fit, place, _SMALL * usual) / max(_effect(fit, place, usual), 1e-300)
                if ratio < _VANISHED:
                    findings.append(Finding(Kind.VANISHING_SCORE, (name,), _vanishing_sentence(fit, place)))
        place += len(entry.columns)
    return findings


def _vanishing_sentence(fit: Fit, place: int) -> str:
    name, unit, _ = fit.columns[place]
    return (
        f"The data depend on {name} through its square near zero: at {fit.values[place]:.3g} {unit} a small change of "
        "it changes nothing, its standard error has no meaning, and where the fit came to rest depends on its start. "
        "Data with a phase, or a profile likelihood, say more."
    )


def _effect(fit: Fit, place: int, value: float) -> float:
    """Length of a constant's effect on the predictions, the others' effects projected out."""
    values = fit.values.copy()
    values[place] = value
    predictions, jacobian = (np.asarray(each) for each in _effects(fit.problem, jnp.asarray(values)))
    if not np.all(np.isfinite(predictions)):
        return float("nan")  # a model that does not cover such a value says nothing of it
    lengths = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(lengths == 0.0, 1.0, lengths)
    others = np.delete(scaled, place, axis=1)
    axes, singular, _ = np.linalg.svd(others, full_matrices=False)
    axes = axes[:, singular > 1e-10 * max(singular[0], 1e-300)] if singular.size else axes
    column = jacobian[:, place]
    return float(np.linalg.norm(column - axes @ (axes.T @ column)))


@eqx.filter_jit
def _effects(problem, values) -> tuple[Float[jax.Array, " n"], Float[jax.Array, "n m"]]:
    def predictions(each):
        return jnp.concatenate(list(problem.predictions(each).values()))

    return predictions(values), jax.jacfwd(predictions)(values)


def _information(identification: Identification) -> list[Finding]:
    return [Finding(Kind.INFORMATION, (), sentence) for sentence in identification.sentences]
