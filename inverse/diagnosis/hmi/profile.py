"""Intervals of strengths by profile likelihood: effects of causes bend within their intervals.

Most of all where a lesion begins and the displacement turns within a kelvin: the curvature at the fit knows nothing of
what is farther away, and a correction of the fast simulation that was taken at the fit knows little. (Conduction four
times that of liver, d' 4.5, was given an interval of 0.9 to 1.9 by one, where the truth was 3.2.) Nor does one that was
taken at an end know what lies between: as corrected at 0.33, every strength up to the estimate of 0.90 seemed worse
than 0.33 is. So where the full simulation does not confirm an end, it is looked for by that, each trial corrected until
it agrees where it comes out, as fits are.
"""

import dataclasses
import itertools
import math

import numpy as np
from jaxtyping import Float
from scipy import stats

from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.bound_search import Trial, searched
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.fitting import INTERVAL_LEVEL, Fitting, HmiFit, moved_by
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.refit import SETTLED, fit_hmi, fit_in_full
from inverse.diagnosis.noise import Noise

_MOST_IN_FULL = 6
"""Trials by the full simulation."""
_MOST_CORRECTIONS = 3
"""To it, in one of them."""
_NOT_CONFIRMED = "is one that the full simulation does not confirm."
_WORTH_A_FIT = 0.25
"""How much lower than the fit a trial has to be, in squared standard deviations, for the fit to begin anew there."""


def profiled(fit: HmiFit, noise: Noise, size: float) -> HmiFit:
    """The fit with intervals at whose ends the likelihood, all else fitted anew, has fallen to the bound.

    Accuracy: at each end the likelihood has fallen to the bound within 5 % of the fall, counted in standard deviations,
    by a simulation that agrees there with the full one within `SETTLED`, or as well as at the fit, where that is worse
    and is said of it; for a fit of the fast simulation alone, by that. An end that could not be found so, or lies where
    no other fit could be made, is the nearest one known, and `remarks` say so. What a strength can be at most, or at
    least, is an end without remark.

    A trial that is better than the fit shows that this is a local one; it begins anew there, once. One that the full
    simulation was not asked about shows it only if that has such a fit, too.

    Args:
        fit: Converged; others come back as they are.
        noise: What the fit was weighed with.
        size: Of the noise, for the priors.
    """
    if not fit.converged:
        return fit
    found, confirmed, doubtful = _ends(fit, noise, size)
    lowest = min((one for one in (confirmed, doubtful) if one), key=lambda one: one.misfit, default=None)
    if not _is_better(lowest, fit):
        return found
    better = _anew(fit, lowest, noise, size)
    if better is None:
        # One that the full simulation does not confirm may be the correction's alone.
        if not _is_better(confirmed, fit):
            return found
        return _with_remarks(
            found, "its interval is not one: a better fit was met on the way, and could not be reached."
        )
    found, confirmed, _ = _ends(better, noise, size)
    found = _with_remarks(
        found,
        "on the way to its interval a better fit was met: strength and interval are of that one, p-values are not.",
    )
    return _with_remarks(found, "beside that a still better one was met.") if _is_better(confirmed, better) else found


def _with_remarks(fit: HmiFit, *remarks: str) -> HmiFit:
    return dataclasses.replace(fit, remarks=(*fit.remarks, *remarks))


def _is_better(trial: HmiFit | None, fit: HmiFit) -> bool:
    return trial is not None and fit.misfit - trial.misfit > _WORTH_A_FIT * fit.variance


def _ends(fit: HmiFit, noise: Noise, size: float) -> tuple[HmiFit, HmiFit | None, HmiFit | None]:
    """The fit with its intervals; the best trial on the way to their ends, and of those that may not be one in full."""
    responses = _responses(fit, noise, size)
    searches = [
        _End(fit, which, direction, noise, size, direction * response)
        for which, response in enumerate(responses)
        for direction in (-1.0, 1.0)
    ]
    ends = np.array([search.found() for search in searches]).reshape(-1, 2)
    remarks = tuple(f"{search.words} {search.remark}" for search in searches if search.remark)
    found = _with_remarks(dataclasses.replace(fit, intervals=ends), *remarks)
    confirmed, doubtful = (
        min(itertools.chain.from_iterable(trials), key=lambda one: one.misfit, default=None)
        for trials in ([search.tried for search in searches], [search.doubtful for search in searches])
    )
    return found, confirmed, doubtful


def _responses(fit: HmiFit, noise: Noise, size: float) -> list[Float[np.ndarray, " unknown"]]:
    """How all that is fitted follows each strength, by the unit of it, as the derivatives at the fit have it."""
    fitting = Fitting(fit.problem, fit.extensions, noise, size)
    moved = fitting.moved
    columns = fitting.stacked_slopes(fit.problem.slopes(fit.unknowns, moved.tolist()), fit.unknowns)
    found = []
    for place, scale in zip(fitting.strengths, fitting.scales, strict=True):
        held = moved == place
        response = np.zeros(len(fit.unknowns))
        response[moved[~held]] = -np.linalg.lstsq(columns[:, ~held], columns[:, held][:, 0], rcond=1e-9)[0] / scale
        found.append(response)
    return found


def _anew(fit: HmiFit, trial: HmiFit | None, noise: Noise, size: float) -> HmiFit | None:
    """The fit from where a trial is better; None if that leads nowhere."""
    assert trial is not None
    again = fit_hmi if fit.problem.correction is None else fit_in_full
    better = again(
        trial.problem, trial.extensions, noise, size=size, start=trial.unknowns, strengths=trial.strengths
    )  # fmt: skip
    return better if better.converged and not better.left > SETTLED and _is_better(better, fit) else None


class _End:
    """The search for one end: which strength, and whether below its estimate (-1) or above (1)."""

    def __init__(
        self,
        fit: HmiFit,
        which: int,
        direction: float,
        noise: Noise,
        size: float,
        response: Float[np.ndarray, " unknown"],
    ) -> None:
        """Prepare; `response` is how the unknowns follow a unit in that direction."""
        self.response = response
        self.fit, self.which, self.direction, self.noise, self.size = fit, which, direction, noise, size
        self.best = float(fit.strengths[which])
        self.near = float(fit.intervals[which, int(direction > 0)])
        reach = float(stats.t.ppf(0.5 + 0.5 * INTERVAL_LEVEL, fit.freedom))
        self.bound = math.sqrt(fit.variance) * reach
        self.limit = self._limit()
        self.known = {0.0: fit.unknowns}
        self.tried: list[HmiFit] = []
        self.doubtful: list[HmiFit] = []
        self.remark = ""

    @property
    def words(self) -> str:
        """Which end."""
        side = "lower" if self.direction < 0.0 else "upper"
        return f"the {side} end of the interval of {self.fit.extensions[self.which].cause.name}"

    def found(self) -> float:
        """The strength there."""
        if self.limit <= 0.0:
            return self.best
        if not math.isfinite(min(abs(self.near - self.best), self.limit)):
            self.remark = "is not told by these data."
            return self.near
        begun = min(abs(self.near - self.best) or self.limit, self.limit)
        end = searched(lambda step: self._held(self.fit.problem, step), begun, self.limit)
        if end is not None and not (self.fit.problem.correction is None or self._settled(self.fit.problem, end)):
            self.known = {0.0: self.fit.unknowns, end.step: end.unknowns}
            self.tried, self.doubtful = [], self.tried
            full = searched(self._in_full, end.step, self.limit, most=_MOST_IN_FULL)
            end = full or dataclasses.replace(end, remark=_NOT_CONFIRMED)
        if end is None:
            self.remark = "is that of the curvature: no other fit could be made on that side."
            return self.near
        self.remark = end.remark
        return self._strength(end.step)

    def _limit(self) -> float:
        """How far the strength may go."""
        lowest, largest = self.fit.extensions[self.which].cause.possible
        return max(self.best - lowest if self.direction < 0.0 else largest - self.best, 0.0)

    def _in_full(self, step: float) -> Trial | None:
        """The trial by the full simulation: by the fast one as corrected to it where the trial comes out."""
        problem, trial, start = self.fit.problem, None, self._start(self.fit.problem, step)
        if start is None:
            return None
        for _ in range(_MOST_CORRECTIONS):
            problem = problem.corrected_at(start, moved_by(problem, self.fit.extensions))
            if problem.correction is None or not problem.correction.is_finite:
                break
            again = self._held(problem, step, start)
            if again is None or self._settled(problem, again):
                trial = again or trial
                break
            # As low as it may be, it is not the full simulation that is so low there.
            self.tried.pop()
            trial, start = dataclasses.replace(again, remark=_NOT_CONFIRMED), again.unknowns
        return trial

    def _settled(self, problem: HmiDiagnosisProblem, trial: Trial) -> bool:
        """Whether the full simulation agrees, or no less than at the fit: trials are compared with its misfit."""
        agreed = SETTLED if math.isnan(self.fit.left) else max(SETTLED, self.fit.left)
        return float(np.linalg.norm(problem.left(trial.unknowns))) <= agreed * self.size

    def _held(
        self, problem: HmiDiagnosisProblem, step: float, start: Float[np.ndarray, " unknown"] | None = None
    ) -> Trial | None:
        """All else fitted with the strength held; None where there is no such fit."""
        start = self._start(problem, step) if start is None else start
        if start is None:
            return None
        fit, place = self.fit, problem.program.place
        # Other strengths begin on the line, too.
        begun = [start[place(one.cause.name)] * one.cause.plausible for one in fit.extensions]
        strengths: Float[np.ndarray, " extension"] = np.array(begun)
        strengths[self.which] = self._strength(step)
        found = fit_hmi(
            problem, self._shaped(start), self.noise, size=self.size, start=start, strengths=strengths,
            held=(self.which,), anywhere=True,
        )  # fmt: skip
        if not found.converged:
            return None
        self.tried.append(found)
        self.known[step] = found.unknowns
        risen = math.sqrt(max(found.misfit - fit.misfit, 0.0)) / self.bound
        return Trial(step, risen, found.unknowns)

    def _strength(self, step: float) -> float:
        """At a distance from its estimate."""
        return self.best + self.direction * step

    def _start(self, problem: HmiDiagnosisProblem, step: float) -> Float[np.ndarray, " unknown"] | None:
        """Unknowns on the line through the two trials next to a step, or at the nearest; None if neither can be."""
        first, second = self._nearest(step)
        along = (step - first[0]) / (second[0] - first[0])
        strength = self._strength(step) / self.fit.extensions[self.which].cause.plausible
        for unknowns in (first[1] + along * (second[1] - first[1]), first[1].copy()):
            unknowns[problem.program.place(self.fit.extensions[self.which].cause.name)] = strength
            if np.all(np.isfinite(problem.predict(unknowns))):
                return unknowns
        return None

    def _shaped(self, unknowns: Float[np.ndarray, " unknown"]) -> tuple[Extension[HmiCause], ...]:
        """The extensions in the shapes that are among the unknowns."""
        program = self.fit.problem.program
        count, causes = len(program.causes), [extension.cause for extension in self.fit.extensions]
        return tuple(Extension(cause, float(unknowns[count + program.place(cause.name)])) for cause in causes)

    def _nearest(self, step: float) -> list[tuple[float, Float[np.ndarray, " unknown"]]]:
        """The two nearest trials, the estimate among them; before there is any, what the fit's derivatives say."""
        known = sorted(self.known.items(), key=lambda one: abs(one[0] - step))
        return known[:2] if len(known) > 1 else [known[0], (1.0, known[0][1] + self.response)]
