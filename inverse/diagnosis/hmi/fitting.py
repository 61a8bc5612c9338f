"""One fit of the simulation with causes in it: what moves, what is made least, and what came out."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import optimize, stats

from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.limits import at_limit
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.regression import INTERVAL_LEVEL

_TOLERANCE = 1e-4
"""Relative change of the sum of squares at which a fit ends; what is left then is less, and far below what decides
between causes."""
_MOST_STEPS = 40
_SMALL = 1e-3
"""Part of the plausible strength at which one that cannot be negative starts at least."""
_HALVINGS = 30
_FARTHEST = 8.0
"""Unconstrained numbers are kept within this many of the priors' spreads of their middle."""


@dataclasses.dataclass(frozen=True)
class HmiFit:
    """A fit of the simulation with causes in it.

    Attributes:
        problem: What was fitted, the fast simulation as corrected for it.
        unknowns: Of the program.
        extensions: What was added, in the shapes that fit best.
        strengths: Of these.
        intervals: Of the strengths at `INTERVAL_LEVEL`, from the curvature but for a fit that was `profiled`, within
            what strengths can be.
        residuals: Data less predicted: readings, weighted, each sonication's factor taken off, then what is believed of
            the constants, in units of the noise: a belief is one more datum, in tests as in the fit.
        directions: Derivative of what is predicted of them in everything that was fitted, the factors last; but for
            strengths and shapes at a limit that the data would pass, which can follow nothing any more.
        misfit: Sum of squares of the residuals in coordinates in which the noise is white: what the fit made least.
        freedom: Readings beyond what was taken from them. What is believed of a constant is no reading, and a constant
            that it alone tells takes none.
        variance: Of the noise in those coordinates, by readings alone. With beliefs counted as data it was 0.92 of the
            true one where constants are 0.6 times as far from their middle as is believed, 1.15 where 1.5 times.
        excess: How far outside of the fast model's range, above 1; covered up to 1.
        converged: Whether it did; outside of that range, whether the full simulation agrees, too.
        status: The outcome in words.
        left: How far the full simulation is from the corrected one there, as d'; NaN where it was not asked.
        remarks: What is to be said of its intervals.
    """

    problem: HmiDiagnosisProblem
    unknowns: Float[np.ndarray, " unknown"]
    extensions: tuple[Extension[HmiCause], ...]
    strengths: Float[np.ndarray, " extension"]
    intervals: Float[np.ndarray, "extension 2"]
    residuals: Float[np.ndarray, " datum"]
    directions: Float[np.ndarray, "datum p"]
    misfit: float
    freedom: float
    variance: float
    excess: float
    converged: bool
    status: str
    left: float = float("nan")
    remarks: tuple[str, ...] = ()

    @property
    def of_readings(self) -> Float[np.ndarray, " row"]:
        """Residuals of the readings alone."""
        return self.residuals[: len(self.problem.rows)]


class Fitting:
    """One fit: which unknowns move, and the residuals in coordinates in which the noise is white."""

    def __init__(
        self,
        problem: HmiDiagnosisProblem,
        extensions: Sequence[Extension[HmiCause]],
        noise: Noise,
        size: float,
        used: Bool[np.ndarray, " row"] | None = None,
        held: Sequence[int] = (),
    ) -> None:
        """Prepare; arguments as of `fit_hmi`."""
        program = problem.program
        self.problem, self.program, self.extensions = problem, program, tuple(extensions)
        self.noise, self.size = noise.of_first(len(problem.rows)), size
        # In coordinates in which the noise is white; it is as large as all readings together.
        self.belief = size / self.noise.loudness
        self.strengths = np.array([program.place(e.cause.name) for e in extensions], dtype=int)
        self.shapes = self.strengths + len(program.causes)
        self.scales = np.array([e.cause.plausible for e in extensions])
        self.free = np.setdiff1d(np.arange(len(extensions)), np.asarray(held, dtype=int))
        self.moved = moved_by(problem, extensions)
        self.moved = self.moved[~np.isin(self.moved, np.delete(self.strengths, self.free))]
        self.mask = np.ones(len(problem.rows)) if used is None else used.astype(float)
        # Rows that are left out weigh nothing; correlation with them is left out with them.
        white = self._white(problem.weights[:, None] * problem.factors)
        felt = white[:, np.linalg.norm(white, axis=0) > 0.0]
        self.basis = np.linalg.qr(felt)[0]

    def run(
        self, start: Float[np.ndarray, " unknown"] | None, strengths: Float[np.ndarray, " extension"] | None
    ) -> HmiFit:
        """Least squares with exact derivatives in every step: they take as long as five simulations."""
        first = self._first(start, strengths)
        lower, upper = self.bounds()
        # The derivatives where the last step ended are wanted again.
        taken: dict[bytes, np.ndarray] = {}

        def whole(part):
            unknowns = first.copy()
            unknowns[self.moved] = part
            return unknowns

        def slopes(part):
            if (key := part.tobytes()) not in taken:
                taken.clear()
                taken[key] = self.problem.slopes(whole(part), self.moved.tolist())
            return taken[key]

        solution = optimize.least_squares(
            lambda part: self.stacked(whole(part)),
            self._possible(np.clip(first, lower, upper))[self.moved],
            jac=lambda part: self.stacked_slopes(slopes(part), whole(part)),  # pyright: ignore[reportArgumentType]
            bounds=(lower[self.moved], upper[self.moved]),
            x_scale="jac",
            ftol=_TOLERANCE,
            xtol=1e-8,
            max_nfev=_MOST_STEPS,
        )
        return self._result(whole(solution.x), slopes(solution.x), bool(solution.success), str(solution.message))

    def _first(self, start, strengths) -> Float[np.ndarray, " unknown"]:
        first = self.program.null() if start is None else start.copy()
        first[: len(self.program.causes)] = 0.0
        if self.extensions:
            guess = np.zeros(len(self.extensions)) if strengths is None else strengths / self.scales
            one_sided = np.array([e.cause.sign > 0 for e in self.extensions])
            one_sided &= np.isin(np.arange(len(guess)), self.free)
            first[self.strengths] = np.where(one_sided, np.maximum(guess, _SMALL), guess)
            first[self.shapes] = [float(e.shape) for e in self.extensions]
        return first

    def _possible(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " unknown"]:
        """So near to what is believed that there is such a tissue, strengths first: a first guess may go beyond."""
        places, constants, middle = self.strengths[self.free], self.program.constants, self.program.start
        for _ in range(_HALVINGS):
            if np.all(np.isfinite(self.stacked(unknowns))):
                break
            if np.any(np.abs(unknowns[places]) > _SMALL):
                unknowns[places] *= 0.5
            else:
                unknowns[constants] = 0.5 * (unknowns[constants] + middle)
        return unknowns

    def bounds(self) -> tuple[Float[np.ndarray, " unknown"], Float[np.ndarray, " unknown"]]:
        """Of all unknowns."""
        program = self.program
        lower, upper = np.full(program.n_unknowns, -np.inf), np.full(program.n_unknowns, np.inf)
        lower[program.constants] = program.start - _FARTHEST * program.spreads
        upper[program.constants] = program.start + _FARTHEST * program.spreads
        for strength, shape, extension in zip(self.strengths, self.shapes, self.extensions, strict=True):
            lower[strength], upper[strength] = np.array(extension.cause.possible) / extension.cause.plausible
            lower[shape], upper[shape] = extension.cause.shapes[0], extension.cause.shapes[-1]
        return lower, upper

    def _white(self, columns):
        """Columns in which the noise is white; rows that are not used are 0, and no neighbours of any other."""
        if np.all(self.mask > 0.0):
            return self.noise.whiten(columns)
        previous = self.noise.ordering.previous
        follows = (previous >= 0) & (self.mask[previous] > 0.0)
        ordering = dataclasses.replace(self.noise.ordering, previous=np.where(follows, previous, -1))
        return self.mask[:, None] * dataclasses.replace(self.noise, ordering=ordering).whiten(columns)

    def free_of_factors(self, columns: Float[np.ndarray, "row q"]) -> Float[np.ndarray, "row q"]:
        """Columns in which the noise is white, without what the sonications' factors can do."""
        white = self._white(columns)
        return white - self.basis @ (self.basis.T @ white)

    def stacked(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " datum"]:
        """What is made least: readings, then how far constants are from what is believed of them."""
        data = self.free_of_factors(self.problem.residuals(unknowns)[:, None])[:, 0]
        return np.concatenate([data, self.belief * self.program.penalties(unknowns)])

    def stacked_slopes(
        self, plain: Float[np.ndarray, "row moved"], unknowns: Float[np.ndarray, " unknown"]
    ) -> Float[np.ndarray, "datum moved"]:
        """Its derivative in all that moves; `plain` is that of the weighted prediction."""
        data = -self.free_of_factors(plain)
        return np.concatenate([data, self.belief * self.program.penalty_slopes(unknowns)[:, self.moved]])

    def _directions(self, plain, weighted, unknowns, held) -> Float[np.ndarray, "datum p"]:
        slopes = self.size * self.program.penalty_slopes(unknowns)[:, self.moved[~held]]
        believed = np.append(slopes, np.zeros((len(slopes), weighted.shape[1])), axis=1)
        return np.append(np.append(plain[:, ~held], weighted, axis=1), believed, axis=0)

    def _held_by_limits(self, unknowns, jacobian, data) -> Bool[np.ndarray, " moved"]:
        """Which of the strengths and shapes are at a limit beyond which the fit would be better."""
        lower, upper = (each[self.moved] for each in self.bounds())
        outwards = at_limit(unknowns[self.moved], lower, upper, jacobian.T @ data)
        return outwards & ~np.isin(self.moved, self.program.constants)

    def _result(self, unknowns, plain, success, status) -> HmiFit:
        jacobian = self.stacked_slopes(plain, unknowns)
        problem, count = self.problem, len(self.extensions)
        weighted = problem.weights[:, None] * problem.factors
        raw = problem.residuals(unknowns)
        # The factors by least squares in white coordinates, then taken off the residuals as they are.
        factors = np.linalg.lstsq(self._white(weighted), self._white(raw[:, None])[:, 0], rcond=None)[0]
        data, believed = self.stacked(unknowns), self.program.penalties(unknowns)
        readings, (unit_errors, leverage) = data[: len(problem.rows)], _errors(jacobian)
        taken = self.basis.shape[1] + np.sum(leverage[: len(readings)])
        freedom = max(float(np.sum(self.mask) - taken), 1.0)
        variance = float(readings @ readings) / freedom
        errors = np.zeros(count)
        errors[self.free] = math.sqrt(variance) * unit_errors[: len(self.free)]
        reach = float(stats.t.ppf(0.5 + 0.5 * INTERVAL_LEVEL, freedom))
        ends = unknowns[self.strengths, None] + reach * errors[:, None] * np.array([-1.0, 1.0])
        possible = np.array([e.cause.possible for e in self.extensions], dtype=float).reshape(-1, 2)
        intervals = np.clip(ends * self.scales[:, None], possible[:, :1], possible[:, 1:])
        return HmiFit(
            problem=problem,
            unknowns=unknowns,
            extensions=tuple(
                Extension(e.cause, float(shape))
                for e, shape in zip(self.extensions, unknowns[self.shapes], strict=True)
            ),
            strengths=unknowns[self.strengths] * self.scales,
            intervals=intervals,
            residuals=np.append(raw - weighted @ factors, -self.size * believed),
            directions=self._directions(plain, weighted, unknowns, self._held_by_limits(unknowns, jacobian, data)),
            misfit=float(data @ data),
            freedom=freedom,
            variance=variance,
            excess=self.program.excess(unknowns),
            converged=success,
            status=status,
        )


def moved_by(problem: HmiDiagnosisProblem, extensions: Sequence[Extension[HmiCause]]) -> Int[np.ndarray, " moved"]:
    """Places of what a fit with extensions moves: their strengths, then shapes, then all constants."""
    program = problem.program
    strengths = [program.place(extension.cause.name) for extension in extensions]
    shapes = [
        place + len(program.causes)
        for place, extension in zip(strengths, extensions, strict=True)
        if extension.has_shape
    ]
    return np.array([*strengths, *shapes, *program.constants], dtype=int)


def _errors(jacobian: Float[np.ndarray, "n p"]) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " n"]]:
    """Standard errors of all unknowns in noise of size 1, priors included; what was taken from every datum.

    What is not felt at all, or cannot be told from others, has no end of an error.
    """
    lengths = np.linalg.norm(jacobian, axis=0)
    felt, errors = lengths > 1e-12 * np.max(lengths), np.full(len(lengths), np.inf)
    basis, singular, directions = np.linalg.svd(jacobian[:, felt] / lengths[felt], full_matrices=False)
    kept = singular > 1e-9 * singular[0]
    errors[felt] = np.sqrt(np.sum((directions[kept] / singular[kept, None]) ** 2, axis=0)) / lengths[felt]
    # Along a direction that is not kept the data say nothing; what has no part in it but by rounding is told.
    errors[np.flatnonzero(felt)[np.any(np.abs(directions[~kept]) > 1e-6, axis=0)]] = np.inf
    return errors, np.sum(basis[:, kept] ** 2, axis=1)
