"""Every cause put into the model, the constants following it: what screening looks along, and where refits start.

The constants of a fit without the cause that is hidden have moved to imitate it, and about them its effect is another:
where a lesion begins to be felt the displacement turns within a kelvin. Of what conduction of d' 4.5 left in readings
without noise, 7.8 standard deviations, the effect about the fit held 3.0. So each cause is fitted, with a strength of
at least half of what would be detected, and looked for along the way from one fit to the other: t is then what a refit
gains, by a direction that the noise has little say in, because the strength cannot become small.

The fits are made by the fast simulation as it is. Corrected to the full one about the fit without causes it is right
there and nowhere else: at the constants that four development sets of d' 4.5 were made with it was off by d' 4 to 9,
uncorrected by 5 to 7, and fits that are compared have to be equally wrong. (What the hidden cause gained, t: 1.6, 1.9,
3.5, 6.8 corrected; 6.1, 4.9, 8.5, 7.9 uncorrected; 4.9 and 8.0 in two of them by the full one, corrected again and
again.) The way itself is then asked of the full simulation where it matters.

No derivatives are taken but once, of the constants: they and the effect of the strength are corrected by what every
step shows (Broyden 1965). A fit takes two to eight predictions, 0.2 s as a rule; with derivatives it
takes 3. So far from the fit without it as a strong effect is, the corrected derivatives may get nowhere: the few best
fits go on with new ones. (An `output-drift` of d' 9, two development sets: sums of squares of 147 and 177 without it
were 127 and 103 in the rough fits, 40 and 73 where derivatives were taken twice or three times more.)
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy import optimize

from inverse.cores import side_by_side
from inverse.diagnosis.examination import detectable_strength
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.fitting import Fitting, HmiFit
from inverse.diagnosis.hmi.problem import Effect, farthest
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.projection import visibility
from inverse.diagnosis.screening import Alternative, Screen

_MOST_STEPS = 8
_TOLERANCE = 1e-2
"""Relative change of the sum of squares at which a fit ends; no more is asked of a direction."""
_MOST_IN_FULL = (4, 2)
"""Rough fits of which the full simulation is asked, in the likeliest noise and in white noise; seconds each."""
_WORTH_ASKING = 2.0
"""t that the fast simulation has to give them."""
_MOST_AGAIN, _MOST_TURNS = 4, 3
"""Rough fits that go on with derivatives where they came out, and how often."""
_SETTLED = 0.03
"""Relative gain of a turn below which there is no other."""
_HALVINGS = 6
_LEAST = 0.5
"""Part of a detectable strength that the strength is at least. Not all of it: that is counted about the fit without the
cause, where an effect may look half as large as it is, and the true strength has to be one that is allowed."""


@dataclasses.dataclass(frozen=True)
class RoughFit:
    """A cause in the model, constants and strength fitted roughly.

    Attributes:
        alternative: What to look for: the change from the fit without the cause to here, over the strength.
        unknowns: Of the program.
        strength: Of the cause, in its unit.
        misfit: As of `HmiFit`, by the fast simulation; infinite where there was no fit.
    """

    alternative: Alternative
    unknowns: Float[np.ndarray, " unknown"]
    strength: float
    misfit: float

    @property
    def shape(self) -> float:
        """Second parameter of the cause; 0 where it has none."""
        return 0.0 if self.alternative.shape is None else self.alternative.shape


def rough_fits(
    begun: HmiFit, noise: Noise, effects: Sequence[Effect], *, size: float, spread: float, since: HmiFit | None = None
) -> list[RoughFit]:
    """Of the cause of each effect, in its shape and with its sign.

    Where no tissue is met that goes with a detectable strength, the effect is what is looked along. The best of the few
    causes that fit best go on with new derivatives from where they came out.

    Args:
        begun: The fit without causes.
        noise: What it was weighed with.
        effects: About such a fit.
        size: Of the noise, in units of the weights: what the priors count against.
        spread: Of the residuals: what a strength has to stand out from to be detected.
        since: The fit without causes that is tested, where that is another: ways begin there.
    """
    fitting = _RoughFitting(begun, noise, size, spread, begun if since is None else since)
    found = side_by_side(fitting, effects)
    best = sorted(best_of_each(found).values(), key=lambda fit: fit.misfit)[:_MOST_AGAIN]
    places = [next(i for i, one in enumerate(found) if one is fit) for fit in best]
    for place, fit in zip(places, side_by_side(fitting.again, [(effects[i], found[i]) for i in places]), strict=True):
        found[place] = fit
    return found


def best_of_each(fits: Sequence[RoughFit]) -> dict[str, RoughFit]:
    """Of all shapes and signs of a cause the one that fits best, by name."""
    ordered = sorted(fits, key=lambda one: one.misfit, reverse=True)
    return {fit.alternative.name: fit for fit in ordered if np.isfinite(fit.misfit)}


def in_full(
    kinds: Sequence[tuple[HmiFit, Sequence[RoughFit]]], null: HmiFit, family: Sequence[Noise], size: float
) -> list[RoughFit]:
    """The same, with the way as the full simulation has it for the few that matter most.

    The way begins at the full simulation's fit: residuals that are tested are those of that one.

    Args:
        kinds: In each kind of noise the fit without causes that they began from, and rough fits, by the fast
            simulation.
        null: The fit without causes of the full simulation.
        family: Noise members.
        size: Of the noise, in units of the weights: what the priors count against.
    """
    problem, program = null.problem, null.problem.program
    chosen = [_worth_asking(*kind, null, family)[:most] for kind, most in zip(kinds, _MOST_IN_FULL, strict=False)]
    asked = list(itertools.chain.from_iterable(chosen))
    plain = program.simulate(null.unknowns) if asked else np.zeros(len(problem.rows))

    def with_way(fit: RoughFit) -> RoughFit:
        change = problem.weights * (program.simulate(fit.unknowns) - plain)
        if not np.all(np.isfinite(change)):
            return fit
        believed = size * (program.penalties(fit.unknowns) - program.penalties(null.unknowns))
        directions = np.append(change, believed)[:, None] / fit.strength
        return dataclasses.replace(fit, alternative=dataclasses.replace(fit.alternative, directions=directions))

    every = itertools.chain.from_iterable(fits for _, fits in kinds)
    return [with_way(fit) if any(fit is one for one in asked) else fit for fit in every]


def _worth_asking(begun: HmiFit, fits: Sequence[RoughFit], null: HmiFit, family: Sequence[Noise]) -> list[RoughFit]:
    """Of each cause one, those that matter most first.

    They are taken in turn from those that gain most by the fast simulation, and from those along whose ways most of
    what the full one leaves lies: the first count the fast one's errors for evidence, the second have them in the way.
    """
    # As a share: of few readings to spare no cause could take four times what each of them holds.
    least = begun.misfit / (1.0 + _WORTH_ASKING**2 / begun.freedom)
    gaining = sorted((fit for fit in best_of_each(fits).values() if fit.misfit < least), key=lambda fit: fit.misfit)
    in_turn = itertools.chain.from_iterable(itertools.zip_longest(gaining, _seen_best(fits, null, family)))
    return list({id(fit): fit for fit in in_turn if fit is not None}.values())


def _seen_best(fits: Sequence[RoughFit], null: HmiFit, family: Sequence[Noise]) -> list[RoughFit]:
    """Of each cause the fit along whose way the residuals lie most, best first, if they do at all."""
    usable = [fit for fit in fits if np.isfinite(fit.misfit)]
    screen = Screen(null.directions, [fit.alternative for fit in usable], family)
    statistic = screen.statistics(null.residuals[:, None]).statistic[:, 0]
    seen: dict[str, RoughFit] = {}
    for row in np.argsort(-np.abs(statistic)):
        of_it = next(fit for fit in usable if fit.alternative is screen.alternatives[row])
        if abs(statistic[row]) > _WORTH_ASKING:
            seen.setdefault(of_it.alternative.name, of_it)
    return list(seen.values())


class _RoughFitting:
    """Of one data set."""

    def __init__(self, begun: HmiFit, noise: Noise, size: float, spread: float, since: HmiFit) -> None:
        problem = begun.problem
        self._begun, self._size, self._spread = begun, size, spread
        self._problem, self._program = problem, problem.program
        self._fitting = Fitting(problem, (), noise, size)
        slopes = begun.directions[: len(problem.rows), : len(self._program.constants)]
        self._slopes = self._fitting.stacked_slopes(slopes, begun.unknowns)
        self._first = self._fitting.stacked(begun.unknowns)
        self._since = self._first if since is begun else self._fitting.stacked(since.unknowns)

    def __call__(self, effect: Effect) -> RoughFit:
        """From the fit without the cause on, where derivatives of the constants are known."""
        cause = self._program.causes[self._program.place(effect.name)]
        change = effect.directions[: len(self._problem.rows)] * cause.plausible
        slopes = np.append(self._padded(change), self._slopes, axis=1)
        base = self._begun.unknowns.copy()
        if effect.shape is not None:
            base[len(self._program.causes) + self._program.place(effect.name)] = effect.shape
        return self._followed(effect, base, self._first, slopes) or RoughFit(effect, base, 0.0, np.inf)

    def again(self, task: tuple[Effect, RoughFit]) -> RoughFit:
        """From where a rough fit came out, if it is better: with derivatives as they are there."""
        effect, fit = task
        place, constants = self._program.place(effect.name), self._program.constants
        for _ in range(_MOST_TURNS):
            plain = self._problem.slopes(fit.unknowns, [place, *constants.tolist()])
            if not np.all(np.isfinite(plain)):
                return fit
            slopes = self._fitting.stacked_slopes(plain[:, 1:], fit.unknowns)
            slopes = np.append(self._padded(plain[:, :1]), slopes, axis=1)
            better = self._followed(effect, fit.unknowns, self._fitting.stacked(fit.unknowns), slopes)
            if better is None or better.misfit >= fit.misfit:
                return fit
            settled = better.misfit > (1.0 - _SETTLED) * fit.misfit
            fit = better
            if settled:
                return fit
        return fit

    def _padded(self, change: Float[np.ndarray, "row 1"]) -> Float[np.ndarray, "datum 1"]:
        """Derivative of what is made least in a strength, of which nothing is believed, by that of the prediction."""
        change = -self._fitting.free_of_factors(change)
        return np.append(change, np.zeros((len(self._first) - len(change), 1)), axis=0)

    def _followed(self, effect: Effect, base, first, slopes) -> RoughFit | None:
        program = self._program
        place = program.place(effect.name)
        cause = program.causes[place]
        reach = effect.sign * self._reach(effect, cause)
        moved, scales = np.append(place, program.constants), np.append(reach, program.spreads)

        def whole(part: Float[np.ndarray, " moved"]) -> Float[np.ndarray, " unknown"]:
            unknowns = base.copy()
            unknowns[moved] += scales * part
            return unknowns

        followed = Followed(lambda part: self._fitting.stacked(whole(part)), first, slopes * scales)
        lower, upper = (each[moved] - base[moved] for each in self._fitting.bounds())
        lower, upper = lower / scales, upper / scales
        most = max(cause.farthest(effect.sign) / cause.plausible / abs(reach), 1.0 + 1e-6)
        lower[0], upper[0] = np.array([_LEAST, most]) - base[place] / reach
        followed.descend(lower, upper)
        if followed.best is None:
            return None
        unknowns = whole(followed.best)
        strength = float(unknowns[place]) * cause.plausible
        towards = dataclasses.replace(effect, directions=self._change(followed.lowest)[:, None] / strength)
        return RoughFit(towards, unknowns, strength, float(followed.lowest @ followed.lowest))

    def _change(self, value: Float[np.ndarray, " datum"]) -> Float[np.ndarray, " datum"]:
        """Of what is predicted, from the fit without causes on, but for what the sonications' factors can do."""
        readings, change = len(self._problem.rows), value - self._since
        noise = self._fitting.noise
        return np.append(-noise.colour(change[:readings, None])[:, 0], noise.loudness * change[readings:])

    def _reach(self, effect: Effect, cause: HmiCause) -> float:
        """The strength that would be detected, in plausible ones, or the largest that is followed."""
        visible = float(visibility(effect.directions, self._begun.directions)[0])
        strength = detectable_strength(effect, visible, self._spread)
        # An effect that was taken too far, and is too long there, is taken to grow with the square of the strength.
        strength = math.sqrt(strength * max(strength, abs(effect.reach)))
        return min(strength / cause.plausible, farthest(cause, effect.sign))


class Followed:
    """What is made least, its derivative as the steps so far have shown it, and the best point of them."""

    def __init__(
        self,
        function: Callable[[Float[np.ndarray, " moved"]], Float[np.ndarray, " datum"]],
        first: Float[np.ndarray, " datum"],
        slopes: Float[np.ndarray, "datum moved"],
    ) -> None:
        """Begin where nothing has moved, with the value and the derivative there."""
        self._function, self._slopes = function, slopes
        self._point, self._value = np.zeros(slopes.shape[1]), first
        self.best: Float[np.ndarray, " moved"] | None = None
        self.lowest: Float[np.ndarray, " datum"] = np.full(len(first), np.inf)

    def descend(self, lower: Float[np.ndarray, " moved"], upper: Float[np.ndarray, " moved"]) -> None:
        """Least squares within bounds, from where the first derivative has it."""
        start = optimize.lsq_linear(self._slopes, -self._value, (lower, upper), method="bvls").x
        nearest = np.clip(np.zeros(len(start)), lower, upper)
        for _ in range(_HALVINGS):
            if np.all(np.isfinite(self.value(start))):
                break
            start = 0.5 * (start + nearest)
        else:
            return
        optimize.least_squares(
            self.value, start, jac=self._known,  # pyright: ignore[reportArgumentType]
            bounds=(lower, upper), method="dogbox", ftol=_TOLERANCE, max_nfev=_MOST_STEPS,
        )  # fmt: skip

    def _known(self, point: Float[np.ndarray, " moved"]) -> Float[np.ndarray, "datum moved"]:
        """The derivative; as the last step left it, wherever that ended."""
        del point
        return self._slopes

    def value(self, point: Float[np.ndarray, " moved"]) -> Float[np.ndarray, " datum"]:
        """There; the derivative afterwards is one with which the step to it comes true."""
        step = point - self._point
        square = float(step @ step)
        if square == 0.0:
            return self._value
        value = self._function(point)
        if np.all(np.isfinite(value)):
            surprise = value - self._value - self._slopes @ step
            self._slopes = self._slopes + np.outer(surprise, step) / square
            self._point, self._value = point.copy(), value
            if value @ value < self.lowest @ self.lowest:
                self.best, self.lowest = point.copy(), value
        return value
