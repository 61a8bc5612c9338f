"""The model with causes in it, refitted in full: strengths with intervals, and predictions of data left out."""

import dataclasses
import math
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy import optimize, stats

from inverse.diagnosis.cause import Extension
from inverse.diagnosis.dma.cause import DmaCause
from inverse.diagnosis.dma.problem import DmaProblem
from inverse.diagnosis.dma.white_residual import (
    WhiteResidual,
    constants_of,
    plain_of,
    plain_slope_of,
    strength_scales,
    unconstrained_constants,
    white_and_slope,
    whitened,
)
from inverse.diagnosis.limits import at_limit
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.regression import INTERVAL_LEVEL
from inverse.diagnosis.screening import Alternative


@dataclasses.dataclass(frozen=True)
class ExtendedFit:
    """A refit with extensions.

    Attributes:
        extensions: What was added, in the shapes that fit best.
        strengths: Their fitted strengths.
        intervals: Of the strengths at `INTERVAL_LEVEL`, within what strengths can be. Where a
            cause has a shape, by the profile likelihood over it.
        constants: Of every sweep.
        residuals: Measured less predicted, weighted.
        directions: Derivative of the weighted prediction in strengths, shapes and constants, at the fit; but for
            strengths and shapes at a limit that the data would pass, which can follow nothing any more.
        others: Derivative in the strength of every cause of the library that was not added, in every shape, at the fit.
        misfit: Sum of squares of the residuals in coordinates in which the noise is white.
        converged: Whether it did.
        status: The outcome in words.
    """

    extensions: tuple[Extension, ...]
    strengths: Float[np.ndarray, " extension"]
    intervals: Float[np.ndarray, "extension 2"]
    constants: Float[np.ndarray, "sweep 4"]
    residuals: Float[np.ndarray, " n"]
    directions: Float[np.ndarray, "n p"]
    others: tuple[Alternative, ...]
    misfit: float
    converged: bool
    status: str


def fit_extended(
    problem: DmaProblem,
    extensions: Sequence[Extension],
    noise: Noise,
    start: Float[np.ndarray, " extension"],
    *,
    library: Sequence[DmaCause] = (),
    profile: bool = True,
) -> ExtendedFit:
    """Refit all constants, strengths and shapes together.

    Args:
        problem: The data and the fit without extensions, which is where the refit starts.
        extensions: What to add, in the shapes to start from; none refits the null model.
        noise: Member of the family that weighs the residuals.
        start: First guess of the strengths, in their units.
        library: Causes that other refits will add: one program serves them all.
        profile: Whether to profile intervals over shapes; without, they are what the curvature at the best fit gives.
    """
    return Refit(problem, extensions, noise, library=library).fit(start, profile=profile)


class Refit:
    """Refits of one extended model; the program compiled holds every cause, those not added at strength 0."""

    def __init__(
        self,
        problem: DmaProblem,
        extensions: Sequence[Extension],
        noise: Noise,
        *,
        library: Sequence[DmaCause] = (),
    ) -> None:
        """Prepare."""
        self.problem = problem
        self.extensions = tuple(extensions)
        known = {cause.name: cause for cause in (*library, *(extension.cause for extension in extensions))}
        self.white = WhiteResidual(problem, tuple(known.values()), noise)
        self._scales = strength_scales([extension.cause for extension in self.extensions])
        self._one_sided = np.array([extension.cause.sign > 0 for extension in self.extensions], dtype=bool)
        possible = [extension.cause.possible for extension in self.extensions]
        self._range = np.array(possible, dtype=float).reshape(-1, 2) / self._scales[:, None]
        self._everything = np.ones(problem.rows, dtype=bool)
        self._all = jnp.ones(problem.weights.size)
        places, total = [list(known).index(extension.cause.name) for extension in self.extensions], len(known)
        constants = np.arange(problem.moved.size) + 2 * total
        shaped = [total + place for place, e in zip(places, self.extensions, strict=True) if e.has_shape]
        self._strengths, self._shapes = np.array(places, dtype=int), np.array(places, dtype=int) + total
        self._fixed_shapes = np.concatenate([self._strengths, constants])
        self._moved = np.concatenate([self._strengths, np.array(shaped, dtype=int), constants])

    @property
    def moves(self) -> int:
        """How many numbers are fitted."""
        return len(self._moved)

    def fit(self, start: Float[np.ndarray, " extension"], *, profile: bool = True) -> ExtendedFit:
        """Refit to all data, from several shapes: the sum of squares has more than one minimum along them.

        A second relaxation explained by drainage: 160 left (120 expected) from the best linear shape, 124 from another.
        """
        rough = [
            self.solve(start, self._everything, shapes=shapes, tolerance=_ROUGH) for shapes in self._starting_shapes()
        ]
        squares = [
            float(np.sum(np.asarray(whitened(self.white, jnp.asarray(one[0]), self._all)) ** 2)) for one in rough
        ]
        best = rough[int(np.argmin(squares))][0]
        unknowns, converged, status = self._solve(best, self._moved, self._everything)
        white, jacobian = self._at(unknowns, self._moved)
        count, shaped = len(self.extensions), [e.has_shape for e in self.extensions]
        errors, freedom = _errors(jacobian, white, count + sum(shaped))
        reach = float(stats.t.ppf(0.5 + 0.5 * INTERVAL_LEVEL, freedom))
        ends = unknowns[self._strengths, None] + reach * errors[:count, None] * np.array([-1.0, 1.0])
        if profile:
            square = float(white @ white) * (1.0 + reach**2 / freedom)
            for which, error in zip(np.flatnonzero(shaped).tolist(), errors[count:], strict=True):
                ends[which] = self._profiled(which, unknowns, square, reach * float(error))
        shapes = [float(shape) for shape in unknowns[self._shapes]]
        lower, upper = self._bounds(len(unknowns))
        held = at_limit(unknowns[self._moved], lower[self._moved], upper[self._moved], jacobian.T @ white)
        held &= self._moved < 2 * len(self.white.causes)
        return ExtendedFit(
            extensions=tuple(Extension(e.cause, shape) for e, shape in zip(self.extensions, shapes, strict=True)),
            strengths=unknowns[self._strengths] * self._scales,
            intervals=np.clip(ends, self._range[:, :1], self._range[:, 1:]) * self._scales[:, None],
            constants=np.asarray(constants_of(self.white, jnp.asarray(unknowns))),
            residuals=self.plain(unknowns),
            directions=self._plain_slope(unknowns)[:, self._moved[~held]],
            others=self._others(unknowns),
            misfit=float(white @ white),
            converged=converged,
            status=status,
        )

    def solve(
        self,
        start: Float[np.ndarray, " extension"],
        used: Bool[np.ndarray, " row"],
        *,
        constants: Float[np.ndarray, "sweep n"] | None = None,
        shapes: tuple[float, ...] | None = None,
        tolerance: float = 1e-10,
    ) -> tuple[Float[np.ndarray, " unknown"], bool, str]:
        """Refit to the rows in use.

        Args:
            start: First guess of the strengths.
            used: Rows to fit.
            constants: First guess of them, unconstrained; the fit to everything without.
            shapes: First guess of them; those of the extensions without.
            tolerance: Relative change of the sum of squares to stop at.

        Returns:
            Strengths in their plausible scales and shapes of the whole library, then unconstrained constants; whether
            it converged; and how it ended.
        """
        if constants is None:
            constants = np.asarray(unconstrained_constants(self.white.parameters, jnp.asarray(self.problem.moved)))
        free = constants.ravel()
        strengths, causes = start / self._scales, self.white.causes
        first = np.concatenate(
            [np.zeros(len(causes)), [cause.shapes[0] for cause in causes], np.clip(free, -_FARTHEST, _FARTHEST)]
        )
        first[self._strengths] = np.where(self._one_sided, np.maximum(strengths, _SMALL), strengths)
        own = tuple(float(extension.shape) for extension in self.extensions)
        first[self._shapes] = own if shapes is None else shapes
        return self._solve(first, self._moved, used, tolerance)

    def _starting_shapes(self) -> list[tuple[float, ...]]:
        """Those of the extensions, and others of one extension at a time."""
        own = tuple(float(extension.shape) for extension in self.extensions)
        others = [
            (*own[:which], shape, *own[which + 1 :])
            for which, extension in enumerate(self.extensions)
            for shape in extension.cause.shapes[1 :: max(2, len(extension.cause.shapes) // _STARTS)]
            if extension.has_shape
        ]
        return list(dict.fromkeys([own, *others]))

    def solve_constants(
        self,
        unknowns: Float[np.ndarray, " unknown"],
        used: Bool[np.ndarray, " row"],
        *,
        constants: Float[np.ndarray, "sweep n"],
    ) -> tuple[Float[np.ndarray, " unknown"], bool, str]:
        """Refit the constants of the sweeps that have rows in use; strengths, shapes and other sweeps stay."""
        sweep, count = np.asarray(self.problem.conditions.sweep), self.problem.moved.shape[1]
        moved = 2 * len(self.white.causes) + (np.unique(sweep[used])[:, None] * count + np.arange(count)).ravel()
        first = unknowns.copy()
        first[moved] = np.clip(constants[np.unique(sweep[used])].ravel(), -_FARTHEST, _FARTHEST)
        return self._solve(first, moved, used)

    def own_constants(self, used: Bool[np.ndarray, " row"]) -> Float[np.ndarray, "sweep n"]:
        """Constants, unconstrained, that fit the rows in use without any extension; other rows are not looked at."""
        return np.asarray(unconstrained_constants(self.white.parameters, jnp.asarray(self.problem.moved_by(used))))

    def plain(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " n"]:
        """Measured less predicted, weighted but not whitened."""
        return np.asarray(plain_of(self.white, jnp.asarray(unknowns)))

    def _plain_slope(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, "n unknown"]:
        """Derivative of the weighted prediction in all unknowns, not whitened."""
        return -np.asarray(plain_slope_of(self.white, jnp.asarray(unknowns)))

    def _others(self, unknowns: Float[np.ndarray, " unknown"]) -> tuple[Alternative, ...]:
        causes, found = self.white.causes, []
        for number in range(max((len(cause.shapes) for cause in causes), default=0)):
            at = unknowns.copy()
            free = [i for i in range(len(causes)) if i not in self._strengths and number < len(causes[i].shapes)]
            at[[len(causes) + i for i in free]] = [causes[i].shapes[number] for i in free]
            slope = self._plain_slope(at)
            for i in free:
                shape = causes[i].shapes[number] if len(causes[i].shapes) > 1 else None
                # A solver counts strengths in plausible ones, everybody else in their units.
                found.append(Alternative(causes[i].name, slope[:, [i]] / self.white.scales[i], causes[i].sign, shape))
        return tuple(found)

    def _at(self, unknowns, moved) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n unknown"]]:
        white, jacobian = white_and_slope(self.white, jnp.asarray(unknowns), self._all)
        return np.asarray(white), np.asarray(jacobian)[:, moved]

    def _solve(self, first, moved, used, tolerance=1e-10) -> tuple[Float[np.ndarray, " unknown"], bool, str]:
        """Least squares in the unknowns that are moved."""
        lower, upper = self._bounds(len(first))
        mask = jnp.asarray(np.repeat(used.astype(float), self.problem.weights.shape[1]))
        kept: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

        def both(part):
            # The solver asks for the slope where it has just asked for the value.
            if (key := part.tobytes()) not in kept:
                kept.clear()
                whole = first.copy()
                whole[moved] = part
                value, slope = white_and_slope(self.white, jnp.asarray(whole), mask)
                kept[key] = np.asarray(value), np.asarray(slope)[:, moved]
            return kept[key]

        solution = optimize.least_squares(
            lambda part: both(part)[0],
            np.clip(first, lower, upper)[moved],
            jac=lambda part: both(part)[1],  # pyright: ignore[reportArgumentType]
            bounds=(lower[moved], upper[moved]),
            x_scale="jac",
            ftol=tolerance,
            xtol=1e-8,
            max_nfev=_MOST_EVALUATIONS,
        )
        unknowns = first.copy()
        unknowns[moved] = solution.x
        return unknowns, bool(solution.success), str(solution.message)

    def _bounds(self, count: int) -> tuple[Float[np.ndarray, " unknown"], Float[np.ndarray, " unknown"]]:
        """Of all unknowns."""
        lower, upper = np.full(count, -_BEYOND), np.full(count, _BEYOND)
        lower[self._strengths], upper[self._strengths] = self._range.T
        for shape, extension in zip(self._shapes, self.extensions, strict=True):
            lower[shape], upper[shape] = extension.cause.shapes[0], extension.cause.shapes[-1]
        return lower, upper

    def _profiled(
        self, which: int, best: Float[np.ndarray, " unknown"], square: float, reach: float
    ) -> Float[np.ndarray, " 2"]:
        """Strengths whose best sum of squares over shapes and constants stays below a bound.

        At a given shape the sum of squares is a parabola in the strength as good as anything; shapes are tried one by
        one because the strength that fits bends with them: over all that there are, and closely over those that the
        curvature at the best allows (`reach` to both sides), which may lie between two of the former.
        """
        shapes, place = self.extensions[which].cause.shapes, self._shapes[which]
        near = best[place] + min(reach, shapes[-1] - shapes[0]) * np.linspace(-1.0, 1.0, _PROFILED)
        tried = np.append(np.linspace(shapes[0], shapes[-1], _PROFILED), np.clip(near, shapes[0], shapes[-1]))
        ends = []
        for shape in np.unique(np.append(tried, best[place])):
            first = best.copy()
            first[place] = shape
            unknowns = self._solve(first, self._fixed_shapes, self._everything)[0]
            white, jacobian = self._at(unknowns, self._fixed_shapes)
            room = square - float(white @ white)
            if room < 0.0:
                continue
            errors, freedom = _errors(jacobian, white, len(self.extensions))
            half = math.sqrt(room) * errors[which] / math.sqrt(float(white @ white) / freedom)
            middle = unknowns[self._strengths[which]]
            ends += [middle - half, middle + half]
        return np.array([min(ends), max(ends)])


_MOST_EVALUATIONS = 1000
"""Of a refit: constants that the data hardly tell apart are found along a valley, in many small steps."""
_STARTS = 5
"""Shapes, about, that a refit tries beside its own: minima of the sum of squares are wider than steps of screening."""
_ROUGH = 1e-6
"""Relative change of the sum of squares at which one of several starts is left, to go on from the best."""
_SMALL = 1e-3
"""Part of the plausible strength at which one that cannot be negative starts at least."""
_FARTHEST = 12.0
"""Unconstrained numbers beyond which a constant is at its bound and no derivative would bring it back."""
_BEYOND = 30.0
"""Unconstrained numbers at which the solver turns back before anything overflows."""
_PROFILED = 9
"""Shapes at which the strength is profiled: so many over all, and about the best."""


def _errors(jacobian, white, count: int) -> tuple[Float[np.ndarray, " extension"], int]:
    """Standard errors of the first `count` unknowns with all others free, and the degrees of freedom left."""
    lengths = np.linalg.norm(jacobian, axis=0)
    felt = lengths > 1e-12 * np.max(lengths)
    _, singular, directions = np.linalg.svd(jacobian[:, felt] / lengths[felt], full_matrices=False)
    kept = singular > 1e-9 * singular[0]
    freedom = max(len(white) - int(np.sum(kept)), 1)
    errors = np.full(len(lengths), np.inf)
    covariance = np.sum((directions[kept] / singular[kept, None]) ** 2, axis=0) / lengths[felt] ** 2
    errors[felt] = np.sqrt(covariance * float(white @ white) / freedom)
    return errors[:count], freedom
